//! The camera–board transform the paper's way: a second camera sees both boards.
//!
//! The robot's camera cannot see the board on its chest. A second board stands in its view; a second camera sees both
//! boards at once: `camera_from_chest = camera_from_stand · (second_from_stand)⁻¹ · second_from_chest`.

use super::weakness::Weakness;
use crate::camera::Camera;
use crate::cancel::Cancel;
use crate::error::{Error, Result};
use crate::geometry::rotation::{difference, moved};
use crate::joint::board_side_from_camera_side;
use crate::mirror::{Board, BoardView, EstimatorOptions, planar_pose};
use nalgebra::{Isometry3, Matrix6, Vector6};
use rayon::prelude::*;

/// A second pose of a board counts as possible where its residual is below this multiple of the better one's.
const AMBIGUOUS_RATIO: f64 = 2.0;
/// Squared normalised distances count no further than this when poses are chosen (99.9 % of χ² with 12 degrees of freedom).
const CONSENSUS_CAP: f64 = 33.0;
/// Number of snapshots, evenly spread over all, that vote on the chain: enough to outvote ambiguous poses, and the
/// work stays linear in the number of snapshots.
const WITNESSES: usize = 64;
/// The weighted mean converges in 3 to 5 steps.
const MEAN_STEPS: usize = 20;
/// It stops at steps below this (rad and m in one norm).
const MEAN_TOLERANCE: f64 = 1e-12;

/// The two cameras and the two boards.
#[derive(Debug, Clone, PartialEq)]
pub struct SecondCameraRig {
    /// The robot's camera.
    pub robot_camera: Camera,
    /// The second camera.
    pub second_camera: Camera,
    /// The board on the robot's chest.
    pub chest_board: Board,
    /// The board that stands in the robot's view.
    pub stand_board: Board,
}

/// One moment: what both cameras see of both boards, each with true labels (no mirror is involved). Between snapshots
/// the second camera and the standing board may move.
#[derive(Debug, Clone, PartialEq)]
pub struct SecondCameraSnapshot {
    /// The standing board in the robot's camera.
    pub stand_in_robot_camera: BoardView,
    /// The standing board in the second camera.
    pub stand_in_second_camera: BoardView,
    /// The chest board in the second camera.
    pub chest_in_second_camera: BoardView,
}

/// A transform from one or more snapshots.
#[derive(Debug, Clone, PartialEq)]
pub struct SecondCameraCalibration {
    /// The transform.
    pub camera_from_board: Isometry3<f64>,
    /// 6×6 in the tangent of [`crate::geometry::rotation::moved`] (rotation rad, translation m).
    pub covariance: Matrix6<f64>,
    /// Its worst-known directions.
    pub weakness: Weakness,
    /// What each snapshot alone gives.
    pub snapshots: Vec<SnapshotTransform>,
    /// Sum of the snapshots' squared normalised deviations from the mean.
    pub chi_squared: f64,
    /// What it should be: 6 (snapshots − 1).
    pub degrees_of_freedom: usize,
}

/// What one snapshot alone gives.
#[derive(Debug, Clone, PartialEq)]
pub struct SnapshotTransform {
    /// The chain of poses.
    pub camera_from_board: Isometry3<f64>,
    /// Its 6×6 covariance.
    pub covariance: Matrix6<f64>,
    /// Squared normalised deviation from the mean of all.
    pub chi_squared: f64,
    /// Largest residual of its three board poses, px RMS.
    pub rms_px: f64,
}

/// A pose with its covariance: one of the one or two that explain a picture.
struct PossiblePose {
    pose: Isometry3<f64>,
    covariance: Matrix6<f64>,
    rms_px: f64,
}

fn possible_poses(camera: &Camera, view: &BoardView) -> Result<Vec<PossiblePose>> {
    let best = planar_pose(camera, view, &EstimatorOptions::default())?;
    let mut all = Vec::with_capacity(2);
    if let Some(other) = &best.alternative
        && other.rms_px < AMBIGUOUS_RATIO * best.rms_px
    {
        // Its covariance is that of the same corners seen from the mirrored tilt: alike in size.
        all.push(PossiblePose {
            pose: other.camera_from_pattern,
            covariance: best.covariance,
            rms_px: other.rms_px,
        });
    }
    all.insert(
        0,
        PossiblePose { pose: best.camera_from_pattern, covariance: best.covariance, rms_px: best.rms_px },
    );
    Ok(all)
}

/// All chains of one snapshot.
///
/// With `X = A B⁻¹ D` and tangents on the right, `X ∘ δ = A δ_A δ_B⁻¹ B⁻¹ D δ_D`, so with `E = B⁻¹ D`:
/// `δ = δ_D + Ad(E⁻¹) (δ_A − δ_B)`.
fn chains(rig: &SecondCameraRig, snapshot: &SecondCameraSnapshot) -> Result<Vec<SnapshotTransform>> {
    let robot = possible_poses(&rig.robot_camera, &snapshot.stand_in_robot_camera)?;
    let stand = possible_poses(&rig.second_camera, &snapshot.stand_in_second_camera)?;
    let chest = possible_poses(&rig.second_camera, &snapshot.chest_in_second_camera)?;
    let mut all = Vec::new();
    for a in &robot {
        for b in &stand {
            for d in &chest {
                let stand_from_chest = b.pose.inverse() * d.pose;
                let carry = board_side_from_camera_side(&stand_from_chest);
                all.push(SnapshotTransform {
                    camera_from_board: a.pose * stand_from_chest,
                    covariance: d.covariance + carry * (a.covariance + b.covariance) * carry.transpose(),
                    chi_squared: 0.0,
                    rms_px: a.rms_px.max(b.rms_px).max(d.rms_px),
                });
            }
        }
    }
    Ok(all)
}

fn information(covariance: &Matrix6<f64>) -> Result<Matrix6<f64>> {
    covariance
        .cholesky()
        .map(|f| f.inverse())
        .ok_or(Error::Undetermined { what: "camera-board transform of a snapshot" })
}

/// Squared normalised distance of two chains.
fn distance(a: &SnapshotTransform, b: &SnapshotTransform) -> f64 {
    let error = difference(&a.camera_from_board, &b.camera_from_board);
    (a.covariance + b.covariance)
        .cholesky()
        .map_or(CONSENSUS_CAP, |f| error.dot(&f.solve(&error)).min(CONSENSUS_CAP))
}

/// Of each snapshot the chain that agrees best with the others: ambiguous board poses disagree from snapshot to snapshot.
fn consensus(snapshots: Vec<Vec<SnapshotTransform>>, cancel: &Cancel) -> Result<Vec<SnapshotTransform>> {
    let step = snapshots.len().div_ceil(WITNESSES).max(1);
    let support = |candidate: &SnapshotTransform, own: usize| -> f64 {
        snapshots
            .iter()
            .enumerate()
            .step_by(step)
            .filter(|(other, _)| *other != own)
            .map(|(_, all)| all.iter().map(|c| distance(candidate, c)).fold(CONSENSUS_CAP, f64::min))
            .sum()
    };
    let reference = snapshots
        .iter()
        .enumerate()
        .flat_map(|(own, all)| all.iter().map(move |c| (own, c)))
        .take_while(|_| !cancel.is_cancelled())
        .map(|(own, c)| (support(c, own), c))
        // The first of equals is the one with the better residual.
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, c)| c.clone());
    cancel.check()?;
    let Some(reference) = reference else { return Ok(Vec::new()) };
    Ok(snapshots
        .into_iter()
        .filter_map(|all| {
            all.into_iter()
                .map(|c| (difference(&c.camera_from_board, &reference.camera_from_board).norm(), c))
                .min_by(|a, b| a.0.total_cmp(&b.0))
                .map(|(_, c)| c)
        })
        .collect())
}

/// Calibrates the camera–board transform with a second camera: the chain of three board poses of each snapshot, with its
/// covariance from the corners' residuals, and the weighted mean of the snapshots,
/// `argmin Σ δ_kᵀ C_k⁻¹ δ_k`, `δ_k = difference(X_k, X)`.
///
/// A board seen nearly face-on from afar has two possible poses; the snapshots' agreement decides between them.
///
/// # Errors
/// [`Error::LengthMismatch`] without snapshots; [`Error::InView`] with the snapshot whose board pose fails;
/// [`Error::Cancelled`] where `cancel` says stop.
///
/// # Source
/// The paper, "calibration by an additional camera".
pub fn calibrate_with_second_camera(
    rig: &SecondCameraRig,
    snapshots: &[SecondCameraSnapshot],
    cancel: &Cancel,
) -> Result<SecondCameraCalibration> {
    if snapshots.is_empty() {
        return Err(Error::LengthMismatch { what: "snapshots (at least)".into(), got: 0, needed: 1 });
    }
    let all = snapshots
        .par_iter()
        .enumerate()
        .map(|(view, snapshot)| {
            cancel.check()?;
            chains(rig, snapshot).map_err(|source| Error::InView { view, source: Box::new(source) })
        })
        .collect::<Result<Vec<_>>>()?;
    let mut chosen = consensus(all, cancel)?;
    let informations = chosen.iter().map(|c| information(&c.covariance)).collect::<Result<Vec<_>>>()?;
    let total: Matrix6<f64> = informations.iter().sum();
    let factor =
        total.cholesky().ok_or(Error::Undetermined { what: "camera-board transform of all snapshots" })?;
    let mut mean = chosen.first().map_or_else(Isometry3::identity, |c| c.camera_from_board);
    for _ in 0..MEAN_STEPS {
        let pull: Vector6<f64> = chosen
            .iter()
            .zip(&informations)
            .map(|(c, information)| information * difference(&c.camera_from_board, &mean))
            .sum();
        let step = factor.solve(&pull);
        mean = moved(&mean, &step);
        if step.norm() < MEAN_TOLERANCE {
            break;
        }
    }
    for (snapshot, information) in chosen.iter_mut().zip(&informations) {
        let error = difference(&snapshot.camera_from_board, &mean);
        snapshot.chi_squared = error.dot(&(information * error));
    }
    let covariance = factor.inverse();
    Ok(SecondCameraCalibration {
        camera_from_board: mean,
        covariance,
        weakness: Weakness::of(&covariance, &rig.chest_board),
        chi_squared: chosen.iter().map(|c| c.chi_squared).sum(),
        degrees_of_freedom: 6 * (chosen.len() - 1),
        snapshots: chosen,
    })
}
