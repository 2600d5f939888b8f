//! Maximum likelihood in pixels, the mirrors' covariances included.

use super::options::{PixelFit, Triangulated, TriangulationOptions};
use super::parallax::{enough, widest_angle_rad};
use super::rays::{beyond_mirror, midpoint};
use crate::camera::Camera;
use crate::error::{Error, Result, positive};
use crate::geometry::Plane;
use crate::mirror::{MirrorEstimate, MirrorOptics, VirtualCamera, VirtualRay};
use nalgebra::{Matrix2, Matrix2x3, Matrix3, Matrix6, Point3, SMatrix, Vector2, Vector3, Vector6};

/// Gauss–Newton from the midpoint takes 3 to 5 steps.
const MOST_STEPS: usize = 50;
/// A step that promises to lower chi-squared by less than this is the last one: 1e-5 standard deviations.
const SMALLEST_DECREASE: f64 = 1e-10;

/// One view of a marker: its pixel, and the mirror in which it was seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MarkerView {
    /// (u, v) of the marker's centre, px.
    pub pixel: Vector2<f64>,
    /// Its standard deviation along one axis, px.
    pub noise_px: f64,
    /// The mirror in the camera frame.
    pub plane: Plane,
    /// The mirror's glass and curvature.
    pub optics: MirrorOptics,
    /// 3×3 of the plane's foot point from this view's own noise, m².
    pub measurement_covariance_m2: Matrix3<f64>,
    /// `∂f/∂(tangent of camera_from_board)`, 3×6: what the views share.
    pub foot_by_camera_from_board: SMatrix<f64, 3, 6>,
}

impl MarkerView {
    /// A marker's pixel with the mirror that an estimator found in the same picture.
    ///
    /// # Errors
    /// [`Error::NotFinite`] and [`Error::OutOfRange`] for the pixel and its noise.
    pub fn new(mirror: &MirrorEstimate, pixel: Vector2<f64>, noise_px: f64) -> Result<Self> {
        crate::error::finite("u of a marker (px)", pixel.x)?;
        crate::error::finite("v of a marker (px)", pixel.y)?;
        positive("noise of a marker's pixel (px)", noise_px)?;
        Ok(Self {
            pixel,
            noise_px,
            plane: mirror.plane,
            optics: mirror.optics,
            measurement_covariance_m2: mirror.measurement_covariance_m2,
            foot_by_camera_from_board: mirror.foot_by_camera_from_board,
        })
    }

    fn virtual_ray(&self, camera: &Camera) -> Result<VirtualRay> {
        let mirror = VirtualCamera::Reflected {
            plane: self.plane,
            optics: self.optics,
            measurement_covariance_m2: self.measurement_covariance_m2,
            foot_by_camera_from_board: self.foot_by_camera_from_board,
        };
        mirror.ray(camera, &self.pixel, self.noise_px)
    }
}

/// A view's residual with its whitening at a point.
struct Linear {
    residual: Vector2<f64>,
    by_point: Matrix2x3<f64>,
    by_shared: SMatrix<f64, 2, 6>,
    weight: Matrix2<f64>,
}

fn linearised(
    camera: &Camera,
    view: &MarkerView,
    root: &Matrix6<f64>,
    point: &Point3<f64>,
) -> Result<Linear> {
    let seen = view.optics.apparent_point_in_loop(&view.plane, point)?;
    let (pixel, by_apparent) = camera.project_with_point_jacobian(&seen.point)?;
    let by_foot = by_apparent * seen.by_foot_point;
    let covariance = by_foot * view.measurement_covariance_m2 * by_foot.transpose()
        + Matrix2::from_diagonal_element(view.noise_px * view.noise_px);
    Ok(Linear {
        residual: pixel - view.pixel,
        by_point: by_apparent * seen.by_point,
        by_shared: by_foot * view.foot_by_camera_from_board * root,
        weight: covariance.try_inverse().ok_or(Error::Undetermined { what: "noise of a marker's pixel" })?,
    })
}

/// Whitened normal equations at a point, the shared error eliminated.
struct Reduced {
    chi_squared: f64,
    gradient: Vector3<f64>,
    information: Matrix3<f64>,
    /// Information on the point if nothing else were unknown: for the sensitivities.
    alone: Matrix3<f64>,
}

fn reduced(
    camera: &Camera,
    views: &[MarkerView],
    root: &Matrix6<f64>,
    point: &Point3<f64>,
) -> Result<Reduced> {
    let mut chi_squared = 0.0;
    let mut gradient = Vector3::zeros();
    let mut alone = Matrix3::zeros();
    let mut mixed = SMatrix::<f64, 3, 6>::zeros();
    let mut shared = Matrix6::identity();
    let mut shared_gradient = Vector6::zeros();
    for view in views {
        let at = linearised(camera, view, root, point)?;
        let weighted = at.weight * at.residual;
        let by_point = at.by_point.transpose() * at.weight;
        chi_squared += at.residual.dot(&weighted);
        gradient += at.by_point.transpose() * weighted;
        alone += by_point * at.by_point;
        mixed += by_point * at.by_shared;
        shared += at.by_shared.transpose() * at.weight * at.by_shared;
        shared_gradient += at.by_shared.transpose() * weighted;
    }
    let factor = shared.cholesky().ok_or(Error::Undetermined { what: "camera-board transform" })?;
    let solved = factor.solve(&shared_gradient);
    Ok(Reduced {
        chi_squared: chi_squared - shared_gradient.dot(&solved),
        gradient: gradient - mixed * solved,
        information: alone - mixed * factor.solve(&mixed.transpose()),
        alone,
    })
}

/// A square root of a positive semi-definite covariance, also a singular one: `L Lᵀ = Σ`.
fn square_root(covariance: &Matrix6<f64>) -> Matrix6<f64> {
    let eigen = covariance.symmetric_eigen();
    eigen.eigenvectors * Matrix6::from_diagonal(&eigen.eigenvalues.map(|x| x.max(0.0).sqrt()))
}

/// The point that makes the marker's pixels most likely, N ≥ 2 views.
///
/// The mirrors are not exact: view k's foot point has covariance Σ_k of its own and moves by `F_k δ` with the error δ
/// of the camera–board transform, which all views share. Both are integrated out: each residual is whitened by
/// `σ² I + J_f Σ_k J_fᵀ`, and δ, under its prior, is eliminated from the normal equations. The covariance is the
/// inverse of what remains.
///
/// # Errors
/// [`Error::LengthMismatch`] for fewer than two views; [`Error::TooLittleParallax`]; [`Error::WrongSide`];
/// [`Error::NotUnprojectable`]; [`Error::NotConverged`].
pub fn maximum_likelihood(
    camera: &Camera,
    views: &[MarkerView],
    options: &TriangulationOptions,
) -> Result<Triangulated> {
    let options = options.validated()?;
    let rays = views.iter().map(|v| v.virtual_ray(camera)).collect::<Result<Vec<_>>>()?;
    let parallax_rad = enough(widest_angle_rad(rays.iter().map(|r| &r.ray))?, options.least_parallax_rad)?;
    let mut point = midpoint(&rays, &options)?.point_in_camera;
    let root = options.camera_from_board_covariance.map_or(Matrix6::zeros(), |c| square_root(&c));

    const WHAT: &str = "marker position";
    let mut settled = false;
    let mut decrease = f64::INFINITY;
    for _ in 0..MOST_STEPS {
        let at = reduced(camera, views, &root, &point)?;
        let factor = at.information.cholesky().ok_or(Error::Undetermined { what: WHAT })?;
        let step = -factor.solve(&at.gradient);
        decrease = -step.dot(&at.gradient);
        point += step;
        if decrease <= SMALLEST_DECREASE {
            settled = true;
            break;
        }
    }
    if !settled {
        return Err(Error::NotConverged {
            what: WHAT,
            steps: MOST_STEPS,
            last_step: decrease,
            needed: SMALLEST_DECREASE,
        });
    }
    for (k, ray) in rays.iter().enumerate() {
        beyond_mirror(k, &point, ray.ray.direction.dot(&(point - ray.ray.origin)), ray.mirror_at_m)?;
    }

    let at = reduced(camera, views, &root, &point)?;
    let undetermined = Error::Undetermined { what: WHAT };
    let covariance_m2 = at.information.try_inverse().ok_or(undetermined.clone())?;
    let alone = at.alone.try_inverse().ok_or(undetermined)?;
    let mut squares_px2 = 0.0;
    let mut squares_m2 = 0.0;
    let mut by_board = SMatrix::<f64, 3, 6>::zeros();
    for (view, ray) in views.iter().zip(&rays) {
        let seen = linearised(camera, view, &Matrix6::identity(), &point)?;
        squares_px2 += seen.residual.norm_squared();
        squares_m2 += ray.ray.distance_m(&point).powi(2);
        by_board -= alone * seen.by_point.transpose() * seen.weight * seen.by_shared;
    }
    let count = views.len() as f64;
    Ok(Triangulated {
        point_in_camera: point,
        covariance_m2,
        measurement_covariance_m2: alone,
        point_by_camera_from_board: by_board,
        parallax_rad,
        rms_ray_distance_m: (squares_m2 / count).sqrt(),
        pixel_fit: Some(PixelFit {
            rms_px: (squares_px2 / count).sqrt(),
            chi_squared: at.chi_squared,
            degrees_of_freedom: 2 * views.len() - 3,
        }),
    })
}
