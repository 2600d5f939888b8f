//! The normal equations of a session, and their solution by eliminating planes, then points.
//!
//! Unknowns: six of the camera–board transform (s), three of each frame's plane (f), three of each marker of a posture
//! (p). A plane meets only its own frame, a point only the frames of its posture. So the planes go first (3×3 each),
//! then each posture's points (dense, a few dozen), and 6×6 is left: the work is linear in the frames.

use crate::least_squares::scaled_inverse;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix3, Matrix3x6, Matrix6, Vector3, Vector6};

/// The contribution of one frame: its Gauss–Newton matrix and gradient, in units of variance.
#[derive(Clone)]
pub(super) struct FrameTerms {
    pub cost: f64,
    /// Squared residuals in px², corners and markers, unweighted.
    pub corner_px2: f64,
    pub marker_px2: f64,
    pub plane: Matrix3<f64>,
    pub plane_by_shared: Matrix3x6<f64>,
    pub shared: Matrix6<f64>,
    pub plane_gradient: Vector3<f64>,
    pub shared_gradient: Vector6<f64>,
    pub points: Vec<PointTerms>,
}

/// The contribution of one sighting of a marker.
#[derive(Clone)]
pub(super) struct PointTerms {
    /// Place of the point in its posture.
    pub slot: usize,
    /// Plane (rows) by point (columns).
    pub plane_by_point: Matrix3<f64>,
    pub point: Matrix3<f64>,
    pub gradient: Vector3<f64>,
}

impl FrameTerms {
    pub fn zero() -> Self {
        Self {
            cost: 0.0,
            corner_px2: 0.0,
            marker_px2: 0.0,
            plane: Matrix3::zeros(),
            plane_by_shared: Matrix3x6::zeros(),
            shared: Matrix6::zeros(),
            plane_gradient: Vector3::zeros(),
            shared_gradient: Vector6::zeros(),
            points: Vec::new(),
        }
    }

    /// Empties it, its memory kept.
    pub fn clear(&mut self) {
        let mut points = std::mem::take(&mut self.points);
        points.clear();
        *self = Self { points, ..Self::zero() };
    }
}

/// A posture whose planes and points are eliminated: what its unknowns are as functions of s.
struct Eliminated {
    /// Inverse of each frame's plane matrix.
    planes: Vec<Matrix3<f64>>,
    points: Option<Cholesky<f64, Dyn>>,
    /// Points by s after elimination of the planes (3M × 6).
    points_by_shared: DMatrix<f64>,
    points_gradient: DVector<f64>,
}

/// The solved equations: a step, or with no damping the covariance of everything.
pub(super) struct Solution {
    eliminated: Vec<Eliminated>,
    /// Inverse of the reduced matrix of s; zero where s is held.
    pub shared_inverse: Matrix6<f64>,
    pub shared_step: Vector6<f64>,
}

/// A step of all unknowns.
pub(super) struct Step {
    pub shared: Vector6<f64>,
    pub planes: Vec<Vector3<f64>>,
    /// By posture and slot.
    pub points: Vec<Vec<Vector3<f64>>>,
}

/// The prior's share of the normal equations of s; `None` fixes s.
pub(super) struct SharedTerms {
    pub information: Matrix6<f64>,
    pub gradient: Vector6<f64>,
}

/// Raises the diagonal by Levenberg–Marquardt's factor.
fn damped3(matrix: &Matrix3<f64>, damping: f64) -> Matrix3<f64> {
    let mut m = *matrix;
    for i in 0..3 {
        m[(i, i)] *= 1.0 + damping;
    }
    m
}

fn inverse3(matrix: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    Some(matrix.cholesky()?.inverse())
}

/// Eliminates and solves; nothing where some unknown is not determined.
pub(super) fn solve(
    frames: &[FrameTerms],
    frames_of: &[Vec<usize>],
    points_of: &[usize],
    prior: Option<&SharedTerms>,
    damping: f64,
) -> Option<Solution> {
    let mut reduced = Matrix6::zeros();
    let mut gradient = Vector6::zeros();
    let mut diagonal = Vector6::zeros();
    if let Some(prior) = prior {
        reduced = prior.information;
        gradient = prior.gradient;
        diagonal = prior.information.diagonal();
    }
    let mut eliminated = Vec::with_capacity(frames_of.len());
    for (members, &count) in frames_of.iter().zip(points_of) {
        let mut points = DMatrix::<f64>::zeros(3 * count, 3 * count);
        let mut by_shared = DMatrix::<f64>::zeros(3 * count, 6);
        let mut points_gradient = DVector::<f64>::zeros(3 * count);
        let mut planes = Vec::with_capacity(members.len());
        for &member in members {
            let frame = &frames[member];
            let inverse = inverse3(&damped3(&frame.plane, damping))?;
            let to_shared = inverse * frame.plane_by_shared;
            let to_gradient = inverse * frame.plane_gradient;
            diagonal += frame.shared.diagonal();
            reduced += frame.shared - frame.plane_by_shared.transpose() * to_shared;
            gradient += frame.shared_gradient - frame.plane_by_shared.transpose() * to_gradient;
            for a in &frame.points {
                let rows = 3 * a.slot;
                let mut own = points.fixed_view_mut::<3, 3>(rows, rows);
                own += damped3(&a.point, damping);
                let mut cross = by_shared.fixed_view_mut::<3, 6>(rows, 0);
                cross -= a.plane_by_point.transpose() * to_shared;
                let mut slope = points_gradient.fixed_rows_mut::<3>(rows);
                slope += a.gradient - a.plane_by_point.transpose() * to_gradient;
                for b in &frame.points {
                    let mut pair = points.fixed_view_mut::<3, 3>(rows, 3 * b.slot);
                    pair -= a.plane_by_point.transpose() * inverse * b.plane_by_point;
                }
            }
            planes.push(inverse);
        }
        let factor = if count > 0 { Some(points.cholesky()?) } else { None };
        if let Some(factor) = &factor {
            let solved = factor.solve(&by_shared);
            reduced -= Matrix6::from_fn(|i, j| by_shared.column(i).dot(&solved.column(j)));
            gradient -= Vector6::from_fn(|i, _| solved.column(i).dot(&points_gradient));
        }
        eliminated.push(Eliminated { planes, points: factor, points_by_shared: by_shared, points_gradient });
    }
    let (shared_inverse, shared_step) = if prior.is_some() {
        for i in 0..6 {
            reduced[(i, i)] += damping * diagonal[i];
        }
        let (inverse, _) = scaled_inverse(&reduced)?;
        (inverse, -(inverse * gradient))
    } else {
        (Matrix6::zeros(), Vector6::zeros())
    };
    Some(Solution { eliminated, shared_inverse, shared_step })
}

impl Solution {
    /// The step of all unknowns by back-substitution, and the decrease of the cost that it promises.
    pub fn step(
        &self,
        frames: &[FrameTerms],
        frames_of: &[Vec<usize>],
        prior: Option<&SharedTerms>,
    ) -> (Step, f64) {
        let shared = self.shared_step;
        let mut planes = vec![Vector3::zeros(); frames.len()];
        let mut points = Vec::with_capacity(frames_of.len());
        let mut decrease = -prior.map_or(0.0, |p| p.gradient.dot(&shared));
        for (members, group) in frames_of.iter().zip(&self.eliminated) {
            let steps: Vec<Vector3<f64>> = match &group.points {
                Some(factor) => {
                    let rhs = &group.points_gradient + &group.points_by_shared * shared;
                    let solved = factor.solve(&rhs);
                    (0..solved.len() / 3).map(|i| -solved.fixed_rows::<3>(3 * i).into_owned()).collect()
                }
                None => Vec::new(),
            };
            for (&member, inverse) in members.iter().zip(&group.planes) {
                let frame = &frames[member];
                let mut rhs = frame.plane_gradient + frame.plane_by_shared * shared;
                for point in &frame.points {
                    rhs += point.plane_by_point * steps[point.slot];
                    decrease -= point.gradient.dot(&steps[point.slot]);
                }
                planes[member] = -(inverse * rhs);
                decrease -= frame.plane_gradient.dot(&planes[member]) + frame.shared_gradient.dot(&shared);
            }
            points.push(steps);
        }
        (Step { shared, planes, points }, decrease)
    }

    /// Covariances (of an undamped solution): planes by frame, and points by posture and slot.
    pub fn covariances(
        &self,
        frames: &[FrameTerms],
        frames_of: &[Vec<usize>],
    ) -> (Vec<Matrix3<f64>>, Vec<Vec<Matrix3<f64>>>) {
        let mut planes = vec![Matrix3::zeros(); frames.len()];
        let mut points = Vec::with_capacity(frames_of.len());
        let shared = DMatrix::from_fn(6, 6, |i, j| self.shared_inverse[(i, j)]);
        for (members, group) in frames_of.iter().zip(&self.eliminated) {
            let count = group.points_gradient.len();
            // Covariance of (points, s) of this posture.
            let mut joint = DMatrix::<f64>::zeros(count + 6, count + 6);
            joint.view_mut((count, count), (6, 6)).copy_from(&shared);
            if let Some(factor) = &group.points {
                let gain = factor.solve(&group.points_by_shared);
                let cross = -(&gain * &shared);
                let own = factor.inverse() - &cross * gain.transpose();
                joint.view_mut((0, 0), (count, count)).copy_from(&own);
                joint.view_mut((0, count), (count, 6)).copy_from(&cross);
                joint.view_mut((count, 0), (6, count)).copy_from(&cross.transpose());
            }
            for (&member, inverse) in members.iter().zip(&group.planes) {
                let frame = &frames[member];
                let mut by = DMatrix::<f64>::zeros(3, count + 6);
                by.fixed_view_mut::<3, 6>(0, count).copy_from(&frame.plane_by_shared);
                for point in &frame.points {
                    let mut block = by.fixed_view_mut::<3, 3>(0, 3 * point.slot);
                    block += point.plane_by_point;
                }
                let by = DMatrix::from_fn(3, 3, |i, j| inverse[(i, j)]) * by;
                let spread = &by * &joint * by.transpose();
                planes[member] = inverse + Matrix3::from_fn(|i, j| spread[(i, j)]);
            }
            points
                .push((0..count / 3).map(|i| joint.fixed_view::<3, 3>(3 * i, 3 * i).into_owned()).collect());
        }
        (planes, points)
    }
}
