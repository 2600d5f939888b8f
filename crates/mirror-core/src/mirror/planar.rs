//! Pose of a flat board from its corners in one picture.

use super::board::{BoardView, SeenCorner};
use super::corner_fit::{CornerFit, CornerModel, Predicted, finished, fit_state};
use super::options::EstimatorOptions;
use super::planar_start::closed_form_poses;
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::geometry::rotation;
use nalgebra::{Isometry3, Matrix6, Point3, SMatrix, Vector6};

/// Two poses nearer to each other than this (rad and m in one norm) are one.
const SAME_POSE: f64 = 1e-7;

/// The pose of the points of a board with its covariance.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanarPose {
    /// `camera_from_pattern`: maps `(x, y, 0)` of a corner to where the camera sees it.
    ///
    /// Of a board seen directly it is `camera_from_board`. Of a board seen in a mirror (true labels) it is the paper's
    /// D, a right-handed frame: its x and y axes are the reflected board's, its z axis is opposite. The reflected
    /// board's own, left-handed pose is [`crate::geometry::ImproperIsometry::with_z_reversed`] of it.
    pub camera_from_pattern: Isometry3<f64>,
    /// 6×6, in the tangent of [`crate::geometry::rotation`] (rotation first; rad², rad m, m²).
    pub covariance: Matrix6<f64>,
    /// Root mean square of the corners' residual lengths, px.
    pub rms_px: f64,
    /// Standard deviation of a corner along one axis, from which the covariance is computed, px.
    pub noise_px: f64,
    /// The other pose that explains the picture, where there is one.
    pub alternative: Option<AlternativePose>,
}

/// The second local minimum of a plane's pose.
#[derive(Debug, Clone, PartialEq)]
pub struct AlternativePose {
    /// As [`PlanarPose::camera_from_pattern`].
    pub camera_from_pattern: Isometry3<f64>,
    /// Its residual, px. If it is close to the better pose's, the picture does not determine the sign of the tilt.
    pub rms_px: f64,
}

struct PoseModel<'a> {
    camera: &'a Camera,
}

impl CornerModel<6> for PoseModel<'_> {
    type State = Isometry3<f64>;
    const WHAT: &'static str = "pose of the board";

    /// `p = R (Exp(ω) x + v) + t`, so `∂p/∂(ω, v) = R [−x̂ | I]` with x = (x, y, 0).
    #[inline]
    fn predict(&self, pose: &Self::State, corner: &SeenCorner) -> Result<Predicted<6>> {
        let (x, y) = (corner.point_in_board.x, corner.point_in_board.y);
        let point = pose * Point3::new(x, y, 0.0);
        let (pixel, by_point) = self.camera.project_with_point_jacobian(&point)?;
        let q = by_point * pose.rotation.to_rotation_matrix().into_inner();
        let mut jacobian = SMatrix::<f64, 2, 6>::zeros();
        jacobian.set_column(0, &(q.column(2) * y));
        jacobian.set_column(1, &(q.column(2) * -x));
        jacobian.set_column(2, &(q.column(1) * x - q.column(0) * y));
        jacobian.fixed_columns_mut::<3>(3).copy_from(&q);
        Ok(Predicted { pixel, jacobian })
    }

    fn moved(&self, pose: &Self::State, step: &Vector6<f64>) -> Result<Self::State> {
        Ok(rotation::moved(pose, step))
    }
}

fn rms(camera: &Camera, corners: &[SeenCorner], pose: &Isometry3<f64>) -> Result<f64> {
    let model = PoseModel { camera };
    let mut sum = 0.0;
    for corner in corners {
        sum += (model.predict(pose, corner)?.pixel - corner.pixel).norm_squared();
    }
    Ok((sum / corners.len() as f64).sqrt())
}

/// The pose of a board's points from their pixels: both closed-form poses, each refined on the reprojection error,
/// the better one returned.
///
/// Robust face-on, where the two poses coincide: a pose or an error, never a number that is not one.
///
/// # Errors
/// [`Error::NotUnprojectable`] for a corner outside the lens model; [`Error::Undetermined`] for corners that do not
/// determine a pose; [`Error::NotConverged`].
///
/// # Source
/// Start: Collins and Bartoli 2014 ("IPPE"); refinement: Gauss–Newton with Levenberg's damping in pixels.
pub fn planar_pose(camera: &Camera, view: &BoardView, options: &EstimatorOptions) -> Result<PlanarPose> {
    let options = options.validated()?;
    let corners = view.corners();
    let model = PoseModel { camera };
    let starts = closed_form_poses(camera, corners)?;
    let refined = starts.map(|start| fit_state(&model, corners, start, &options));
    let ((pose, noise_px), second) = match refined {
        [Ok(a), Ok(b)] => {
            if rotation::difference(&a.0, &b.0).norm() < SAME_POSE {
                (a, None)
            } else {
                let (in_a, in_b) = (rms(camera, corners, &a.0)?, rms(camera, corners, &b.0)?);
                let alternative =
                    |camera_from_pattern, rms_px| AlternativePose { camera_from_pattern, rms_px };
                if in_a <= in_b {
                    (a, Some(alternative(b.0, in_b)))
                } else {
                    (b, Some(alternative(a.0, in_a)))
                }
            }
        }
        [Ok(pose), Err(_)] | [Err(_), Ok(pose)] => (pose, None),
        [Err(error), Err(_)] => return Err(error),
    };
    let CornerFit { state, covariance, rms_px, noise_px } =
        finished(&model, corners, pose, &options, noise_px)?;
    if !covariance.iter().all(|x| x.is_finite()) {
        return Err(Error::Undetermined { what: "pose of the board" });
    }
    Ok(PlanarPose { camera_from_pattern: state, covariance, rms_px, noise_px, alternative: second })
}
