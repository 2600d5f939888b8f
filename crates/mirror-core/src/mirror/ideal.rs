//! The picture of a point in an ideal mirror (flat, no glass) and its Jacobians: the fast path of the inner loops.

use crate::camera::Camera;
use crate::error::Result;
use nalgebra::{Matrix2x3, Matrix3, Point3, Vector2, Vector3};

/// A reflected point with its Jacobians.
#[derive(Debug, Clone, Copy)]
pub struct IdealReflection {
    /// `x′`, m.
    pub point: Point3<f64>,
    /// `∂x′/∂x = H`.
    pub by_point: Matrix3<f64>,
    /// `∂x′/∂f`.
    pub by_foot: Matrix3<f64>,
}

/// The pixel of a point's reflection with its Jacobians.
#[derive(Debug, Clone, Copy)]
pub struct IdealPixel {
    /// (u, v), px.
    pub pixel: Vector2<f64>,
    /// `∂(u, v)/∂x`, px/m.
    pub by_point: Matrix2x3<f64>,
    /// `∂(u, v)/∂f`, px/m.
    pub by_foot: Matrix2x3<f64>,
}

/// The reflection of a point across the plane of a foot point f, with Jacobians.
///
/// `x′ = x + 2 (1 − f·x/f·f) f`; `∂x′/∂x = I − 2 f fᵀ/f·f`;
/// `∂x′/∂f = 2 (1 − f·x/f·f) I + 2 f (2 (f·x) f/(f·f)² − x/f·f)ᵀ`. All in the camera frame, m.
#[inline]
pub fn reflect_point(foot: &Vector3<f64>, point: &Point3<f64>) -> IdealReflection {
    let per_square = 1.0 / foot.norm_squared();
    let along = foot.dot(&point.coords) * per_square;
    let share = 2.0 * (1.0 - along);
    let slope = (foot * (2.0 * along) - point.coords) * (2.0 * per_square);
    let outer = foot * slope.transpose();
    IdealReflection {
        point: point + foot * share,
        by_point: Matrix3::identity() - foot * (foot * (2.0 * per_square)).transpose(),
        by_foot: Matrix3::from_diagonal_element(share) + outer,
    }
}

/// The pixel at which a camera sees a point in a mirror, with Jacobians.
///
/// # Errors
/// As [`Camera::project`], for the reflected point.
#[inline]
pub fn ideal_pixel(camera: &Camera, foot: &Vector3<f64>, point: &Point3<f64>) -> Result<IdealPixel> {
    let reflected = reflect_point(foot, point);
    let (pixel, by_reflected) = camera.project_with_point_jacobian(&reflected.point)?;
    Ok(IdealPixel {
        pixel,
        by_point: by_reflected * reflected.by_point,
        by_foot: by_reflected * reflected.by_foot,
    })
}
