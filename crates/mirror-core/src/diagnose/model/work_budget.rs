//! The limit of work of a session: whatever is wrong with it, the search ends. All its diagnoses have one budget.
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
/// At least: a second or so.
const LEAST: u64 = 480_000_000;
/// The minimum for each frame, up to this many frames: some twenty milliseconds. A session of measured points has
/// few columns of mounts, and as many causes as another.
const LEAST_OF_FRAME: u64 = 9_000_000;
const MOST_FRAMES: usize = 500;
/// A frame; each corner of its board, where these are rows; each column; each product of two is a quarter. In some two nanoseconds of one core.
const FRAME: u64 = 600;
const CORNER: u64 = 260;
const COLUMN: u64 = 15;
/// A corner that is predicted while a board's mirror is fitted.
const PREDICTED: u64 = 110;

/// What one diagnosis may spend at most, for each frame: some twenty milliseconds; and the fewest frames for which
/// it is counted, because the algebra of causes costs as much in a short session.
const MOST_OF_FRAME: u64 = 9_000_000;
const FEWEST_FRAMES: usize = 200;
/// What all diagnoses of a session may spend together, in units of that.
const OF_SESSION: f64 = 1.3;

/// The share of the work for each stage except the search for named causes: gross mistakes before it, free-form
/// errors and small errors everywhere after it. What a stage does not use is left for later ones.
pub(crate) const A_STAGE: f64 = 0.2;

/// The work of a session, with the part of one of its diagnoses; clones count together.
#[derive(Debug, Clone)]
pub(crate) struct WorkBudget {
    /// By all diagnoses of the session.
    spent: Arc<AtomicU64>,
    /// Up to where this diagnosis may spend now.
    allowed: Arc<AtomicU64>,
    /// What was spent before this diagnosis.
    before: u64,
    /// Of what shares are.
    most: u64,
    /// What one diagnosis may spend, and all of a session together.
    of_one: u64,
    of_session: u64,
}

impl WorkBudget {
    /// For a session with this many frames, corners of boards in all, and columns of its mounts: that of its first
    /// diagnosis.
    pub fn of(frames: usize, corners: usize, columns: usize) -> Self {
        let most = MOST_LINEARISATIONS * linearisation(frames, corners, columns);
        let most = most.max(LEAST).max(LEAST_OF_FRAME * frames.min(MOST_FRAMES) as u64);
        let of_one = MOST_OF_FRAME * frames.max(FEWEST_FRAMES) as u64;
        let of_session = (OF_SESSION * of_one as f64) as u64;
        let first =
            Self { spent: Arc::default(), allowed: Arc::default(), before: 0, most, of_one, of_session };
        first.allow(1.0);
        first
    }

    /// For another diagnosis of the same session, which has what is left.
    pub fn again(&self) -> Self {
        let before = self.spent.load(Ordering::Relaxed);
        let next = Self { allowed: Arc::default(), before, ..self.clone() };
        next.allow(1.0);
        next
    }

    /// Allows this diagnosis this share of what one may spend from now on, to all clones; no more than the same share
    /// of what the diagnoses before it left of the session's: each stage keeps its part.
    pub fn allow(&self, share: f64) {
        let left = self.of_session.saturating_sub(self.before);
        let part = ((share * self.most as f64) as u64).min(self.of_one).min((share * left as f64) as u64);
        self.allowed.store(self.before + part, Ordering::Relaxed);
    }

    /// Allows this diagnosis this share of what one may spend in addition to what is spent, within the session's work.
    pub fn allow_more(&self, share: f64) {
        let spent = self.spent.load(Ordering::Relaxed);
        let part = (share * self.of_one.min(self.most) as f64) as u64;
        self.allowed.store((spent + part).min(self.of_session), Ordering::Relaxed);
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

    /// Whether no further diagnosis is begun: less is left than a stage's share of one.
    pub fn is_over(&self) -> bool {
        let left = self.of_session.saturating_sub(self.spent.load(Ordering::Relaxed));
        (left as f64) < A_STAGE * self.of_one as f64
    }

    /// The share of one diagnosis that this one has spent; above 1 where what had begun went on.
    pub fn share(&self) -> f64 {
        (self.spent.load(Ordering::Relaxed) - self.before) as f64 / self.most as f64
    }

    /// The share of the session's work that is spent.
    pub fn share_of_session(&self) -> f64 {
        self.spent.load(Ordering::Relaxed) as f64 / self.of_session as f64
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

    const CORNERS: usize = 8000;

    fn spend_all(budget: &WorkBudget) -> u64 {
        let before = budget.spent.load(Ordering::Relaxed);
        while !budget.is_spent() {
            budget.spend(200, CORNERS, 40);
        }
        budget.spent.load(Ordering::Relaxed) - before
    }

    #[test]
    fn the_stages_of_a_second_diagnosis_have_their_parts_of_what_is_left() {
        let first = WorkBudget::of(200, CORNERS, 40);
        spend_all(&first);
        let second = first.again();
        let mut spent = Vec::new();
        for share in [1.0 - 2.0 * A_STAGE, 1.0 - A_STAGE, 1.0] {
            second.allow(share);
            spent.push(spend_all(&second));
        }
        assert!(spent.iter().all(|s| *s > 0), "{spent:?}");
        assert!(second.is_over() && second.share_of_session() < 1.01);
    }

    #[test]
    fn clones_spend_one_budget_and_longer_sessions_have_more() {
        let budget = WorkBudget::of(200, CORNERS, 40);
        let spent = spend_all(&budget.clone());
        assert!(budget.is_spent() && budget.share() < 1.01);
        assert!(spent.abs_diff(budget.of_one.min(budget.most)) < linearisation(200, CORNERS, 40));
        assert!(WorkBudget::of(400, 2 * CORNERS, 40).most == 2 * budget.most);
        assert!(WorkBudget::of(400, 2 * CORNERS, 40).of_one == 2 * budget.of_one);
        assert!(WorkBudget::of(2, 80, 5).most == LEAST);
    }

    #[test]
    fn all_diagnoses_of_a_session_share_one_budget() {
        let first = WorkBudget::of(200, CORNERS, 40);
        let spent = spend_all(&first);
        assert!(!first.is_over());
        let mut budget = first.clone();
        let mut all = spent;
        for _ in 0..10 {
            // Each has a share of its own, and no more than what is left.
            budget = budget.again();
            assert_eq!(budget.share(), 0.0);
            all += spend_all(&budget);
        }
        assert!(budget.is_over() && budget.is_spent() && first.share_of_session() >= 1.0);
        assert!(all - linearisation(200, CORNERS, 40) <= first.of_session);
    }
}
