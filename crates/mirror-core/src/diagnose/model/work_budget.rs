//! How much work a diagnosis may take: whatever is wrong with a session, the search for it ends.
//!
//! Work is counted where it is done, in what was evaluated and not in time, so that the same session always ends at the same place.
//! Who begins something further asks first; what was found so far is told then, with the remainder that it leaves.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Of a session's frames each, and of so many frames at least; a unit is some five nanoseconds of one core. Sessions of simulators and by
/// hand mostly end at a fifth to three quarters of it.
const MOST_A_FRAME: u64 = 12_000_000;
const FEWEST_FRAMES: usize = 50;
/// A frame; each corner of its board, where these are rows; each column; each product of two.
const FRAME: u64 = 4000;
const CORNER: u64 = 150;
const COLUMN: u64 = 30;

/// The work of one diagnosis; clones count together.
#[derive(Debug, Clone)]
pub(crate) struct WorkBudget {
    spent: Arc<AtomicU64>,
    most: u64,
}

impl WorkBudget {
    /// Of a session of so many frames.
    pub fn of(frames: usize) -> Self {
        Self { spent: Arc::default(), most: MOST_A_FRAME * frames.max(FEWEST_FRAMES) as u64 }
    }

    /// Counts frames that were linearised by so many columns, with so many corners as rows.
    pub fn spend(&self, frames: usize, corners: usize, columns: usize) {
        let (frames, corners, columns) = (frames as u64, corners as u64, columns as u64);
        let work = frames * (FRAME + COLUMN * columns + columns * columns / 2) + corners * CORNER;
        self.spent.fetch_add(work, Ordering::Relaxed);
    }

    /// Whether nothing further is begun.
    pub fn is_spent(&self) -> bool {
        self.spent.load(Ordering::Relaxed) >= self.most
    }

    /// The share that is spent; above 1 where what had begun went on.
    pub fn share(&self) -> f64 {
        self.spent.load(Ordering::Relaxed) as f64 / self.most as f64
    }
}
