//! Play or sticking at one joint, which looks like a change of its zero in the row in which the joint turns back.
//!
//! In the same measure as change points ([`super::changes`]): at the fit with all small errors, each joint gets a constant
//! displacement a and the columns X of the effect. With the products of the joint's column with itself and with the
//! residual in each frame, `h_f` and `g_f`, and `y = (1, x)`, the gain over the constant alone is `Gᵀ H⁻¹ G − G₁²/H₁₁`,
//! `H = Σ h_f y_f y_fᵀ`, `G = Σ g_f y_f`.

use super::verify::Tolerant;
use crate::diagnose::effects::Place;
use crate::diagnose::effects::hypothesis::Term;
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::elementary::Column;
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::principles::Size;
use crate::error::Result;
use nalgebra::{DMatrix, DVector};

/// The effects that depend on the direction of motion.
const EFFECTS: [&str; 2] = ["backlash", "stiction"];
/// The columns depend on the width: they are taken once at none and once at the estimate.
const ROUNDS: Size = 2;

/// A joint and, in each frame, its `h_f` and `g_f`.
pub(super) type OfJoint = (NodeId, Vec<(f64, f64)>);

/// Play or sticking, with the gain in χ² over a constant displacement.
pub(super) struct Hysteresis {
    term: Term,
    pub gain: f64,
}

/// The play or sticking that gains most; none where none gains anything. It takes the place of the small play that the
/// fit has at its joint.
pub(super) fn likeliest(problem: &Problem, without: &Tolerant, joints: &[OfJoint]) -> Option<Hysteresis> {
    let causes = Tolerant::only(problem, &EFFECTS);
    let mut best: Option<(f64, Term)> = None;
    for (h, hypothesis) in causes.hypotheses.iter().enumerate() {
        let Place::Joint(node) = hypothesis.place else { continue };
        let Some((_, sums)) = joints.iter().find(|j| j.0 == node) else { continue };
        let small = without.small(EFFECTS[0], hypothesis.place);
        let sums = Sums::new(problem, sums, small);
        for &variant in &hypothesis.variants {
            let parameters = vec![0.0; hypothesis.prior_std.len()];
            let mut term = Term { hypothesis: h, variant, parameters, prior_scale: 1.0 };
            let mut gain = 0.0;
            for _ in 0..ROUNDS {
                let columns = causes.columns(&problem.scene, &term);
                let Some((more, estimate)) = sums.gain_of(problem, &columns) else { break };
                (gain, term.parameters) = (more, estimate);
            }
            if gain > best.as_ref().map_or(0.0, |b| b.0) {
                best = Some((gain, term));
            }
        }
    }
    best.map(|(gain, term)| Hysteresis { term, gain })
}

/// Products in each frame without the small play, and the gain that its absence and a constant are.
struct Sums {
    frames: Vec<(f64, f64)>,
    /// χ² with the fit's small play and a constant, less that without either.
    before: f64,
}

impl Sums {
    fn new(problem: &Problem, of_joint: &[(f64, f64)], small: Option<(&Column, f64)>) -> Self {
        let played = |f: usize| small.map_or(0.0, |(c, value)| value * c.weight.at(&problem.scene, f));
        let (mut h, mut g, mut taken) = (0.0, 0.0, 0.0);
        let mut frames = Vec::with_capacity(of_joint.len());
        for (f, &(of_frame, along)) in of_joint.iter().enumerate() {
            let play = played(f);
            (h, g) = (h + of_frame, g + along);
            taken += 2.0 * play * along + play * play * of_frame;
            frames.push((of_frame, along + play * of_frame));
        }
        Self { frames, before: -taken - g * g / h.max(f64::MIN_POSITIVE) }
    }

    /// The gain of an effect's columns, and its parameters; none where its width would be negative.
    fn gain_of(&self, problem: &Problem, columns: &[Column]) -> Option<(f64, Vec<f64>)> {
        let count = columns.len() + 1;
        let (mut h, mut g) = (DMatrix::zeros(count, count), DVector::zeros(count));
        for (frame, &(of_frame, along)) in self.frames.iter().enumerate() {
            let y = DVector::from_fn(count, |i, _| match i {
                0 => 1.0,
                _ => columns[i - 1].weight.at(&problem.scene, frame),
            });
            h.ger(of_frame, &y, &y, 1.0);
            g.axpy(along, &y, 1.0);
        }
        // A droop without a load has no column.
        for i in 0..count {
            h[(i, i)] += 1e-9 * h[(i, i)].max(1e-12);
        }
        let solution = h.cholesky()?.solve(&g);
        let parameters: Vec<f64> = solution.iter().skip(1).map(|p| p.max(0.0)).collect();
        (solution[1] > 0.0).then(|| (solution.dot(&g) + self.before, parameters))
    }
}

impl Hysteresis {
    /// The fit with it beside all small errors.
    ///
    /// # Errors
    /// Invalid parameters of camera or mirror.
    pub fn fitted(&self, problem: &Problem, without: &Tolerant, least: Noise) -> Result<Tolerant> {
        without.with_cause(Tolerant::only(problem, &EFFECTS), self.term.clone(), EFFECTS[0], least)
    }
}
