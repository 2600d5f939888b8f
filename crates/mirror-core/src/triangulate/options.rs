//! Options and result that all triangulators share.

use crate::error::{Error, Result, positive};
use nalgebra::{Matrix3, Matrix6, Point3, SMatrix};

/// At 1° and a path of 300 mm a corner noise of 0.2 px at f = 700 px already moves a marker by 5 mm along the rays:
/// what lies below is no measurement.
const LEAST_PARALLAX_RAD: f64 = std::f64::consts::PI / 180.0;

/// Options of a triangulation: limits and noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TriangulationOptions {
    /// The least angle between the widest pair of rays, rad.
    pub least_parallax_rad: f64,
    /// 6×6 covariance of the camera–board transform that the views share (pose tangent, rotation first).
    /// `None`: taken as exact.
    pub camera_from_board_covariance: Option<Matrix6<f64>>,
}

impl Default for TriangulationOptions {
    fn default() -> Self {
        Self { least_parallax_rad: LEAST_PARALLAX_RAD, camera_from_board_covariance: None }
    }
}

impl TriangulationOptions {
    /// The options themselves, checked.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a least parallax that is not above zero and below a right angle.
    pub fn validated(self) -> Result<Self> {
        least_parallax(self.least_parallax_rad)?;
        Ok(self)
    }
}

/// Refuses a least parallax that is not above zero and below a right angle: rays are lines, which cross by no more.
pub(super) fn least_parallax(angle_rad: f64) -> Result<()> {
    if positive("least parallax (rad)", angle_rad)? < core::f64::consts::FRAC_PI_2 {
        return Ok(());
    }
    Err(Error::OutOfRange {
        what: "least parallax (rad)".into(),
        got: angle_rad,
        needed: "below a right angle, π/2".into(),
    })
}

/// The ways to triangulate, by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Triangulator {
    /// [`super::midpoint`].
    Midpoint,
    /// [`super::lee_civera_mid2`].
    LeeCiveraMid2,
    /// [`super::unbiased`].
    Unbiased,
    /// [`super::maximum_likelihood`].
    MaximumLikelihood,
}

impl Triangulator {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Midpoint, Self::LeeCiveraMid2, Self::Unbiased, Self::MaximumLikelihood];

    /// The name used on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Midpoint => "midpoint",
            Self::LeeCiveraMid2 => "lee_civera_mid2",
            Self::Unbiased => "unbiased",
            Self::MaximumLikelihood => "maximum_likelihood",
        }
    }

    /// The triangulator of a name.
    ///
    /// # Errors
    /// [`Error::UnknownName`], with the valid names.
    pub fn from_name(name: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|e| e.name() == name).ok_or_else(|| Error::UnknownName {
            what: "triangulator",
            got: name.to_owned(),
            valid: Self::ALL.map(Self::name).join(", "),
        })
    }
}

/// How well a maximum-likelihood point explains its pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelFit {
    /// Root mean square of the views' residual lengths, px.
    pub rms_px: f64,
    /// Sum of squares whitened by pixel noise and mirrors: chi-squared with [`PixelFit::degrees_of_freedom`].
    pub chi_squared: f64,
    /// `2 N − 3`.
    pub degrees_of_freedom: usize,
}

/// A marker's position with its covariance.
///
/// ```
/// use mirror_core::geometry::Ray;
/// use mirror_core::triangulate::midpoint_of_two;
/// use nalgebra::{Point3, Vector3};
///
/// let a = Ray::new(Point3::origin(), Vector3::new(0.1, 0.0, 1.0))?;
/// let b = Ray::new(Point3::new(0.2, 0.0, 0.0), Vector3::new(-0.1, 0.0, 1.0))?;
/// let marker = midpoint_of_two(&a, &b, 0.01)?;
/// assert!((marker - Point3::new(0.1, 0.0, 1.0)).norm() < 1e-12);
/// # Ok::<(), mirror_core::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Triangulated {
    /// In the camera frame, m.
    pub point_in_camera: Point3<f64>,
    /// 3×3, m²: noise of pixels and mirrors, and the camera–board transform's covariance where it was given.
    pub covariance_m2: Matrix3<f64>,
    /// The part of it that is noise of pixels and corners alone.
    pub measurement_covariance_m2: Matrix3<f64>,
    /// `∂point/∂(tangent of camera_from_board)`, 3×6.
    pub point_by_camera_from_board: SMatrix<f64, 3, 6>,
    /// The widest angle between two of the rays, rad.
    pub parallax_rad: f64,
    /// Root mean square distance of the point from the virtual rays, m.
    pub rms_ray_distance_m: f64,
    /// Of [`super::maximum_likelihood`] alone.
    pub pixel_fit: Option<PixelFit>,
}

impl Triangulated {
    pub(crate) fn with_shared(mut self, options: &TriangulationOptions) -> Self {
        let g = self.point_by_camera_from_board;
        let shared = options.camera_from_board_covariance.map_or(Matrix3::zeros(), |c| g * c * g.transpose());
        self.covariance_m2 = self.measurement_covariance_m2 + shared;
        self
    }
}
