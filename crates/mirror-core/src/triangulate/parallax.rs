//! The angle between rays, which determines how well they intersect in a point.

use crate::error::{Error, Result};
use crate::geometry::Ray;

/// The angle between the lines of two rays, rad, 0 to π/2: `atan2(|a × b|, |a·b|)`, exact also where it is tiny.
#[inline]
pub fn line_angle_rad(a: &Ray, b: &Ray) -> f64 {
    a.direction.cross(&b.direction).norm().atan2(a.direction.dot(&b.direction).abs())
}

/// The widest angle between two of the rays, rad.
///
/// # Errors
/// [`Error::LengthMismatch`] for fewer than two rays.
pub fn widest_angle_rad<'a>(rays: impl Iterator<Item = &'a Ray> + Clone) -> Result<f64> {
    let count = rays.clone().count();
    if count < 2 {
        return Err(Error::LengthMismatch { what: "rays of a marker".into(), got: count, needed: 2 });
    }
    let mut widest = 0.0f64;
    for (i, a) in rays.clone().enumerate() {
        for b in rays.clone().skip(i + 1) {
            widest = widest.max(line_angle_rad(a, b));
        }
    }
    Ok(widest)
}

/// Refuses too little parallax, with the angle there is and the angle needed.
pub(crate) fn enough(got_rad: f64, needed_rad: f64) -> Result<f64> {
    // Written so that NaN fails the test.
    if got_rad >= needed_rad { Ok(got_rad) } else { Err(Error::TooLittleParallax { got_rad, needed_rad }) }
}
