//! The single-view mirror estimators by name, and their common result: a mirror with its covariance.

use super::board::BoardView;
use super::optics::MirrorOptics;
use super::rig::Rig;
use super::virtual_camera::{ImproperEstimate, VirtualCamera};
use crate::error::{Error, Result};
use crate::geometry::Plane;
use nalgebra::{Isometry3, Matrix3, SMatrix};

/// The single-view estimators of the mirror, from the paper's baseline to the best that one view allows.
///
/// ```
/// use mirror_core::mirror::MirrorEstimator;
///
/// assert_eq!(MirrorEstimator::from_name("point_pair")?, MirrorEstimator::PointPair);
/// let unknown = MirrorEstimator::from_name("eq2");
/// assert!(unknown.is_err_and(|error| error.to_string().contains("maximum_likelihood")));
/// # Ok::<(), mirror_core::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum MirrorEstimator {
    /// Eq. 1: the reflected board's whole pose composed with the camera–board transform. An improper map, not a
    /// reflection: its virtual rays contain the board's rotation error. It is the paper's baseline, unchanged.
    Pose,
    /// Eq. 1 snapped to the nearest reflection.
    PoseSnapped,
    /// Eq. 2: the plane half-way between the board's centre and its reflection. The paper's method.
    PointPair,
    /// The plane that minimises the reprojection error of all reflected corners.
    MaximumLikelihood,
}

impl MirrorEstimator {
    /// All of them, in the ladder's order.
    pub const ALL: [Self; 4] = [Self::Pose, Self::PoseSnapped, Self::PointPair, Self::MaximumLikelihood];

    /// The name used on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Pose => "pose",
            Self::PoseSnapped => "pose_snapped",
            Self::PointPair => "point_pair",
            Self::MaximumLikelihood => "maximum_likelihood",
        }
    }

    /// The estimator of a name.
    ///
    /// # Errors
    /// [`Error::UnknownName`], with the valid names.
    pub fn from_name(name: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|e| e.name() == name).ok_or_else(|| Error::UnknownName {
            what: "mirror estimator",
            got: name.to_owned(),
            valid: Self::ALL.map(Self::name).join(", "),
        })
    }
}

/// A mirror, with its covariance.
#[derive(Debug, Clone, PartialEq)]
pub struct MirrorEstimate {
    /// Which estimator it came from.
    pub estimator: MirrorEstimator,
    /// The mirror in the camera frame, its normal away from the camera. Of [`MirrorEstimator::Pose`]: the plane of
    /// the nearest reflection, for comparison only; its virtual rays do not use it.
    pub plane: Plane,
    /// The mirror's glass and curvature, as the estimator assumed them.
    pub optics: MirrorOptics,
    /// 3×3 of the foot point `f = d n`, m²: corner noise and the camera–board transform's covariance together.
    pub covariance_m2: Matrix3<f64>,
    /// The part of it that is the corner noise's: independent from view to view.
    pub measurement_covariance_m2: Matrix3<f64>,
    /// `∂f/∂(tangent of camera_from_board)`, 3×6: through it views that share the transform share its error.
    pub foot_by_camera_from_board: SMatrix<f64, 3, 6>,
    /// Eq. 1's map and its covariance, of [`MirrorEstimator::Pose`] alone.
    pub improper: Option<ImproperEstimate>,
    /// Root mean square of the corners' residual lengths, px: of the reflected board's free pose for
    /// [`MirrorEstimator::Pose`], of the board reflected across the plane for the others.
    pub rms_px: f64,
    /// Standard deviation of a corner along one axis, from which the covariance is computed, px.
    pub noise_px: f64,
    /// The camera–board transform that was used.
    pub camera_from_board: Isometry3<f64>,
}

impl MirrorEstimate {
    /// The virtual camera C′: what turns pixels into virtual rays.
    pub fn virtual_camera(&self) -> VirtualCamera {
        match &self.improper {
            Some(improper) => VirtualCamera::Improper(improper.clone()),
            None => VirtualCamera::Reflected {
                plane: self.plane,
                optics: self.optics,
                measurement_covariance_m2: self.measurement_covariance_m2,
                foot_by_camera_from_board: self.foot_by_camera_from_board,
            },
        }
    }
}

/// What the estimators hand over: the shared ending.
pub(crate) struct Found {
    pub plane: Plane,
    pub measurement_covariance_m2: Matrix3<f64>,
    pub foot_by_camera_from_board: SMatrix<f64, 3, 6>,
    pub optics: MirrorOptics,
    pub rms_px: f64,
    pub noise_px: f64,
}

impl Found {
    pub(crate) fn into_estimate(self, estimator: MirrorEstimator, rig: &Rig) -> MirrorEstimate {
        let g = self.foot_by_camera_from_board;
        let shared = rig.camera_from_board_covariance.map_or(Matrix3::zeros(), |c| g * c * g.transpose());
        MirrorEstimate {
            estimator,
            plane: self.plane,
            optics: self.optics,
            covariance_m2: self.measurement_covariance_m2 + shared,
            measurement_covariance_m2: self.measurement_covariance_m2,
            foot_by_camera_from_board: g,
            improper: None,
            rms_px: self.rms_px,
            noise_px: self.noise_px,
            camera_from_board: rig.camera_from_board,
        }
    }
}

/// Root mean square reprojection error of the board reflected across a plane, px.
pub(crate) fn reflected_rms_px(rig: &Rig, view: &BoardView, plane: &Plane) -> Result<f64> {
    let reflection = crate::geometry::Reflection::across(*plane);
    let mut sum = 0.0;
    for corner in view.corners() {
        let at = corner.point_in_board;
        let reflected = reflection.point(&(rig.camera_from_board * nalgebra::Point3::new(at.x, at.y, 0.0)));
        sum += (rig.camera.project(&reflected)? - corner.pixel).norm_squared();
    }
    Ok((sum / view.corners().len() as f64).sqrt())
}

/// Refuses a mirror that camera and board are not both in front of.
pub(crate) fn before_both(plane: Plane, rig: &Rig) -> Result<Plane> {
    let board = nalgebra::Point3::from(rig.camera_from_board.translation.vector);
    if plane.offset_m() > 0.0 && plane.signed_distance_m(&board) < 0.0 {
        return Ok(plane);
    }
    Err(Error::MirrorBehind { offset_m: plane.offset_m(), board_m: -plane.signed_distance_m(&board) })
}
