//! The signature of a cause: how large the error at a place would have to be in each posture, by itself.
//!
//! One number a posture, free of any law: `δ = ⟨x, r⟩ / ⟨x, x⟩` with x the place's column and r the residual of the model
//! without the cause. Drawn against the joint's position, its load, its direction or time, it shows the law at a glance.

use super::atoms::Atom;
use super::deformation::Deformation;
use super::frame::{FrameWork, PROJECTED, Task, Wanted};
use super::normal::inner;
use super::posture::postures;
use super::problem::{Noise, Problem};
use crate::error::Result;
use rayon::prelude::*;

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
/// A camera or mirror that cannot be.
pub(crate) fn free_errors(
    problem: &Problem,
    deformation: &Deformation,
    noise: Noise,
    atom: Atom,
) -> Result<Vec<FreeError>> {
    let eye = problem.eye(deformation)?;
    let with_board = super::normal::needs_board(problem, &[super::atoms::Column::constant(atom)]);
    let task =
        Task { deformation, eye: eye.as_ref(), noise, with_board, gaussian: true, wanted: Wanted::default() };
    Ok(postures(problem)
        .into_par_iter()
        .map_init(
            || (FrameWork::new(problem), Vec::new()),
            |(work, buffer): &mut (FrameWork, Vec<f64>), frames| {
                let (mut h, mut g, mut at) = (0.0, 0.0, None);
                for &frame in &frames {
                    if !work.evaluate(problem, &task, frame) {
                        continue;
                    }
                    let stride = work.row_count + PROJECTED;
                    buffer.resize(stride, 0.0);
                    if work.column(problem, deformation, frame, atom, buffer) {
                        h += inner(buffer, buffer);
                        g += inner(buffer, &work.residual);
                        at = at.or(Some(frame));
                    }
                }
                at.filter(|_| h > 0.0).map(|frame| FreeError { frame, value: g / h, std: h.sqrt().recip() })
            },
        )
        .flatten()
        .collect())
}
