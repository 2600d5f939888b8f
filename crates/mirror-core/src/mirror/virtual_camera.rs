//! The virtual camera and its rays.

use super::optics::MirrorOptics;
use crate::camera::Camera;
use crate::error::{Error, Result, positive};
use crate::geometry::rotation::hat;
use crate::geometry::{ImproperIsometry, Plane, Ray, Reflection};
use nalgebra::{Matrix3, Matrix6, Point3, SMatrix, Unit, Vector2};

/// Eq. 1's map `C_T_C′` with its covariance. It turns handedness but is not a reflection (its square is not I).
#[derive(Debug, Clone, PartialEq)]
pub struct ImproperEstimate {
    /// From the virtual to the real camera.
    pub map: ImproperIsometry,
    /// 6×6 of the tangent (ω, v) of `map ∘ (Exp ω, v)` (rotation first), from corner noise alone.
    pub measurement_covariance: Matrix6<f64>,
    /// `∂(tangent)/∂(tangent of camera_from_board)`, 6×6.
    pub by_camera_from_board: Matrix6<f64>,
}

/// The virtual camera C′: the real one seen in the mirror, as an estimator has found it.
#[derive(Debug, Clone, PartialEq)]
// One a view, on the stack: a box would cost more than the difference.
#[allow(clippy::large_enum_variant)]
pub enum VirtualCamera {
    /// By a mirror plane (Eq. 2 and all other estimators of a plane).
    Reflected {
        /// The mirror in the camera frame.
        plane: Plane,
        /// The mirror's glass and curvature.
        optics: MirrorOptics,
        /// 3×3 of its foot point from corner noise, m².
        measurement_covariance_m2: Matrix3<f64>,
        /// `∂f/∂(tangent of camera_from_board)`.
        foot_by_camera_from_board: SMatrix<f64, 3, 6>,
    },
    /// By Eq. 1's map.
    Improper(ImproperEstimate),
}

/// The ray from the virtual camera through the real marker, in the camera frame, with its covariance.
#[derive(Debug, Clone, PartialEq)]
pub struct VirtualRay {
    /// Starts at the virtual camera's centre.
    pub ray: Ray,
    /// 6×6 of (origin m, unit direction) from the noise of the corners and of the pixel: independent between views.
    pub measurement_covariance: Matrix6<f64>,
    /// `∂(origin, direction)/∂(tangent of camera_from_board)`: shared between views.
    pub by_camera_from_board: Matrix6<f64>,
    /// Where along the ray the mirror is, m: real markers lie beyond it.
    pub mirror_at_m: f64,
}

impl VirtualRay {
    /// The covariance of (origin, direction) with that of the camera–board transform (6×6, pose tangent).
    pub fn covariance(&self, camera_from_board_covariance: &Matrix6<f64>) -> Matrix6<f64> {
        let g = &self.by_camera_from_board;
        self.measurement_covariance + g * camera_from_board_covariance * g.transpose()
    }
}

/// The virtual ray of a pixel, and how it depends on the mirror and on the pixel.
#[derive(Debug, Clone, Copy)]
pub struct RayJacobians {
    /// The ray.
    pub ray: Ray,
    /// `∂(origin, direction)/∂f`, 6×3.
    pub by_foot: SMatrix<f64, 6, 3>,
    /// `∂(origin, direction)/∂(u, v)`, 6×2.
    pub by_pixel: SMatrix<f64, 6, 2>,
}

/// The virtual ray of a pixel, without covariance: origin `2 d n`, direction `H r` (Eq. 3), in the camera frame.
///
/// # Errors
/// As [`Camera::unproject`].
#[inline]
pub fn virtual_ray(camera: &Camera, plane: &Plane, pixel: &Vector2<f64>) -> Result<Ray> {
    let reflection = Reflection::across(*plane);
    let direction = reflection.vector(&*camera.unproject(pixel)?);
    Ok(Ray { origin: Point3::from(reflection.translation()), direction: Unit::new_unchecked(direction) })
}

/// The virtual ray of a pixel with its Jacobians: `∂origin/∂f = 2 I`,
/// `∂direction/∂f = −2 ((n·r) I + n rᵀ) (I − n nᵀ)/d`, `∂direction/∂(u, v) = H ∂r/∂(u, v)`.
///
/// # Errors
/// As [`Camera::unproject`], and [`crate::Error::OutOfRange`] for a plane through the camera's centre.
pub fn virtual_ray_with_jacobians(
    camera: &Camera,
    plane: &Plane,
    pixel: &Vector2<f64>,
) -> Result<RayJacobians> {
    let reflection = Reflection::across(*plane);
    let seen = camera.unproject_with_jacobian(pixel)?;
    let (n, r) = (plane.normal().into_inner(), seen.direction.into_inner());
    let by_normal = (Matrix3::from_diagonal_element(n.dot(&r)) + n * r.transpose()) * -2.0;
    let mut by_foot = SMatrix::<f64, 6, 3>::zeros();
    by_foot.fixed_rows_mut::<3>(0).fill_with_identity();
    by_foot.fixed_rows_mut::<3>(0).scale_mut(2.0);
    by_foot.fixed_rows_mut::<3>(3).copy_from(&(by_normal * plane.normal_by_foot_point()?));
    let mut by_pixel = SMatrix::<f64, 6, 2>::zeros();
    by_pixel.fixed_rows_mut::<3>(3).copy_from(&(reflection.linear() * seen.by_pixel));
    let direction = Unit::new_unchecked(reflection.vector(&r));
    let ray = Ray { origin: Point3::from(reflection.translation()), direction };
    Ok(RayJacobians { ray, by_foot, by_pixel })
}

/// Where a virtual ray meets the plane half-way between the real and the virtual camera, `o·x = |o|²/2`, m.
fn mirror_along(ray: &Ray) -> Result<f64> {
    let o = ray.origin.coords;
    let towards = -o.dot(&ray.direction);
    if towards > 0.0 {
        Ok(o.norm_squared() / (2.0 * towards))
    } else {
        Err(Error::OutOfRange {
            what: "cosine between a camera ray and the mirror's normal".into(),
            got: towards / o.norm(),
            needed: "above 0: a pixel whose ray meets the mirror".into(),
        })
    }
}

impl VirtualCamera {
    /// The virtual ray of a pixel whose noise has the given standard deviation (px, one axis), with its covariance.
    ///
    /// By a plane: [`virtual_ray_with_jacobians`]. By Eq. 1's map `(L, t)`: origin t, direction `L r`, and with the
    /// map's tangent `δorigin = L v`, `δdirection = −L r̂ ω`. Where the mirror has glass or curvature the ray is that of
    /// [`MirrorOptics::virtual_ray`] and its Jacobians are the ideal mirror's: the difference is of the order of the
    /// glass's thickness over the path, of an already small covariance.
    ///
    /// # Errors
    /// As [`Camera::unproject`]; [`crate::Error::OutOfRange`] for a noise that is not above zero, or a ray that misses
    /// the mirror.
    pub fn ray(&self, camera: &Camera, pixel: &Vector2<f64>, pixel_noise_px: f64) -> Result<VirtualRay> {
        let variance = positive("noise of a marker's pixel (px)", pixel_noise_px)?.powi(2);
        match self {
            Self::Reflected { plane, optics, measurement_covariance_m2, foot_by_camera_from_board } => {
                let at = virtual_ray_with_jacobians(camera, plane, pixel)?;
                let ray = if optics.is_ideal() {
                    at.ray
                } else {
                    optics.virtual_ray(plane, &camera.unproject(pixel)?)?
                };
                Ok(VirtualRay {
                    ray,
                    mirror_at_m: mirror_along(&at.ray)?,
                    measurement_covariance: at.by_foot * measurement_covariance_m2 * at.by_foot.transpose()
                        + at.by_pixel * at.by_pixel.transpose() * variance,
                    by_camera_from_board: at.by_foot * foot_by_camera_from_board,
                })
            }
            Self::Improper(improper) => {
                let seen = camera.unproject_with_jacobian(pixel)?;
                let linear = improper.map.linear();
                let direction = Unit::new_unchecked(linear * seen.direction.into_inner());
                let ray = Ray { origin: Point3::from(*improper.map.translation()), direction };
                let mut by_map = Matrix6::zeros();
                by_map.fixed_view_mut::<3, 3>(0, 3).copy_from(linear);
                by_map.fixed_view_mut::<3, 3>(3, 0).copy_from(&-(linear * hat(&seen.direction)));
                let by_pixel = linear * seen.by_pixel;
                let mut covariance = by_map * improper.measurement_covariance * by_map.transpose();
                let mut corner = covariance.fixed_view_mut::<3, 3>(3, 3);
                corner += by_pixel * by_pixel.transpose() * variance;
                Ok(VirtualRay {
                    mirror_at_m: mirror_along(&ray)?,
                    ray,
                    measurement_covariance: covariance,
                    by_camera_from_board: by_map * improper.by_camera_from_board,
                })
            }
        }
    }
}
