//! The unknown frame of measured points beside a joint whose positions are unknown: both are estimated together.
//!
//! Unknowns are the robot's root in the frame (6), the shifts of markers on unknown mounts (3 each), and a position in each
//! posture, q_p. Gauss–Newton with weights `1 / (1 + (r/s)²)`, damped (Levenberg, Marquardt); as each observation has one
//! position, positions are eliminated posture by posture:
//!
//! ```text
//! (A − Σ v_p v_pᵀ / u_p) x = a − Σ v_p b_p / u_p,    y_p = (b_p − v_pᵀ x) / u_p
//! ```
//!
//! with A, a the normal equations of frame and shifts, u_p, b_p those of the position, v_p what couples both.
//!
//! It starts from the frames that fit best with the column as it is, and with the joint at one of a few constant positions: a column that
//! says nothing would turn the frame. What the frame and the positions share (a turn about the axis of a chain's first
//! joint) is left to the damping here, and to the positions' prior later.

use super::alternatives::Session;
use super::chain::FRAMES;
use super::freed::Free;
use super::placed::{Placed, PointSeen};
use super::variant::Variant;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::{FEWEST_OBSERVATIONS, Size};
use crate::error::Result;
use crate::least_squares::{Damping, LeastSquares, Stop, descend};
use nalgebra::{DMatrix, DVector, Vector3, Vector6};

/// Constant positions of the joint from which the frame starts.
const STARTS: Size = 6;
/// Postures on which the starts are compared.
const FEW_POSTURES: Size = 2 * FEWEST_OBSERVATIONS;

impl Session<'_> {
    /// A column whose positions in some rows are those that fit best. Measured in an unknown frame, rows with the column as
    /// it is determine that frame, or it is estimated together with the positions where there are none.
    pub fn freed_in(&self, variant: &Variant, free: &Free<'_>) -> Variant {
        if self.problem.unknown_frame.is_none() {
            return self.freed_at(variant, free, None);
        }
        let is_free = |f: &usize| free.rows.binary_search(f).is_ok();
        let others: Vec<usize> = (0..self.problem.frames.len()).filter(|f| !is_free(f)).collect();
        let placed = if others.is_empty() {
            self.placed_beside(variant, free)
        } else {
            self.misfit.placed(variant, &others)
        };
        self.freed_at(variant, free, placed.as_ref())
    }

    /// The frame beside the free positions, from the best of several starts.
    fn placed_beside(&self, variant: &Variant, free: &Free<'_>) -> Option<Placed> {
        let shown = free.postures(self);
        let part = |count: usize| {
            let every = shown.len().div_ceil(count).max(1);
            shown.iter().step_by(every).flat_map(|p| p.1.iter().copied()).collect::<Vec<usize>>()
        };
        let (few, more) = (part(FEW_POSTURES), part(FRAMES));
        let (on_few, on_more) = (Free { shown: &few, ..*free }, Free { shown: &more, ..*free });
        let (low, high) = free.bounds;
        let constants = (0..STARTS).map(|k| low + (high - low) * k as f64 / STARTS as f64);
        let held = constants.map(|q| {
            let mut held = variant.clone();
            held.positions.iter_mut().for_each(|row| row[free.joint] = q);
            held
        });
        let starts = core::iter::once(variant.clone()).chain(held);
        let settled = starts.filter_map(|start| {
            let placed = self.misfit.placed(&start, &few)?;
            Some(self.settled(self.freed_at(variant, &on_few, Some(&placed)), &on_few, placed))
        });
        let (_, placed) = settled.min_by(|a, b| a.0.total_cmp(&b.0))?;
        Some(self.settled(self.freed_at(variant, &on_more, Some(&placed)), &on_more, placed).1)
    }

    /// Frame and positions from a start on: the loss, and the frame.
    fn settled(&self, variant: Variant, free: &Free<'_>, placed: Placed) -> (f64, Placed) {
        let together = Together { session: self, joint: free.joint, postures: free.postures(self) };
        let places = [System::default(), System::default()];
        let stop = Stop { steps: 2 * SOLVER.final_steps, decrease: 0.0, share: SOLVER.last_gain };
        match descend(&together, (variant, placed.clone()), places, stop) {
            Ok(found) => (found.cost, found.state.1),
            // Nothing determines them: as good as nothing.
            Err(_) => (f64::INFINITY, placed),
        }
    }

    /// The points of each posture.
    fn seen(&self, variant: &Variant, postures: &[(Vec<usize>, Vec<usize>)]) -> Vec<Vec<PointSeen>> {
        postures.iter().map(|(_, shown)| self.misfit.points(variant, shown)).collect()
    }

    fn move_by(
        &self,
        variant: &mut Variant,
        joint: usize,
        postures: &[(Vec<usize>, Vec<usize>)],
        by: impl Fn(usize) -> f64,
    ) {
        for (p, (_, shown)) in postures.iter().enumerate() {
            shown.iter().for_each(|&f| variant.positions[f][joint] += by(p));
        }
    }
}

/// The frame and a joint's positions as functions of the points.
struct Together<'a, 'b> {
    session: &'a Session<'b>,
    joint: usize,
    /// By posture the rows in which the position is free, and those that show it.
    postures: Vec<(Vec<usize>, Vec<usize>)>,
}

impl LeastSquares for Together<'_, '_> {
    type State = (Variant, Placed);
    type Equations = System;
    type Step = Step;
    const WHAT: &'static str = "unknown frame beside a joint";
    /// A turn about the axis of a chain's first joint and its positions are one.
    const DAMPING: Damping = Damping { least: 1e-4, first: 1e-3, rise: 10.0, fall: 10.0 };
    const LAST_STEP_UNSEEN: bool = false;

    fn evaluate(&self, (variant, placed): &Self::State, system: &mut System) -> Result<f64> {
        let misfit = &self.session.misfit;
        let seen = self.session.seen(variant, &self.postures);
        let mut nearby = variant.clone();
        self.session.move_by(&mut nearby, self.joint, &self.postures, |_| SOLVER.difference);
        let moved = self.session.seen(&nearby, &self.postures);
        *system = System::at(&seen, &moved, placed, &self.session.problem.scene.mount_known, misfit.usual_m);
        Ok(seen.iter().flatten().map(|p| misfit.loss(placed.distance(p))).sum())
    }

    fn step(&self, state: &Self::State, system: &System, damping: f64) -> Result<Option<(Step, f64)>> {
        // The loss is in units of the usual error.
        let share = self.session.misfit.usual_m.powi(-2);
        Ok(system.step(&state.1, damping).map(|(step, decrease)| (step, share * decrease)))
    }

    fn moved(&self, state: &Self::State, (placed, by): &Step) -> Result<Self::State> {
        let mut variant = state.0.clone();
        self.session.move_by(&mut variant, self.joint, &self.postures, |p| by[p]);
        Ok((variant, placed.clone()))
    }
}

/// The next frame, and by how much each posture's position moves.
type Step = (Placed, Vec<f64>);

/// The weighted normal equations, positions by posture.
#[derive(Default)]
struct System {
    a: DMatrix<f64>,
    b: DVector<f64>,
    /// `u_p`, `b_p` and `v_p`.
    positions: Vec<(f64, f64, DVector<f64>)>,
    /// About which the frame turns, in the measured frame.
    center: Vector3<f64>,
    /// Markers on unknown mounts.
    free: Vec<usize>,
}

impl System {
    fn at(
        seen: &[Vec<PointSeen>],
        moved: &[Vec<PointSeen>],
        placed: &Placed,
        known: &[bool],
        usual_m: f64,
    ) -> Self {
        let free: Vec<usize> = (0..known.len()).filter(|&m| !known[m]).collect();
        let size = 6 + 3 * free.len();
        let center = placed.center(seen.iter().flatten());
        let (mut a, mut b) = (DMatrix::zeros(size, size), DVector::zeros(size));
        let mut positions = Vec::new();
        for (seen, moved) in seen.iter().zip(moved) {
            let (mut u, mut of_position, mut v) = (0.0, 0.0, DVector::zeros(size));
            for (p, nearby) in seen.iter().zip(moved) {
                let r = placed.residual(p);
                let weight = 1.0 / (1.0 + (r.norm() / usual_m).powi(2));
                let by_position = (r - placed.residual(nearby)) / SOLVER.difference;
                let (by_pose, by_shift) = placed.jacobians(p, &center);
                let mut x = DMatrix::zeros(3, size);
                x.columns_mut(0, 6).copy_from(&by_pose);
                if let Some(i) = free.iter().position(|&m| m == p.marker) {
                    x.columns_mut(6 + 3 * i, 3).copy_from(&by_shift);
                }
                a += x.tr_mul(&x) * weight;
                b += x.tr_mul(&r) * weight;
                v += x.tr_mul(&by_position) * weight;
                u += by_position.norm_squared() * weight;
                of_position += by_position.dot(&r) * weight;
            }
            positions.push((u, of_position, v));
        }
        Self { a, b, positions, center, free }
    }

    /// A damped step, and by how much it lowers the sum of squares.
    fn step(&self, placed: &Placed, damping: f64) -> Option<(Step, f64)> {
        let (mut a, mut b) = (self.a.clone(), self.b.clone());
        let least = f64::EPSILON * a.diagonal().max();
        for i in 0..a.nrows() {
            a[(i, i)] += damping * a[(i, i)] + least;
        }
        let damped = |u: f64| u * (1.0 + damping) + least;
        for (u, of_position, v) in &self.positions {
            a.ger(-1.0 / damped(*u), v, v, 1.0);
            b.axpy(-of_position / damped(*u), v, 1.0);
        }
        let x = a.cholesky()?.solve(&b);
        let by: Vec<f64> =
            self.positions.iter().map(|(u, of_position, v)| (of_position - v.dot(&x)) / damped(*u)).collect();
        let of_positions: f64 = self.positions.iter().zip(&by).map(|(p, by)| p.1 * by).sum();
        let decrease = self.b.dot(&x) + of_positions;
        let mut next = placed.turned(&Vector6::from_fn(|k, _| x[k]), &self.center);
        for (i, &m) in self.free.iter().enumerate() {
            next.shifts[m] += Vector3::new(x[6 + 3 * i], x[7 + 3 * i], x[8 + 3 * i]);
        }
        Some(((next, by), decrease))
    }
}
