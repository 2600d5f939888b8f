//! Eq. 2 of the paper: the mirror from one point b and its reflection b′, the plane half-way between them:
//! `n = (b′ − b)/|b′ − b|`, `d = n·(b + b′)/2`.

use super::board::BoardView;
use super::estimate::{Found, MirrorEstimate, MirrorEstimator, before_both, reflected_rms_px};
use super::optics::MirrorOptics;
use super::options::EstimatorOptions;
use super::planar::planar_pose;
use super::rig::Rig;
use crate::error::{Error, Result};
use crate::geometry::Plane;
use nalgebra::{Matrix3, Point3, SMatrix};

/// A plane from a point pair, with its Jacobians.
#[derive(Debug, Clone, Copy)]
pub struct PointPairPlane {
    /// The plane half-way between the two points, its normal from the point to the reflection.
    pub plane: Plane,
    /// `∂f/∂b`, unitless.
    pub foot_by_point: Matrix3<f64>,
    /// `∂f/∂b′`, unitless.
    pub foot_by_reflection: Matrix3<f64>,
}

/// The mirror between a point b and its reflection b′ (m, in the camera frame), with Jacobians of its foot point.
///
/// `w = b′ − b`, `s = (|b′|² − |b|²)/(2 |w|²)`, `f = s w`. For the plane alone call [`Plane::between`].
///
/// # Errors
/// [`Error::NoDirection`] where the points coincide.
pub fn point_pair_plane(point: &Point3<f64>, reflection: &Point3<f64>) -> Result<PointPairPlane> {
    let plane = Plane::between(point, reflection)?;
    let (b, b_reflected) = (point.coords, reflection.coords);
    let w = b_reflected - b;
    let w2 = w.norm_squared();
    let s = (b_reflected.norm_squared() - b.norm_squared()) / (2.0 * w2);
    let by_reflection = (b_reflected - w * (2.0 * s)) / w2;
    let by_point = (w * (2.0 * s) - b) / w2;
    Ok(PointPairPlane {
        plane,
        foot_by_point: w * by_point.transpose() - Matrix3::from_diagonal_element(s),
        foot_by_reflection: w * by_reflection.transpose() + Matrix3::from_diagonal_element(s),
    })
}

/// Eq. 2: b is the board's origin, b′ the origin of the reflected board's pose; its rotation is not used.
///
/// # Errors
/// As [`MirrorEstimator::estimate`].
pub(crate) fn estimate(rig: &Rig, view: &BoardView, options: &EstimatorOptions) -> Result<MirrorEstimate> {
    let pose = planar_pose(&rig.camera, view, options)?;
    let board = Point3::from(rig.camera_from_board.translation.vector);
    let reflected = Point3::from(pose.camera_from_pattern.translation.vector);
    let pair = point_pair_plane(&board, &reflected)?;
    let plane = before_both(pair.plane, rig)?;
    // δb′ = R_D v and δb = R_B v in the pose tangents: translations alone.
    let by_pose = pair.foot_by_reflection * pose.camera_from_pattern.rotation.to_rotation_matrix();
    let measurement_covariance_m2 = by_pose * pose.covariance.fixed_view::<3, 3>(3, 3) * by_pose.transpose();
    let mut foot_by_camera_from_board = SMatrix::<f64, 3, 6>::zeros();
    foot_by_camera_from_board
        .fixed_columns_mut::<3>(3)
        .copy_from(&(pair.foot_by_point * rig.camera_from_board.rotation.to_rotation_matrix()));
    let found = Found {
        plane,
        measurement_covariance_m2,
        foot_by_camera_from_board,
        optics: MirrorOptics::IDEAL,
        rms_px: reflected_rms_px(rig, view, &plane)?,
        noise_px: pose.noise_px,
    };
    if !found.measurement_covariance_m2.iter().all(|x| x.is_finite()) {
        return Err(Error::Undetermined { what: "mirror from a point pair" });
    }
    Ok(found.into_estimate(MirrorEstimator::PointPair, rig))
}
