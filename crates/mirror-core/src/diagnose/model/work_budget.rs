//! The limit of work of a session: whatever is wrong with it, the search ends. All its diagnoses have one budget.
//!
//! Work is counted, not timed, so that the same session always ends at the same point. A step of the search asks before
//! it begins; when nothing is left, what was found so far is reported with its remainder. The search for single causes
//! may use only a part of the work, so that free-form errors and small errors everywhere are tested in every session.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// What the search of one diagnosis may spend at most, and all that is counted of a session together, for each frame; and the
/// fewest frames for which it is counted, because the algebra of causes costs as much in a short session.
const OF_SEARCH_NS: u64 = 13_000_000;
const OF_SESSION_NS: u64 = 20_500_000;
const FEWEST_FRAMES: usize = 200;

/// The share of a search's work for each of its stages except that for named causes: free-form errors and small errors
/// everywhere after it. What a stage does not use is left for later ones.
pub(crate) const A_STAGE: f64 = 0.21;
/// The share of a search's work that the rest of a diagnosis takes, which no search may spend.
const OF_ANOTHER: f64 = 0.3;
/// The share above which chains of gross mistakes are made no longer, where none of them fits.
pub(crate) const MUCH: f64 = 0.5;

/// Work that is counted, by a price that is about the nanoseconds of one core that it takes. The prices were fitted to the times of
/// passes over sessions of many kinds, whose sums they tell to within a half: measured points are dearer than counted.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Effort {
    /// A frame in which so many markers were predicted.
    Frame { observations: usize },
    /// Corners of a board as rows, by mirror, camera and board.
    Corners(usize),
    /// Corners that were predicted while a board's mirror was fitted.
    Predicted(usize),
    /// Corners from which a board's pose was found in closed form.
    Posed(usize),
    /// A frame whose markers were compared with where they would be at other positions.
    Compared { observations: usize },
    /// Rows by columns, with the products of the columns.
    Rows { rows: usize, columns: usize },
    /// Frames in which so many hypotheses were screened, with so many products.
    Screened { frames: usize, hypotheses: usize, products: usize },
    /// Equations of so many unknowns, summed and solved.
    Equations(usize),
}

impl Effort {
    /// About how long it takes; of rows by columns the second term is the products of the columns.
    pub fn nanoseconds(self) -> u64 {
        match self {
            Self::Frame { observations } => 450 + 300 * observations as u64,
            Self::Corners(corners) | Self::Predicted(corners) => 200 * corners as u64,
            Self::Posed(corners) => 180 * corners as u64,
            Self::Compared { observations } => 700 + 150 * observations as u64,
            Self::Rows { rows, columns } => (columns * (10 + rows * (150 + columns) / 60)) as u64,
            Self::Screened { frames, hypotheses, products } => {
                frames as u64 * (90 * hypotheses as u64 + 5 * products as u64 / 2)
            }
            Self::Equations(unknowns) => {
                let n = unknowns as u64;
                n * n * (100 + n) / 16
            }
        }
    }
}

/// The work of a session, with the part of one of its diagnoses; clones count together.
#[derive(Debug, Clone)]
pub(crate) struct WorkBudget {
    /// By all diagnoses of the session, ns.
    spent: Arc<AtomicU64>,
    /// Up to where this diagnosis may spend now.
    allowed: Arc<AtomicU64>,
    /// Whether a step was refused since more was allowed.
    refused: Arc<AtomicBool>,
    /// What was spent before this diagnosis, or before its search.
    before: u64,
    /// What the diagnosis spent before its search.
    preparing: u64,
    /// What one search may spend, and all of a session together.
    of_one: u64,
    of_session: u64,
}

impl WorkBudget {
    /// For a session with this many frames: that of its first diagnosis.
    pub fn of(frames: usize) -> Self {
        let frames = frames.max(FEWEST_FRAMES) as u64;
        let (of_one, of_session) = (OF_SEARCH_NS * frames, OF_SESSION_NS * frames);
        let (spent, allowed, refused) = (Arc::default(), Arc::default(), Arc::default());
        let first = Self { spent, allowed, refused, before: 0, preparing: 0, of_one, of_session };
        first.allow(1.0);
        first
    }

    /// For another diagnosis of the same session, which has what is left.
    pub fn again(&self) -> Self {
        let before = self.spent.load(Ordering::Relaxed);
        let (allowed, refused) = (Arc::default(), Arc::default());
        let next = Self { allowed, refused, before, preparing: 0, ..self.clone() };
        next.allow(1.0);
        next
    }

    /// The search begins: what was spent to prepare it counts only to the session.
    pub fn search_begins(&mut self) {
        let spent = self.spent.load(Ordering::Relaxed);
        self.preparing = spent - self.before;
        self.before = spent;
        self.allow(1.0);
    }

    /// Up to where searches may spend: the rest is for what assesses and reports the result.
    fn of_searches(&self) -> u64 {
        self.of_session - (OF_ANOTHER * self.of_one as f64) as u64
    }

    /// Allows this search this share of what one may spend from its beginning on, to all clones; no more than the same share
    /// of what the diagnoses before it left of the session's: each stage keeps its part.
    pub fn allow(&self, share: f64) {
        let left = self.of_searches().saturating_sub(self.before);
        let part = (share * self.of_one.min(left) as f64) as u64;
        self.allow_up_to(self.before + part);
    }

    /// Allows this search this share of what one may spend in addition to what is spent, within what searches may spend.
    pub fn allow_more(&self, share: f64) {
        let spent = self.spent.load(Ordering::Relaxed);
        let part = (share * self.of_one as f64) as u64;
        self.allow_up_to((spent + part).min(self.of_searches()));
    }

    fn allow_up_to(&self, most: u64) {
        self.allowed.store(most, Ordering::Relaxed);
        self.refused.store(false, Ordering::Relaxed);
    }

    /// Counts work.
    pub fn spend(&self, effort: Effort) {
        self.spend_ns(effort.nanoseconds());
    }

    /// Counts work that was added up.
    pub fn spend_ns(&self, nanoseconds: u64) {
        self.spent.fetch_add(nanoseconds, Ordering::Relaxed);
    }

    /// Whether nothing further is begun for now.
    pub fn is_spent(&self) -> bool {
        let spent = self.spent.load(Ordering::Relaxed) >= self.allowed.load(Ordering::Relaxed);
        if spent {
            self.refused.store(true, Ordering::Relaxed);
        }
        spent
    }

    /// Whether a step of the search was refused since more was allowed: one that had begun may have spent the rest as the last.
    pub fn was_refused(&self) -> bool {
        self.refused.load(Ordering::Relaxed)
    }

    /// Whether no further diagnosis is begun: less is left than it takes to prepare one, as it took this, and to report it.
    pub fn is_over(&self) -> bool {
        let left = self.of_session.saturating_sub(self.spent.load(Ordering::Relaxed));
        (left as f64) < OF_ANOTHER * self.of_one as f64 + self.preparing as f64
    }

    /// The share of one search that was spent since the diagnosis or its search began; above 1 where what had begun went on.
    pub fn share(&self) -> f64 {
        (self.spent.load(Ordering::Relaxed) - self.before) as f64 / self.of_one as f64
    }

    /// The share of the session's work that is left for searches.
    #[cfg(test)]
    pub fn share_for_searches(&self) -> f64 {
        let left = self.of_searches().saturating_sub(self.spent.load(Ordering::Relaxed));
        left as f64 / self.of_session as f64
    }

    /// The share of the session's work that is spent.
    pub fn share_of_session(&self) -> f64 {
        self.spent.load(Ordering::Relaxed) as f64 / self.of_session as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A step of a search.
    const STEP: Effort = Effort::Rows { rows: 200 * 24, columns: 40 };

    fn spend_all(budget: &WorkBudget) -> u64 {
        let before = budget.spent.load(Ordering::Relaxed);
        while !budget.is_spent() {
            budget.spend(STEP);
        }
        budget.spent.load(Ordering::Relaxed) - before
    }

    #[test]
    fn the_stages_of_a_second_diagnosis_have_their_parts_of_what_is_left() {
        let first = WorkBudget::of(200);
        spend_all(&first);
        let second = first.again();
        let mut spent = Vec::new();
        for share in [1.0 - 2.0 * A_STAGE, 1.0 - A_STAGE, 1.0] {
            second.allow(share);
            spent.push(spend_all(&second));
        }
        assert!(spent.iter().all(|s| *s > 0), "{spent:?}");
        // More is allowed: no step was refused since.
        assert!(second.was_refused());
        second.allow_more(A_STAGE);
        assert!(!second.was_refused() && second.is_spent() && second.was_refused());
        assert!(second.is_over() && second.share_of_session() < 1.01);
    }

    #[test]
    fn what_prepares_a_search_counts_to_the_session_only() {
        let mut budget = WorkBudget::of(200);
        let all = budget.of_one;
        budget.spend_ns(all / 5);
        assert!(budget.share() > 0.19);
        budget.search_begins();
        assert_eq!(budget.share(), 0.0);
        assert!(spend_all(&budget) >= all);
        // What another would need to be prepared and reported is not left.
        assert!(budget.is_over() && !WorkBudget { preparing: 0, ..budget.clone() }.is_over());
        // A preparation that took nearly all leaves the search what is left of the session, but for what reports it.
        let mut budget = WorkBudget::of(200);
        budget.spend_ns(budget.of_searches() - all / 4);
        budget.search_begins();
        assert!(spend_all(&budget) <= all / 4 + STEP.nanoseconds());
    }

    #[test]
    fn clones_spend_one_budget_and_longer_sessions_have_more() {
        let budget = WorkBudget::of(200);
        let spent = spend_all(&budget.clone());
        assert!(budget.is_spent() && budget.share() < 1.01);
        assert!(spent.abs_diff(budget.of_one) < STEP.nanoseconds());
        assert!(WorkBudget::of(400).of_one == 2 * budget.of_one);
        assert!(WorkBudget::of(2).of_one == budget.of_one);
    }

    #[test]
    fn all_diagnoses_of_a_session_share_one_budget() {
        let first = WorkBudget::of(200);
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
        assert!(budget.is_spent() && first.share_for_searches() == 0.0);
        assert!(all - STEP.nanoseconds() <= first.of_searches());
        // To report the last one is left; no other is begun.
        assert!(first.share_of_session() < 1.0);
        budget.spend(STEP);
        assert!(budget.is_over());
    }
}
