//! The paper's measurement in bulk: reflected boards' positions and pixels of two views to markers.

use super::rays::midpoint_of_two;
use crate::camera::Camera;
use crate::cancel::Cancel;
use crate::error::{Error, Result};
use crate::geometry::Plane;
use crate::mirror::virtual_ray;
use nalgebra::{Point3, Vector2};
use rayon::prelude::*;

/// With fewer markers than this a thread is not worthwhile: 1,024 take some 0.2 ms.
const SMALLEST_SHARE: usize = 1024;

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
    midpoint_of_two(&ray(0)?, &ray(1)?, least_parallax_rad)
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
    if reflected_boards_m.len() != pixels_px.len() {
        return Err(Error::LengthMismatch {
            what: "rows of pixels".into(),
            got: pixels_px.len(),
            needed: reflected_boards_m.len(),
        });
    }
    let mut points_m = vec![[f64::NAN; 3]; pixels_px.len()];
    let mut refused: Vec<Refused> = points_m
        .par_iter_mut()
        .zip(reflected_boards_m)
        .zip(pixels_px)
        .enumerate()
        .with_min_len(SMALLEST_SHARE)
        .take_any_while(|_| !cancel.is_cancelled())
        .filter_map(|(row, ((out, &[a, b, c, d, e, f]), &[ua, va, ub, vb]))| {
            let views = TwoViews {
                reflected_boards: [Point3::new(a, b, c), Point3::new(d, e, f)],
                pixels: [Vector2::new(ua, va), Vector2::new(ub, vb)],
            };
            match point_pair_marker(camera, board_in_camera, &views, least_parallax_rad) {
                Ok(point) => {
                    *out = [point.x, point.y, point.z];
                    None
                }
                Err(error) => Some(Refused { row, error }),
            }
        })
        .collect();
    cancel.check()?;
    refused.sort_by_key(|r| r.row);
    Ok(PointBatch { points_m, refused })
}
