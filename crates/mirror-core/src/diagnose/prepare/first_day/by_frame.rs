//! What each frame says of a displaced place: the normal equations of a marker's, the board's or the camera's pose, or
//! of a joint's zero, with the frame's mirror projected out and far rows weighted down.

use crate::diagnose::likelihood::normal_equations::{changes_sight, inner};
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::frame::{FrameWork, PROJECTED, Task};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::model::slips::Slipped;
use crate::diagnose::principles::{FAR_DEVIATIONS, Threshold};
use crate::error::Result;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Vector6};
use rayon::prelude::*;

/// A row farther off than so many deviations counts less: false data must not pass for a slip.
const FAR: Threshold = 10.0 * FAR_DEVIATIONS;

/// A change from a row on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum What {
    Slips(Slipped),
    /// A joint's zero.
    Zero(NodeId),
}

/// One place's normal equations, frame by frame.
pub(super) struct Place {
    pub what: What,
    pub frames: Vec<Sums>,
}

/// Each marker by its shift.
pub(super) fn markers(problem: &Problem, deformation: &Deformation, noise: Noise) -> Result<Vec<Place>> {
    let eye = problem.eye(deformation)?;
    let task = Task::of_residuals(problem, deformation, eye.as_ref(), noise);
    let markers = problem.marker_sites.len();
    let frames: Vec<Vec<Sums>> = (0..problem.frames.len())
        .into_par_iter()
        .map_init(
            || FrameWork::new(problem),
            |work, frame| {
                let mut out = vec![(DMatrix::zeros(3, 3), DVector::zeros(3)); markers];
                if !work.evaluate(problem, &task, frame) {
                    return out;
                }
                let rows = work.row_count;
                let mut columns = vec![vec![0.0; rows + PROJECTED]; 3];
                for (m, (h, g)) in out.iter_mut().enumerate() {
                    let mut there = false;
                    for (k, column) in columns.iter_mut().enumerate() {
                        there |= work.column(problem, deformation, Atom::MarkerShift(m, k), column);
                    }
                    if !there {
                        continue;
                    }
                    let own: f64 = (0..rows)
                        .filter(|&i| columns.iter().any(|c| c[i] != 0.0))
                        .map(|i| work.residual[i].powi(2))
                        .sum();
                    let weight = 1.0 / (1.0 + own / (FAR * FAR));
                    for i in 0..3 {
                        g[i] = weight * inner(&columns[i], &work.residual);
                        for j in 0..3 {
                            h[(i, j)] = weight * inner(&columns[i], &columns[j]);
                        }
                    }
                }
                out
            },
        )
        .collect();
    let of = |m: usize| Place {
        what: What::Slips(Slipped::Marker(m)),
        frames: frames.iter().map(|f| f[m].clone()).collect(),
    };
    Ok((0..markers).map(of).collect())
}

/// Zeros of the joints that move what is seen.
pub(super) fn zeros(
    problem: &Problem,
    deformation: &Deformation,
    noise: Noise,
    joints: &[NodeId],
) -> Result<Vec<Place>> {
    let eye = problem.eye(deformation)?;
    let columns: Vec<Column> = joints.iter().map(|&n| Column::constant(Atom::Joint(n))).collect();
    let with_board = changes_sight(problem, &columns);
    let task = Task { with_board, ..Task::of_residuals(problem, deformation, eye.as_ref(), noise) };
    let mut of_joints = vec![Vec::with_capacity(problem.frames.len()); joints.len()];
    let (mut work, mut column) = (FrameWork::new(problem), Vec::new());
    for frame in 0..problem.frames.len() {
        let seen = work.evaluate(problem, &task, frame);
        let rows = work.row_count;
        column.resize(rows + PROJECTED, 0.0);
        for (frames, &n) in of_joints.iter_mut().zip(joints) {
            let (mut h, mut g) = (DMatrix::zeros(1, 1), DVector::zeros(1));
            if seen && work.column(problem, deformation, Atom::Joint(n), &mut column) {
                let own = (0..rows).filter(|&i| column[i] != 0.0).map(|i| work.residual[i].powi(2));
                let weight = 1.0 / (1.0 + own.sum::<f64>() / (FAR * FAR));
                h[(0, 0)] = weight * inner(&column, &column);
                g[0] = weight * inner(&column, &work.residual);
            }
            frames.push((h, g));
        }
    }
    Ok(joints.iter().zip(of_joints).map(|(&n, frames)| Place { what: What::Zero(n), frames }).collect())
}

/// What slips as a whole, each frame's mirror moving along.
pub(super) fn moved(
    problem: &Problem,
    deformation: &Deformation,
    noise: Noise,
    what: Slipped,
) -> Result<Place> {
    let eye = problem.eye(deformation)?;
    let task = Task { with_board: true, ..Task::of_residuals(problem, deformation, eye.as_ref(), noise) };
    let frames = (0..problem.frames.len())
        .into_par_iter()
        .map_init(
            || FrameWork::new(problem),
            |work, frame| {
                let (mut h, mut g) = (DMatrix::zeros(6, 6), DVector::zeros(6));
                if !work.evaluate(problem, &task, frame) {
                    return (h, g);
                }
                let rows = work.row_count;
                let mut columns = vec![vec![0.0; rows + PROJECTED]; 6];
                for (k, column) in columns.iter_mut().enumerate() {
                    work.column_of_slip(problem, deformation, what, k, column);
                }
                let square: f64 = work.residual[..rows].iter().map(|r| r * r).sum();
                let weight = 1.0 / (1.0 + square / (rows as f64 * FAR * FAR));
                for i in 0..6 {
                    g[i] = weight * inner(&columns[i], &work.residual);
                    for j in 0..6 {
                        h[(i, j)] = weight * inner(&columns[i], &columns[j]);
                    }
                }
                (h, g)
            },
        )
        .collect();
    Ok(Place { what: What::Slips(what), frames })
}

/// Sums of a place's normal equations: `H = XᵀX`, `g = Xᵀr`.
pub(super) type Sums = (DMatrix<f64>, DVector<f64>);

/// A constant displacement of a place over all rows, beside which further ones are compared.
pub(super) struct Constant {
    factor: Cholesky<f64, Dyn>,
    displacement: DVector<f64>,
    ridge: DMatrix<f64>,
}

impl Constant {
    pub fn of((h, g): &Sums) -> Option<Self> {
        let count = g.len();
        let ridge = DMatrix::identity(count, count) * (1e-9 * h.trace().max(1e-12));
        let factor = (h + &ridge).cholesky()?;
        Some(Self { displacement: factor.solve(g), factor, ridge })
    }

    /// The gain of a displacement over some rows, from the sums over these: `eᵀ S⁻¹ e`, `e = g_b − H_b H⁻¹ g`,
    /// `S = H_b − H_b H⁻¹ H_b`.
    pub fn gain(&self, (h_over, g_over): &Sums) -> Option<Gain> {
        let e = g_over - h_over * &self.displacement;
        let s = h_over - h_over * self.factor.solve(h_over) + &self.ridge;
        let factor = s.cholesky()?;
        let displacement = factor.solve(&e);
        let gain = e.dot(&displacement);
        gain.is_finite().then_some(Gain { gain, displacement, factor })
    }
}

/// What a displacement of a place over some rows gains, with the displacement.
pub(super) struct Gain {
    pub gain: f64,
    displacement: DVector<f64>,
    factor: Cholesky<f64, Dyn>,
}

impl Gain {
    /// The displacement as a motion, and its standard deviations.
    pub fn motion(&self) -> (Vector6<f64>, Vector6<f64>) {
        let covariance = self.factor.inverse();
        let (mut motion, mut std) = (Vector6::zeros(), Vector6::zeros());
        // A marker has a shift only.
        let from = motion.len() - self.displacement.len();
        for (i, value) in self.displacement.iter().enumerate() {
            motion[from + i] = *value;
            std[from + i] = covariance[(i, i)].max(0.0).sqrt();
        }
        (motion, std)
    }
}
