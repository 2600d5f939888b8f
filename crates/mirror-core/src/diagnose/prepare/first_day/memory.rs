//! What was found of a session at an earlier look: the same mistakes undone leave the same session, in which the same is found again.

use super::mistake::Mistake;
use super::outlying::False;
use crate::error::Result;

/// Findings of one stage, by the mistakes that had been undone before it.
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

/// What the stages found that depend on nothing but the session and the mistakes undone before.
#[derive(Default)]
pub(crate) struct Memory {
    gravity: Known<Found>,
    slips: Known<Found>,
    outlying: Known<Vec<False>>,
}

impl Memory {
    /// Gravity's turn.
    pub(super) fn gravity(
        &mut self,
        undone: &[Mistake],
        find: impl FnOnce() -> Result<Found>,
    ) -> Result<Found> {
        self.gravity.remembered(undone, find)
    }

    /// What slipped.
    pub(super) fn slip(&mut self, undone: &[Mistake], find: impl FnOnce() -> Result<Found>) -> Result<Found> {
        self.slips.remembered(undone, find)
    }

    /// What is false.
    pub(super) fn outlying(
        &mut self,
        undone: &[Mistake],
        find: impl FnOnce() -> Result<Vec<False>>,
    ) -> Result<Vec<False>> {
        self.outlying.remembered(undone, find)
    }
}
