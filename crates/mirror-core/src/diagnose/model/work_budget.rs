//! The limit of work of a diagnosis: whatever is wrong with a session, the search ends.
//!
//! Work is counted as evaluations, not as time, so that the same session always ends at the same point. A step of
//! the search asks before it begins; when nothing is left, what was found so far is reported with its remainder. The
//! search for single causes may use only a part of the work, so that free-form errors and small errors everywhere
//! are tested in every session.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// The limit, in linearisations of the whole session with free mounts; simulated sessions and sessions mounted by
/// hand mostly use a fifth to three quarters of it.
const MOST_LINEARISATIONS: u64 = 1600;
/// At least: three seconds or so.
const LEAST: u64 = 480_000_000;
/// The minimum for each frame, up to this many frames: twenty-five milliseconds. A session of measured points has
/// few columns of mounts, and as many causes as another.
const LEAST_OF_FRAME: u64 = 9_000_000;
const MOST_FRAMES: usize = 500;
/// A frame; each corner of its board, where these are rows; each column; each product of two is a quarter. In some five nanoseconds of one core.
const FRAME: u64 = 600;
const CORNER: u64 = 260;
const COLUMN: u64 = 15;
/// A corner that is predicted while a board's mirror is fitted.
const PREDICTED: u64 = 110;

/// The share of the work for each stage except the search for named causes: gross mistakes before it, free-form
/// errors and small errors everywhere after it. What a stage does not use is left for later ones.
pub(crate) const A_STAGE: f64 = 0.2;

/// The work of one diagnosis; clones count together.
#[derive(Debug, Clone)]
pub(crate) struct WorkBudget {
    spent: Arc<AtomicU64>,
    /// What may be spent now.
    allowed: Arc<AtomicU64>,
    most: u64,
}

impl WorkBudget {
    /// For a session with this many frames, corners of boards in all, and columns of its mounts.
    pub fn of(frames: usize, corners: usize, columns: usize) -> Self {
        let most = MOST_LINEARISATIONS * linearisation(frames, corners, columns);
        let most = most.max(LEAST).max(LEAST_OF_FRAME * frames.min(MOST_FRAMES) as u64);
        Self { spent: Arc::default(), allowed: Arc::new(AtomicU64::new(most)), most }
    }

    /// Allows so much of the whole from now on, to all clones.
    pub fn allow(&self, share: f64) {
        self.allowed.store((share * self.most as f64) as u64, Ordering::Relaxed);
    }

    /// Counts frames that were linearised by so many columns, with so many corners as rows.
    pub fn spend(&self, frames: usize, corners: usize, columns: usize) {
        self.spent.fetch_add(linearisation(frames, corners, columns), Ordering::Relaxed);
    }

    /// Counts corners that were predicted to fit a board's mirror.
    pub fn spend_predicted(&self, corners: usize) {
        self.spent.fetch_add(corners as u64 * PREDICTED, Ordering::Relaxed);
    }

    /// Whether nothing further is begun for now.
    pub fn is_spent(&self) -> bool {
        self.spent.load(Ordering::Relaxed) >= self.allowed.load(Ordering::Relaxed)
    }

    /// The share that is spent; above 1 where what had begun went on.
    pub fn share(&self) -> f64 {
        self.spent.load(Ordering::Relaxed) as f64 / self.most as f64
    }
}

/// The work of linearising so many frames, with so many corners as rows, by so many columns.
fn linearisation(frames: usize, corners: usize, columns: usize) -> u64 {
    let (frames, corners, columns) = (frames as u64, corners as u64, columns as u64);
    frames * (FRAME + COLUMN * columns + columns * columns / 4) + corners * CORNER
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clones_spend_one_budget_and_longer_sessions_have_more() {
        let budget = WorkBudget::of(200, 200 * 40, 40);
        let clone = budget.clone();
        while !clone.is_spent() {
            clone.spend(200, 200 * 40, 40);
        }
        assert!(budget.is_spent() && budget.share() < 1.01);
        clone.allow(1.1);
        assert!(!budget.is_spent());
        assert_eq!(budget.spent.load(Ordering::Relaxed), MOST_LINEARISATIONS * linearisation(200, 8000, 40));
        assert!(WorkBudget::of(400, 400 * 40, 40).most == 2 * budget.most);
        assert!(WorkBudget::of(2, 80, 5).most == LEAST);
    }
}
