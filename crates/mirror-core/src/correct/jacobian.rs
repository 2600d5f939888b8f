//! The Jacobian of all markers: at the reference posture, at the command, or updated during the correction
//! (Broyden).

use crate::error::{Error, Result};
use crate::robot::Robot;
use nalgebra::{DMatrix, Matrix3xX, Point3};

/// The Jacobian with which a correction computes its steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum JacobianSource {
    /// At the reference posture, once (the paper's).
    #[default]
    Reference,
    /// At the present command, computed again for each step.
    Current,
    /// Starts at the reference posture and is corrected by what each step did ([`broyden_update`]).
    Broyden,
}

/// J of the markers' centres in the frame of `frame_link` at the posture `q`: 3M×N, m/rad (m/m for prismatic joints).
///
/// Rows x, y, z of marker after marker, one column for each entry of `q`.
///
/// # Errors
/// A posture of the wrong length or not finite, an index that is no link, a matrix of the wrong size.
pub fn marker_jacobian(
    robot: &Robot,
    q: &[f64],
    frame_link: usize,
    marker_links: &[usize],
    jacobian: &mut DMatrix<f64>,
) -> Result<()> {
    if jacobian.shape() != (3 * marker_links.len(), robot.position_count()) {
        return Err(Error::LengthMismatch {
            what: "elements of the markers' Jacobian".to_owned(),
            got: jacobian.len(),
            needed: 3 * marker_links.len() * robot.position_count(),
        });
    }
    let poses = robot.poses(q)?;
    let mut one = Matrix3xX::zeros(robot.position_count());
    for (m, &link) in marker_links.iter().enumerate() {
        robot.point_jacobian(&poses, frame_link, link, &Point3::origin(), &mut one)?;
        jacobian.rows_mut(3 * m, 3).copy_from(&one);
    }
    Ok(())
}

/// How wrong the entries of the model's J are taken to be before anything is seen: a part of the marker's lever, m/rad.
const JACOBIAN_STD_M_PER_RAD: f64 = 0.02;

/// Broyden's rank-one update, weighted by the share of noise in the observation: `J ← J + κ (Δp − J Δθ) Δθᵀ / Δθᵀ
/// Δθ`.
///
/// `κ = σ_J² ‖Δθ‖² / (σ_J² ‖Δθ‖² + s²)` with s the deviation of Δp (m, one axis): a step that moved the markers
/// less than the noise gives no information. `moved_m` has 3M numbers, `change` N. (C. G. Broyden, 1965; κ is the
/// gain of a Kalman filter on J's entries.)
pub fn broyden_update(jacobian: &mut DMatrix<f64>, change: &[f64], moved_m: &[f64], noise_m: f64) {
    let square: f64 = change.iter().map(|x| x * x).sum();
    if square == 0.0 || jacobian.ncols() != change.len() || jacobian.nrows() != moved_m.len() {
        return;
    }
    let seen = JACOBIAN_STD_M_PER_RAD.powi(2) * square;
    let weight = seen / (seen + noise_m * noise_m) / square;
    for i in 0..moved_m.len() {
        let expected: f64 = (0..change.len()).map(|j| jacobian[(i, j)] * change[j]).sum();
        let miss = (moved_m[i] - expected) * weight;
        for (j, turn) in change.iter().enumerate() {
            jacobian[(i, j)] += miss * turn;
        }
    }
}
