//! What the diagnoses of one session share: results of earlier preparations, and the budget of work. After the same
//! mistakes are undone the session is the same, and each stage gives the same result.

use super::loads::{self, Turned};
use super::mistake::{Changes, Mistake};
use super::outlying::False;
use super::single_cause::{self, Alone, Explained};
use crate::diagnose::likelihood::nominal_sums::NominalSums;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::model::work_budget::WorkBudget;
use crate::error::Result;
use std::sync::Arc;

/// Results of one stage, by the mistakes that were undone before it.
pub(super) struct Known<T>(Vec<(Vec<Mistake>, T)>);

impl<T> Default for Known<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T: Clone> Known<T> {
    /// What was found after these mistakes were undone.
    pub fn known(&self, undone: &[Mistake]) -> Option<&T> {
        self.0.iter().find(|(of, _)| of == undone).map(|(_, known)| known)
    }

    /// What `find` gives, or gave before after the same mistakes were undone.
    pub fn remembered(&mut self, undone: &[Mistake], find: impl FnOnce() -> Result<T>) -> Result<T> {
        if let Some(known) = self.known(undone) {
            return Ok(known.clone());
        }
        let found = find()?;
        self.0.push((undone.to_vec(), found.clone()));
        Ok(found)
    }
}

/// Results of the stages that depend only on the session and on the mistakes undone before, and the work so far.
#[derive(Default)]
pub(crate) struct Memory {
    /// The likeliest single cause, and whether it explains everything.
    pub(super) alone: Known<Option<Alone>>,
    pub(super) explained: Known<Explained>,
    /// Whether a zero that changes once explains it better.
    pub(super) stepped: Known<bool>,
    /// Gravity in another direction.
    pub(super) gravity: Known<Option<Turned>>,
    /// A slip and the way back, by what else may be named: changes of joints' zeros, slipped rows.
    pub(super) slips: [[Known<Changes>; 2]; 2],
    /// False observations.
    pub(super) outlying: Known<Vec<Vec<False>>>,
    budget: Option<WorkBudget>,
}

impl Memory {
    /// Whether a single cause explains everything once the mistakes found so far are undone.
    ///
    /// # Errors
    /// Invalid parameters of camera or mirror.
    pub(super) fn is_explained(&mut self, problem: &Problem, undone: &[Mistake]) -> Result<bool> {
        Ok(self.explained(problem, undone)? != Explained::Not)
    }

    /// The same, by a cause that is no part of a gross mistake.
    ///
    /// # Errors
    /// Invalid parameters of camera or mirror.
    pub(super) fn is_explained_as_usual(&mut self, problem: &Problem, undone: &[Mistake]) -> Result<bool> {
        Ok(self.explained(problem, undone)? == Explained::ByUsual)
    }

    fn explained(&mut self, problem: &Problem, undone: &[Mistake]) -> Result<Explained> {
        let alone = self.alone.remembered(undone, || single_cause::alone(problem))?;
        self.explained.remembered(undone, || single_cause::explained(problem, alone))
    }

    /// Gravity in another direction, beside the same.
    ///
    /// # Errors
    /// Invalid parameters of camera or mirror.
    pub(super) fn turned_gravity(
        &mut self,
        problem: &Problem,
        undone: &[Mistake],
        explained: bool,
    ) -> Result<Option<Turned>> {
        let alone = self.alone.remembered(undone, || single_cause::alone(problem))?;
        self.gravity.remembered(undone, || loads::turned_gravity(problem, alone, explained))
    }

    /// The score test's sums at the nominal model of the session as it was given; none where it leaves no gap.
    pub(crate) fn nominal_sums(&self) -> Option<Arc<NominalSums>> {
        self.alone.known(&[])?.as_ref().map(|alone| Arc::clone(&alone.sums))
    }

    /// The budget of the next diagnosis; `own`: that of a session's first.
    pub(crate) fn next_budget(&mut self, own: &WorkBudget) -> WorkBudget {
        let next = self.budget.as_ref().map_or_else(|| own.clone(), WorkBudget::again);
        self.budget = Some(next.clone());
        next
    }
}
