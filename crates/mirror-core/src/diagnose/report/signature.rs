//! The signature of a cause: the size that the error at its place would need in each posture alone.
//!
//! One number for each posture, without any law: `δ = ⟨x, r⟩ / ⟨x, x⟩`, with x the place's column and r the residual
//! of the model without the cause. Plotted against the joint's position, its load, its direction or time, it shows
//! the law.

use crate::diagnose::likelihood::normal_equations::inner;
use crate::diagnose::likelihood::saturated::postures;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::frame::{FrameWork, PROJECTED, Task, Wanted};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::error::Result;
use rayon::prelude::*;

/// One posture's errors of several atoms, each by itself.
#[derive(Debug, Clone)]
pub(crate) struct FreeErrors {
    /// A frame of the posture.
    pub frame: usize,
    /// In the atoms' units.
    pub values: Vec<f64>,
    pub stds: Vec<f64>,
}

/// One posture's error at a place.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FreeError {
    /// A frame of the posture.
    pub frame: usize,
    /// In the unit of the atom.
    pub value: f64,
    pub std: f64,
}

/// The error of one atom in each posture that shows it, at a deformation.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn free_errors(
    problem: &Problem,
    deformation: &Deformation,
    noise: Noise,
    atom: Atom,
) -> Result<Vec<FreeError>> {
    let errors = free_errors_of(problem, deformation, noise, &[atom])?;
    Ok(errors.iter().map(|e| FreeError { frame: e.frame, value: e.values[0], std: e.stds[0] }).collect())
}

/// The error of each of several atoms, the others held, in each posture that shows all of them.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn free_errors_of(
    problem: &Problem,
    deformation: &Deformation,
    noise: Noise,
    atoms: &[Atom],
) -> Result<Vec<FreeErrors>> {
    let columns: Vec<Column> = atoms.iter().map(|&a| Column::constant(a)).collect();
    let eye = problem.eye(deformation)?;
    let with_board = crate::diagnose::likelihood::normal_equations::changes_sight(problem, &columns)
        || problem.needs_fresh_board(deformation);
    let wanted = Wanted::by(&columns);
    let task = Task { with_board, wanted, ..Task::of_residuals(problem, deformation, eye.as_ref(), noise) };
    Ok(postures(problem)
        .into_par_iter()
        .map_init(
            || (FrameWork::new(problem), Vec::new()),
            |(work, buffer): &mut (FrameWork, Vec<f64>), frames| {
                let mut sums = vec![(0.0, 0.0); atoms.len()];
                let mut at = None;
                for &frame in &frames {
                    if !work.evaluate(problem, &task, frame) {
                        continue;
                    }
                    buffer.resize(work.row_count + PROJECTED, 0.0);
                    for (atom, (h, g)) in atoms.iter().zip(&mut sums) {
                        if work.column(problem, deformation, *atom, buffer) {
                            *h += inner(buffer, buffer);
                            *g += inner(buffer, &work.residual);
                            at = at.or(Some(frame));
                        }
                    }
                }
                at.filter(|_| sums.iter().all(|(h, _)| h.is_normal() && *h > 0.0)).map(|frame| FreeErrors {
                    frame,
                    values: sums.iter().map(|(h, g)| g / h).collect(),
                    stds: sums.iter().map(|(h, _)| h.sqrt().recip()).collect(),
                })
            },
        )
        .flatten()
        .collect())
}
