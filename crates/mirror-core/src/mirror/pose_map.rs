//! Eq. 1 of the paper: the mirror from the pose of the reflected board, unchanged or projected to the nearest
//! reflection.
//!
//! `C_T_C′ = C_T_D · diag(1, 1, −1) · C_T_B⁻¹`: C the camera, C′ the virtual camera, B the board, D the right-handed
//! frame of the reflected board.

use super::board::BoardView;
use super::estimate::{Found, MirrorEstimate, MirrorEstimator, before_both, reflected_rms_px};
use super::optics::MirrorOptics;
use super::options::EstimatorOptions;
use super::planar::{PlanarPose, planar_pose};
use super::rig::Rig;
use super::virtual_camera::ImproperEstimate;
use crate::error::{Error, Result};
use crate::geometry::rotation::hat;
use crate::geometry::{ImproperIsometry, Plane};
use nalgebra::{Isometry3, Matrix3, Matrix6, SMatrix, Vector3};

/// The adjoint of a rigid motion in the pose tangent: `C ∘ (Exp ω, v) ∘ C⁻¹ ≈ (Exp R ω, R v + t × R ω)`.
fn adjoint(pose: &Isometry3<f64>) -> Matrix6<f64> {
    let rotation = pose.rotation.to_rotation_matrix().into_inner();
    let mut m = Matrix6::zeros();
    m.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
    m.fixed_view_mut::<3, 3>(3, 3).copy_from(&rotation);
    m.fixed_view_mut::<3, 3>(3, 0).copy_from(&(hat(&pose.translation.vector) * rotation));
    m
}

/// Eq. 1 with its covariance: `C_T_C′ = C_T_D · diag(1, 1, −1) · C_T_B⁻¹`.
///
/// Errors are carried through the chain: an error ε of the reflected board's pose becomes `Ad(C_T_B) Z ε`, with
/// `Z = diag(−1, −1, 1, 1, 1, −1)` (a rotation vector is an axial vector), one of the camera–board transform `−Ad(C_T_B) ε`.
fn improper(rig: &Rig, pose: &PlanarPose) -> ImproperEstimate {
    let camera_from_reflected_board = ImproperIsometry::with_z_reversed(&pose.camera_from_pattern);
    let map = camera_from_reflected_board.after_isometry(&rig.camera_from_board.inverse());
    let adjoint = adjoint(&rig.camera_from_board);
    let mut by_pose = adjoint;
    for column in [0, 1, 5] {
        by_pose.column_mut(column).neg_mut();
    }
    ImproperEstimate {
        map,
        measurement_covariance: by_pose * pose.covariance * by_pose.transpose(),
        by_camera_from_board: -adjoint,
    }
}

/// The foot point of the nearest reflection's plane and its Jacobian (3×6) by the map's tangent.
///
/// `n` is the eigenvector of `S = (L + Lᵀ)/2` to its smallest eigenvalue, `f = (n·t/2) n`. First order:
/// `δn = Σ_k v_k v_kᵀ δS n/(λ_n − λ_k)`, with `δL = L ω̂` and `δt = L v`.
fn snapped(map: &ImproperIsometry) -> Result<(Plane, SMatrix<f64, 3, 6>)> {
    let plane = *map.nearest_reflection()?.plane();
    let n = plane.normal().into_inner();
    let linear = map.linear();
    let symmetric = (linear + linear.transpose()) * 0.5;
    let eigen = symmetric.symmetric_eigen();
    let smallest = eigen.eigenvalues.imin();
    let mut spread = Matrix3::zeros();
    for k in (0..3).filter(|&k| k != smallest) {
        let v: Vector3<f64> = eigen.eigenvectors.column(k).into_owned();
        spread += v * v.transpose() / (eigen.eigenvalues[smallest] - eigen.eigenvalues[k]);
    }
    // 2 δS n = L ω̂ n + (L ω̂)ᵀ n = −L n̂ ω + (Lᵀ n)^ ω, since (L ω̂)ᵀ n = −ω̂ Lᵀ n.
    let by_omega = spread * (hat(&(linear.transpose() * n)) - linear * hat(&n)) * 0.5;
    let d = plane.offset_m();
    let half_translation = map.translation() * 0.5;
    // f = (n·t/2) n.
    let by_normal = Matrix3::from_diagonal_element(d) + n * half_translation.transpose();
    let mut jacobian = SMatrix::<f64, 3, 6>::zeros();
    jacobian.fixed_columns_mut::<3>(0).copy_from(&(by_normal * by_omega));
    jacobian.fixed_columns_mut::<3>(3).copy_from(&(n * n.transpose() * linear * 0.5));
    Ok((plane, jacobian))
}

fn found(rig: &Rig, pose: &PlanarPose, improper: &ImproperEstimate) -> Result<Found> {
    let (plane, by_map) = snapped(&improper.map)?;
    let covariance = by_map * improper.measurement_covariance * by_map.transpose();
    if !covariance.iter().all(|x| x.is_finite()) {
        return Err(Error::Undetermined { what: "mirror from the reflected board's pose" });
    }
    Ok(Found {
        plane: before_both(plane, rig)?,
        measurement_covariance_m2: covariance,
        foot_by_camera_from_board: by_map * improper.by_camera_from_board,
        optics: MirrorOptics::IDEAL,
        rms_px: pose.rms_px,
        noise_px: pose.noise_px,
    })
}

/// Eq. 1 as the paper has it.
///
/// # Errors
/// As [`MirrorEstimator::estimate`].
pub(crate) fn estimate(rig: &Rig, view: &BoardView, options: &EstimatorOptions) -> Result<MirrorEstimate> {
    let pose = planar_pose(&rig.camera, view, options)?;
    let improper = improper(rig, &pose);
    let found = found(rig, &pose, &improper)?;
    Ok(MirrorEstimate { improper: Some(improper), ..found.into_estimate(MirrorEstimator::Pose, rig) })
}

/// Eq. 1 snapped to the nearest reflection.
///
/// # Errors
/// As [`MirrorEstimator::estimate`].
pub(crate) fn estimate_snapped(
    rig: &Rig,
    view: &BoardView,
    options: &EstimatorOptions,
) -> Result<MirrorEstimate> {
    let pose = planar_pose(&rig.camera, view, options)?;
    let mut found = found(rig, &pose, &improper(rig, &pose))?;
    found.rms_px = reflected_rms_px(rig, view, &found.plane)?;
    Ok(found.into_estimate(MirrorEstimator::PoseSnapped, rig))
}
