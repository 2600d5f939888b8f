//! The paper's measurement in bulk: reflected boards' positions and pixels of two views to markers.

use super::rays::midpoint_of_two;
use crate::camera::Camera;
use crate::error::Result;
use crate::geometry::Plane;
use crate::mirror::virtual_ray;
use nalgebra::{Point3, Vector2};
use rayon::prelude::*;

/// Fewer markers than this a thread are not worth handing out: 1,024 take some 0.2 ms.
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

/// [`point_pair_marker`] for many markers, on all cores, one result a marker in their order.
pub fn point_pair_markers(
    camera: &Camera,
    board_in_camera: &Point3<f64>,
    markers: &[TwoViews],
    least_parallax_rad: f64,
) -> Vec<Result<Point3<f64>>> {
    markers
        .par_iter()
        .with_min_len(SMALLEST_SHARE)
        .map(|views| point_pair_marker(camera, board_in_camera, views, least_parallax_rad))
        .collect()
}
