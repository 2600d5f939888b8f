//! Closed forms on rays: the paper's midpoint, and least squares of more rays.

use super::options::{Triangulated, TriangulationOptions};
use super::parallax::{enough, widest_angle_rad};
use crate::error::{Error, Result};
use crate::geometry::Ray;
use crate::mirror::VirtualRay;
use nalgebra::{Matrix3, Point3, SMatrix, Vector3};

/// Refuses a point that no real marker in this mirror can have: it must lie beyond the mirror along the ray.
pub(super) fn beyond_mirror(view: usize, point: &Point3<f64>, along_m: f64, mirror_at_m: f64) -> Result<()> {
    let place = if along_m <= 0.0 {
        "behind the virtual camera"
    } else if along_m <= mirror_at_m {
        "behind the mirror"
    } else {
        return Ok(());
    };
    Err(Error::WrongSide { view, x: point.x, y: point.y, z: point.z, place })
}

/// `I − d dᵀ`: the projection across a ray.
#[inline]
fn across(ray: &Ray) -> Matrix3<f64> {
    let d = ray.direction.into_inner();
    Matrix3::identity() - d * d.transpose()
}

/// The midpoint of two rays' closest points, m, without covariance: the paper's marker position.
///
/// # Errors
/// [`Error::TooLittleParallax`]; [`Error::WrongSide`] where the rays approach each other behind a start.
#[inline]
pub fn midpoint_of_two(a: &Ray, b: &Ray, least_parallax_rad: f64) -> Result<Point3<f64>> {
    let (da, db) = (a.direction.into_inner(), b.direction.into_inner());
    let between = b.origin - a.origin;
    let cross = da.cross(&db);
    let squared = cross.norm_squared();
    // sin² ≥ sin² of the least angle, without an arc tangent for the many that pass.
    // Written so that NaN fails.
    if !(squared > 0.0 && squared >= least_parallax_rad.sin().powi(2)) {
        enough(super::line_angle_rad(a, b), least_parallax_rad)?;
        if !(squared > 0.0) {
            return Err(Error::Undetermined { what: "marker position" });
        }
    }
    let t = between.cross(&db).dot(&cross) / squared;
    let s = between.cross(&da).dot(&cross) / squared;
    let point = nalgebra::center(&a.at(t), &b.at(s));
    beyond_mirror(0, &point, t, 0.0)?;
    beyond_mirror(1, &point, s, 0.0)?;
    Ok(point)
}

/// The same of two virtual rays, which start at the reflected camera, `o = 2 d n`, and cross their mirrors at `|o|² / (−2 o·r)`: a
/// marker lies beyond both.
///
/// # Errors
/// As [`midpoint_of_two`]; [`Error::WrongSide`] also behind a mirror.
#[inline]
pub(super) fn midpoint_of_two_virtual(a: &Ray, b: &Ray, least_parallax_rad: f64) -> Result<Point3<f64>> {
    let point = midpoint_of_two(a, b, least_parallax_rad)?;
    for (view, ray) in [a, b].into_iter().enumerate() {
        let (origin, direction) = (ray.origin.coords, ray.direction.into_inner());
        let mirror_at_m = origin.norm_squared() / (-2.0 * origin.dot(&direction));
        let along_m = direction.dot(&(point - ray.origin));
        // A ray that leaves the mirror's plane behind it never meets it.
        let crosses = mirror_at_m > 0.0;
        beyond_mirror(view, &point, along_m, if crosses { mirror_at_m } else { f64::INFINITY })?;
    }
    Ok(point)
}

/// The result with its covariance, from the point and the derivatives by each ray.
///
/// To first order a ray moves its point at distance λ by `u = δo + λ δd`, and the result by `Σ M_k u_k`.
pub(super) fn finished(
    point: Point3<f64>,
    rays: &[VirtualRay],
    parallax_rad: f64,
    by_ray_point: impl Fn(usize) -> Matrix3<f64>,
    options: &TriangulationOptions,
) -> Result<Triangulated> {
    let mut measurement_covariance_m2 = Matrix3::zeros();
    let mut point_by_camera_from_board = SMatrix::<f64, 3, 6>::zeros();
    let mut squares = 0.0;
    for (k, ray) in rays.iter().enumerate() {
        let offset = point - ray.ray.origin;
        let along = ray.ray.direction.dot(&offset);
        beyond_mirror(k, &point, along, ray.mirror_at_m)?;
        squares += (offset - ray.ray.direction.into_inner() * along).norm_squared();
        let m = by_ray_point(k);
        let mut jacobian = SMatrix::<f64, 3, 6>::zeros();
        jacobian.fixed_columns_mut::<3>(0).copy_from(&m);
        jacobian.fixed_columns_mut::<3>(3).copy_from(&(m * along));
        measurement_covariance_m2 += jacobian * ray.measurement_covariance * jacobian.transpose();
        point_by_camera_from_board += jacobian * ray.by_camera_from_board;
    }
    let result = Triangulated {
        point_in_camera: point,
        covariance_m2: measurement_covariance_m2,
        measurement_covariance_m2,
        point_by_camera_from_board,
        parallax_rad,
        rms_ray_distance_m: (squares / rays.len() as f64).sqrt(),
        pixel_fit: None,
    };
    Ok(result.with_shared(options))
}

/// The point nearest to all rays: for two, the midpoint of their closest points (the paper's); for more, least squares.
///
/// `x = (Σ P_k)⁻¹ Σ P_k o_k` with `P_k = I − d_k d_kᵀ`. First-order covariance, `M_k = (Σ P)⁻¹ P_k`.
///
/// # Errors
/// [`Error::LengthMismatch`] for fewer than two rays; [`Error::TooLittleParallax`]; [`Error::WrongSide`].
pub fn midpoint(rays: &[VirtualRay], options: &TriangulationOptions) -> Result<Triangulated> {
    let options = options.validated()?;
    let parallax_rad = enough(widest_angle_rad(rays.iter().map(|r| &r.ray))?, options.least_parallax_rad)?;
    let mut sum = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for ray in rays {
        let p = across(&ray.ray);
        sum += p;
        right += p * ray.ray.origin.coords;
    }
    let inverse = sum.try_inverse().ok_or(Error::Undetermined { what: "marker position" })?;
    let point = Point3::from(inverse * right);
    finished(point, rays, parallax_rad, |k| inverse * across(&rays[k].ray), &options)
}
