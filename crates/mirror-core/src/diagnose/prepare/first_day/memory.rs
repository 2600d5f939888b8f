//! What the diagnoses of one session share: results of earlier preparations, and the budget of work. After the same
//! mistakes are undone the session is the same, and each stage gives the same result.

use super::mistake::{Changes, Mistake};
use super::outlying::False;
use crate::diagnose::model::work_budget::WorkBudget;
use crate::error::Result;

/// Results of one stage, by the mistakes that were undone before it.
struct Known<T>(Vec<(Vec<Mistake>, T)>);

impl<T> Default for Known<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T: Clone> Known<T> {
    fn remembered(&mut self, undone: &[Mistake], find: impl FnOnce() -> Result<T>) -> Result<T> {
        if let Some((_, known)) = self.0.iter().find(|(of, _)| of == undone) {
            return Ok(known.clone());
        }
        let found = find()?;
        self.0.push((undone.to_vec(), found.clone()));
        Ok(found)
    }
}

/// A mistake with its log odds, if one was found.
type Found = Option<(Mistake, f64)>;

/// Results of the stages that depend only on the session and on the mistakes undone before, and the work so far.
#[derive(Default)]
pub(crate) struct Memory {
    explained: Known<bool>,
    stepped: Known<bool>,
    gravity: Known<Found>,
    /// Without and with changes of joints' zeros.
    slips: [Known<Changes>; 2],
    outlying: Known<Vec<Vec<False>>>,
    budget: Option<WorkBudget>,
}

impl Memory {
    /// The budget of the next diagnosis; `own`: that of a session's first.
    pub(crate) fn next_budget(&mut self, own: &WorkBudget) -> WorkBudget {
        let next = self.budget.as_ref().map_or_else(|| own.clone(), WorkBudget::again);
        self.budget = Some(next.clone());
        next
    }

    /// Whether a single cause explains everything.
    pub(super) fn explained(
        &mut self,
        undone: &[Mistake],
        find: impl FnOnce() -> Result<bool>,
    ) -> Result<bool> {
        self.explained.remembered(undone, find)
    }

    /// Whether a zero that changes once explains it better.
    pub(super) fn stepped(
        &mut self,
        undone: &[Mistake],
        find: impl FnOnce() -> Result<bool>,
    ) -> Result<bool> {
        self.stepped.remembered(undone, find)
    }

    /// Gravity in another direction.
    pub(super) fn gravity(
        &mut self,
        undone: &[Mistake],
        find: impl FnOnce() -> Result<Found>,
    ) -> Result<Found> {
        self.gravity.remembered(undone, find)
    }

    /// A slip, or with `zeros` a change of a joint's zero, and the way back.
    pub(super) fn slip(
        &mut self,
        undone: &[Mistake],
        zeros: bool,
        find: impl FnOnce() -> Result<Changes>,
    ) -> Result<Changes> {
        self.slips[usize::from(zeros)].remembered(undone, find)
    }

    /// False observations.
    pub(super) fn outlying(
        &mut self,
        undone: &[Mistake],
        find: impl FnOnce() -> Result<Vec<Vec<False>>>,
    ) -> Result<Vec<Vec<False>>> {
        self.outlying.remembered(undone, find)
    }
}
