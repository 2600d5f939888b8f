//! The camera–board transform from mirror views alone: closed form, then bundle adjustment.

use super::mirror_start::{FEWEST_VIEWS, closed_form};
use super::weakness::Weakness;
use crate::camera::Camera;
use crate::cancel::Cancel;
use crate::error::{Error, Result, positive};
use crate::geometry::Plane;
use crate::joint::{BoardPrior, JointEstimate, JointFrame, JointOptions, joint_estimate};
use crate::mirror::{Board, BoardView, EstimatorOptions, Loss, MirrorOptics, PlanarPose, planar_pose};
use nalgebra::{Isometry3, Matrix3, Matrix6, Point3};
use rayon::prelude::*;
use std::cell::Cell;

/// A view whose own best pose leaves more than this (px RMS) is refused: good views of public sets leave 0.3 to 0.5,
/// a grid shifted by a row 1.7 to 2.6.
const GATE_PX: f64 = 1.0;

/// A prior as good as none (rad, m), for directions that the views do not show at all.
const HOLDING_STD: (f64, f64) = (0.3, 0.3);
/// Corners computed without noise leave nothing: their deviation is then taken as this, px.
const LEAST_STD_PX: f64 = 1e-9;
/// The same beside a prior, against which corners without noise would weigh so much that nothing of it is left in the last digits.
const LEAST_STD_BESIDE_PRIOR_PX: f64 = 1e-6;
/// Rounds of noise and fit in turn beside a prior.
const NOISE_ROUNDS: usize = 20;
/// The noise is settled when it changes by less than this share, which is far below its own uncertainty.
const NOISE_SETTLED: f64 = 1e-3;

/// What the calibration from mirror views assumes.
#[derive(Debug, Clone, PartialEq)]
pub struct MirrorViewOptions {
    /// Glass and curvature of the mirrors.
    pub optics: MirrorOptics,
    /// Standard deviation of a corner along one axis, px; `None`: estimated from the corners' residuals alone, whatever the prior.
    pub corner_std_px: Option<f64>,
    /// How residuals count.
    pub loss: Loss,
    /// A prior on the transform, centred on the nominal transform. `None`: the views alone decide.
    pub prior: Option<(Isometry3<f64>, Matrix6<f64>)>,
    /// Views whose free planar pose leaves more than this are refused, px RMS.
    pub gate_px: f64,
    /// Looked at in every view of every step.
    pub cancel: Cancel,
}

impl Default for MirrorViewOptions {
    /// An ideal mirror, noise estimated from the residual, Huber's loss at 2 σ: corners of real pictures are not all equally
    /// good.
    fn default() -> Self {
        Self {
            optics: MirrorOptics::IDEAL,
            corner_std_px: None,
            loss: Loss::huber(),
            prior: None,
            gate_px: GATE_PX,
            cancel: Cancel::default(),
        }
    }
}

/// A view that was not used, and why.
#[derive(Debug, Clone, PartialEq)]
pub struct RefusedView {
    /// Its place in the input.
    pub view: usize,
    /// Why.
    pub reason: Error,
}

/// A calibrated camera–board transform.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraBoardCalibration {
    /// The transform.
    pub camera_from_board: Isometry3<f64>,
    /// 6×6 in the tangent of [`crate::geometry::rotation::moved`] (rotation rad, translation m).
    pub covariance: Matrix6<f64>,
    /// Its worst-known directions, for a warning.
    pub weakness: Weakness,
    /// Which views were used, by their index in the input.
    pub views: Vec<usize>,
    /// The views that did not, and why.
    pub refused: Vec<RefusedView>,
    /// The mirror of each view used, in the camera frame.
    pub planes: Vec<Plane>,
    /// 3×3 of the planes' foot points, m².
    pub plane_covariances_m2: Vec<Matrix3<f64>>,
    /// Mean length of the corners' residuals over all corners, px.
    pub reprojection_mean_px: f64,
    /// Root mean square length of the residuals, px, of each view used.
    pub view_rms_px: Vec<f64>,
    /// Standard deviation of a corner along one axis, from which the covariance is computed, px.
    pub corner_std_px: f64,
    /// Whether the views determine all six directions. If they do not (a mirror that only turns about its own
    /// stand), a prior of 0.3 rad and 0.3 m holds the undetermined direction near the closed form; the covariance
    /// and the warning show it.
    pub determined: bool,
}

/// Mean residual length of all corners, px.
fn reprojection_mean_px(
    camera: &Camera,
    optics: &MirrorOptics,
    camera_from_board: &Isometry3<f64>,
    views: &[&BoardView],
    planes: &[Plane],
) -> Result<f64> {
    let (mut sum, mut count) = (0.0, 0.0);
    for (view, plane) in views.iter().zip(planes) {
        for corner in view.corners() {
            let at = Point3::new(corner.point_in_board.x, corner.point_in_board.y, 0.0);
            sum += (optics.project(camera, plane, &(camera_from_board * at))? - corner.pixel).norm();
            count += 1.0;
        }
    }
    Ok(sum / count)
}

/// The free pose of each view, or why the view is refused.
fn gated(camera: &Camera, view: &BoardView, gate_px: f64) -> Result<PlanarPose> {
    let pose = planar_pose(camera, view, &EstimatorOptions::default())?;
    if pose.rms_px > gate_px {
        return Err(Error::ViewOverGate { got_px: pose.rms_px, needed_px: gate_px });
    }
    Ok(pose)
}

/// Standard deviation of a corner by the views' own best poses, px: no transform has a part in it, so no prior either.
fn free_std_px(views: &[&BoardView], poses: &[&PlanarPose]) -> f64 {
    let counted = views.iter().zip(poses).map(|(view, pose)| (view.corners().len() as f64, pose.rms_px));
    let (squares, free) = counted.fold((0.0, 0.0), |(squares, free), (corners, rms)| {
        (squares + corners * rms * rms, free + 2.0 * corners - 6.0)
    });
    (squares / free.max(1.0)).sqrt()
}

/// Standard deviation of a corner by the residuals of a fit under a prior, px: `√(Σ r² / (2 n − unknowns))`.
///
/// Unknowns are three for each mirror, and of the transform's six as many as the views decide: `6 − tr(Σ₀⁻¹ Σ)`.
fn fitted_std_px(found: &JointEstimate, views: &[&BoardView], prior: &Matrix6<f64>) -> Option<f64> {
    let told_by_prior = (prior.cholesky()?.inverse() * found.camera_from_board_covariance).trace();
    let (mut squares, mut free) = (0.0, told_by_prior.clamp(0.0, 6.0) - 6.0);
    for (view, rms) in views.iter().zip(&found.corner_rms_px) {
        let corners = view.corners().len() as f64;
        squares += corners * rms * rms;
        free += 2.0 * corners - 3.0;
    }
    Some((squares / free.max(1.0)).sqrt())
}

/// Calibrates the camera–board transform from three or more mirror poses: no second camera, the mirror free-standing.
///
/// Closed form from the reflected board's poses, then all corners of all views at once (the joint estimator without markers):
/// `Σ ρ(|pixel − observed|/σ)` over the transform and each view's plane. The covariance says how well the views show it:
/// by yaw alone one direction is nearly blind, and [`Weakness::warning`] names it.
///
/// # Errors
/// [`Error::LengthMismatch`] where fewer than three views pass the gate; [`Error::Undetermined`] where the views do not
/// determine it at all (the mirror never turned).
///
/// # Source
/// After Takahashi, Nobuhara & Matsuyama 2012 ("TNM"); here with distortion, glass, robust loss, covariance.
pub fn calibrate_from_mirror_views(
    camera: &Camera,
    board: &Board,
    views: &[BoardView],
    options: &MirrorViewOptions,
) -> Result<CameraBoardCalibration> {
    positive("gate on a view's residual (px)", options.gate_px)?;
    let poses: Vec<Result<PlanarPose>> =
        views.par_iter().map(|view| gated(camera, view, options.gate_px)).collect();
    let (mut used, mut used_views, mut used_poses, mut refused) = (vec![], vec![], vec![], vec![]);
    for (index, (view, pose)) in views.iter().zip(&poses).enumerate() {
        match pose {
            Ok(pose) => {
                used.push(index);
                used_views.push(view);
                used_poses.push(pose);
            }
            Err(reason) => refused.push(RefusedView { view: index, reason: reason.clone() }),
        }
    }
    let fewest = if options.prior.is_none() { FEWEST_VIEWS } else { 1 };
    if used.len() < fewest
        && let Some(first) = refused.first()
    {
        // Too few are left because some were refused: the error says why.
        return Err(Error::InView { view: first.view, source: Box::new(first.reason.clone()) });
    }
    let (nominal, prior) = match &options.prior {
        Some((nominal, covariance)) => (*nominal, BoardPrior::Covariance(*covariance)),
        None => (closed_form(camera, board, &used_views, &used_poses)?, BoardPrior::Unknown),
    };
    let frames: Vec<JointFrame> = used_views
        .iter()
        .enumerate()
        .map(|(index, view)| JointFrame {
            posture: index as i64,
            nominal_camera_from_board: nominal,
            corners: (*view).clone(),
            markers: Vec::new(),
        })
        .collect();
    let attempt = |corner_std_px: f64, loss: Loss, prior: BoardPrior| {
        let joint = JointOptions {
            optics: options.optics,
            corner_std_px,
            loss,
            prior,
            cancel: options.cancel.clone(),
            ..JointOptions::default()
        };
        joint_estimate(camera, board, &[], &frames, &joint)
    };
    let held = Cell::new(false);
    let adjust = |corner_std_px: f64, loss: Loss| match attempt(corner_std_px, loss, prior) {
        Err(Error::Undetermined { .. } | Error::NotConverged { .. }) if options.prior.is_none() => {
            held.set(true);
            let (rotation, translation) = HOLDING_STD;
            attempt(corner_std_px, loss, BoardPrior::isotropic(rotation, translation))
        }
        other => other,
    };
    let (found, corner_std_px) = match (options.corner_std_px, &options.prior) {
        (Some(std), _) => (adjust(positive("standard deviation of a corner (px)", std)?, options.loss)?, std),
        (None, Some((_, prior))) => {
            // From below: at too large a noise the prior would hold the transform, and the residual would confirm that noise.
            let mut std = free_std_px(&used_views, &used_poses).max(LEAST_STD_BESIDE_PRIOR_PX);
            for _ in 0..NOISE_ROUNDS {
                let plain = adjust(std, Loss::Squared)?;
                let Some(next) = fitted_std_px(&plain, &used_views, prior) else { break };
                let next = next.max(LEAST_STD_BESIDE_PRIOR_PX);
                let settled = (next - std).abs() <= NOISE_SETTLED * std;
                std = next;
                if settled {
                    break;
                }
            }
            (adjust(std, options.loss)?, std)
        }
        (None, None) => {
            // With σ = 1 px, χ² is the sum of squares.
            let plain = adjust(1.0, Loss::Squared)?;
            let std = (plain.chi_squared / plain.degrees_of_freedom.max(1) as f64).sqrt();
            let std = std.max(LEAST_STD_PX);
            (adjust(std, options.loss)?, std)
        }
    };
    let camera_from_board = found.camera_from_nominal_camera * nominal;
    Ok(CameraBoardCalibration {
        reprojection_mean_px: reprojection_mean_px(
            camera,
            &options.optics,
            &camera_from_board,
            &used_views,
            &found.planes,
        )?,
        camera_from_board,
        weakness: Weakness::of(&found.camera_from_board_covariance, board),
        covariance: found.camera_from_board_covariance,
        views: used,
        refused,
        planes: found.planes,
        plane_covariances_m2: found.plane_covariances_m2,
        view_rms_px: found.corner_rms_px,
        corner_std_px,
        determined: !held.get(),
    })
}
