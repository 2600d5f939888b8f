//! The paper's measurement in bulk: reflected boards' positions and pixels of two views to markers.

use super::options::least_parallax;
use super::rays::midpoint_of_two_virtual;
use super::vectors::point_pairs;
use crate::camera::{Camera, FixedSteps};
use crate::cancel::Cancel;
use crate::error::{Error, Result};
use crate::geometry::Plane;
use crate::mirror::virtual_ray;
use nalgebra::{Point3, Vector2};
use rayon::prelude::*;

/// Markers that one task takes: with fewer a thread is not worthwhile.
const SHARE: usize = 2048;

/// A marker seen in two views: the reflected board's origin b′ and the marker's pixel of each.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TwoViews {
    /// b′ of each view in the camera frame, m.
    pub reflected_boards: [Point3<f64>; 2],
    /// The marker's pixel in each view, px.
    pub pixels: [Vector2<f64>; 2],
}

/// The paper's measurement of one marker: two planes by Eq. 2, two virtual rays, the midpoint; camera frame, m.
///
/// # Errors
/// [`crate::Error::NoDirection`], [`crate::Error::NotUnprojectable`], [`crate::Error::TooLittleParallax`],
/// [`crate::Error::WrongSide`].
#[inline]
pub fn point_pair_marker(
    camera: &Camera,
    board_in_camera: &Point3<f64>,
    views: &TwoViews,
    least_parallax_rad: f64,
) -> Result<Point3<f64>> {
    let ray = |k: usize| {
        let plane = Plane::between(board_in_camera, &views.reflected_boards[k])?;
        virtual_ray(camera, &plane, &views.pixels[k])
    };
    midpoint_of_two_virtual(&ray(0)?, &ray(1)?, least_parallax_rad)
}

/// A row of a batch that has no result.
#[derive(Debug, Clone, PartialEq)]
pub struct Refused {
    /// The row, from 0.
    pub row: usize,
    /// Why.
    pub error: Error,
}

/// Points of a batch, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct PointBatch {
    /// x, y, z in the camera frame, m; rows that are refused are not numbers.
    pub points_m: Vec<[f64; 3]>,
    /// The rows without a result, rising.
    pub refused: Vec<Refused>,
}

/// [`point_pair_marker`] for many markers, on all cores: a row of `reflected_boards_m` is b′ of both views, a row of
/// `pixels_px` the marker's pixels in both.
///
/// # Errors
/// [`Error::LengthMismatch`] where the two differ in length; [`Error::Cancelled`] where `cancel` says stop. Rows that have no
/// result are marked in the batch.
pub fn point_pair_markers(
    camera: &Camera,
    board_in_camera: &Point3<f64>,
    reflected_boards_m: &[[f64; 6]],
    pixels_px: &[[f64; 4]],
    least_parallax_rad: f64,
    cancel: &Cancel,
) -> Result<PointBatch> {
    least_parallax(least_parallax_rad)?;
    if reflected_boards_m.len() != pixels_px.len() {
        return Err(Error::LengthMismatch {
            what: "rows of pixels".into(),
            got: pixels_px.len(),
            needed: reflected_boards_m.len(),
        });
    }
    let lens = FixedSteps::new(camera);
    let one = |row: usize, out: &mut [f64; 3]| {
        let (&[a, b, c, d, e, f], &[ua, va, ub, vb]) = (&reflected_boards_m[row], &pixels_px[row]);
        let views = TwoViews {
            reflected_boards: [Point3::new(a, b, c), Point3::new(d, e, f)],
            pixels: [Vector2::new(ua, va), Vector2::new(ub, vb)],
        };
        match point_pair_marker(camera, board_in_camera, &views, least_parallax_rad) {
            Ok(point) => {
                *out = point.into();
                None
            }
            Err(error) => Some(Refused { row, error }),
        }
    };
    let mut points_m = vec![[f64::NAN; 3]; pixels_px.len()];
    let shares = points_m.par_chunks_mut(SHARE).enumerate().take_any_while(|_| !cancel.is_cancelled());
    let mut refused: Vec<Refused> = shares
        .flat_map_iter(|(k, out)| {
            let rows = k * SHARE..k * SHARE + out.len();
            if let Some(lens) = &lens {
                point_pairs(
                    lens,
                    &board_in_camera.coords.into(),
                    &reflected_boards_m[rows.clone()],
                    &pixels_px[rows.clone()],
                    least_parallax_rad,
                    out,
                );
            }
            rows.zip(out).filter(|(_, out)| out[0].is_nan()).filter_map(|(row, out)| one(row, out))
        })
        .collect();
    cancel.check()?;
    refused.sort_by_key(|r| r.row);
    Ok(PointBatch { points_m, refused })
}
