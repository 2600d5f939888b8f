//! How far each joint followed its commands, from all steps of a correction together.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use serde::Serialize;

/// How wide a joint's response is taken to lie about 1 before anything is seen.
const PRIOR_STD: f64 = 1.0;
/// A joint whose response lies within this of 0, [`SURE`] standard deviations included, does not follow.
const FOLLOWS: f64 = 0.5;
const SURE: f64 = 3.0;

/// How far a joint followed its commands: 1 completely, 0 not at all.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct JointResponse {
    /// The joint's name.
    pub joint: String,
    /// Part of the commanded way that it moved, all steps together.
    pub response: f64,
    /// Its standard deviation.
    pub std: f64,
    /// Sum of the commanded changes over all steps, rad (m).
    pub commanded_rad: f64,
    /// Whether it surely does not follow.
    pub stuck: bool,
}

/// A step and what came of it.
#[derive(Debug, Clone)]
pub(super) struct Move {
    pub change: Vec<f64>,
    /// The model's J at the middle of the step, 3M×N.
    pub jacobian: DMatrix<f64>,
    pub moved_m: Vec<Vector3<f64>>,
    pub covariance_m2: Vec<Matrix3<f64>>,
}

/// The responses r that minimise `Σ ‖Δp − J diag(Δθ) r‖²_Σ + ‖(r − 1) / σ‖²` over all steps; one for each joint that was moved.
///
/// J is each step's own; `names` N.
pub(super) fn responses(moves: &[Move], names: &[&str]) -> Vec<JointResponse> {
    let joints: Vec<usize> = (0..names.len()).filter(|&j| moves.iter().any(|m| m.change[j] != 0.0)).collect();
    let n = joints.len();
    let mut information = DMatrix::identity(n, n) / (PRIOR_STD * PRIOR_STD);
    let mut pull = DVector::from_element(n, 1.0 / (PRIOR_STD * PRIOR_STD));
    for one in moves {
        for (m, (moved, covariance)) in one.moved_m.iter().zip(&one.covariance_m2).enumerate() {
            let Some(weight) = covariance.try_inverse() else { continue };
            let column = |j: usize| one.jacobian.fixed_view::<3, 1>(3 * m, j).into_owned() * one.change[j];
            for (a, &j) in joints.iter().enumerate() {
                let weighted = weight * column(j);
                pull[a] += weighted.dot(moved);
                for (b, &k) in joints.iter().enumerate() {
                    information[(a, b)] += weighted.dot(&column(k));
                }
            }
        }
    }
    let Some(covariance) = information.try_inverse() else { return Vec::new() };
    let response = &covariance * pull;
    joints
        .iter()
        .enumerate()
        .map(|(a, &j)| {
            let std = covariance[(a, a)].max(0.0).sqrt();
            JointResponse {
                joint: names.get(j).copied().unwrap_or_default().to_owned(),
                response: response[a],
                std,
                commanded_rad: moves.iter().map(|m| m.change[j].abs()).sum(),
                stuck: response[a].abs() + SURE * std < FOLLOWS,
            }
        })
        .collect()
}
