//! The most informative postures of a pool, chosen one by one.
//!
//! With J the factor of what a posture adds, `JᵀJ`, in units of the priors' standard deviations, and `Σ = (I + Σ JᵀJ)⁻¹`
//! the covariance of all parameters after the postures chosen so far, a posture adds the information `½ log det(I + C)`,
//! `C = J Σ Jᵀ`. The posture that adds most is taken, then `Σ ← Σ − B Bᵀ`, `B = Σ Jᵀ L⁻ᵀ`, `L Lᵀ = I + C`.
//!
//! What a posture adds only falls as others are chosen: the function is submodular. So a posture whose gain was the
//! largest long ago is computed again only where that old gain still is (lazy evaluation), and the choice is within
//! `1 − 1/e` of the best.
//!
//! Sources: D-optimal design, Atkinson, Donev and Tobias (2007), ch. 12; Minoux, "Accelerated greedy algorithms"
//! (1978).

use super::expected::PlannedSession;
use crate::diagnose::likelihood::factor::{cholesky, log_det};
use crate::diagnose::likelihood::frame_factor::frame_factors;
use crate::error::{Error, Result};
use nalgebra::DMatrix;
use rayon::prelude::*;
use std::cmp::Ordering;
use std::collections::{BTreeSet, BinaryHeap};

/// Postures that can be chosen.
#[derive(Debug, Clone, Copy)]
pub struct Pool<'a> {
    /// The frames that are taken together where an item is chosen.
    pub frames: &'a [Vec<usize>],
    /// To which block each item belongs.
    pub block: &'a [usize],
    /// Which posture each item shows: none is taken twice.
    pub posture: &'a [usize],
    /// How many items are taken of each block at most.
    pub most: &'a [usize],
}

impl Pool<'_> {
    fn check(&self, frames: usize) -> Result<()> {
        for (what, got) in [("block", self.block.len()), ("posture", self.posture.len())] {
            if got != self.frames.len() {
                let what = format!("pool: {what} of each item");
                return Err(Error::LengthMismatch { what, got, needed: self.frames.len() });
            }
        }
        let below = |what: &str, got: usize, count: usize| {
            let what = format!("pool: {what}");
            let error = Error::OutOfRange { what, got: got as f64, needed: format!("below {count}") };
            if got < count { Ok(()) } else { Err(error) }
        };
        self.frames.iter().flatten().try_for_each(|&frame| below("frame", frame, frames))?;
        self.block.iter().try_for_each(|&block| below("block", block, self.most.len()))
    }
}

impl PlannedSession {
    /// The items of a pool that add most information, in the order in which they were chosen.
    ///
    /// # Errors
    /// Lists of different lengths, a frame or block that does not exist; invalid parameters of camera or mirror;
    /// [`Error::Cancelled`].
    pub fn choose(&self, pool: &Pool<'_>) -> Result<Vec<usize>> {
        pool.check(self.problem.frames.len())?;
        let items = self.items(pool)?;
        self.problem.cancel.check()?;
        let mut left = pool.most.to_vec();
        let mut taken = BTreeSet::new();
        let mut chosen: Vec<Chosen> = Vec::new();
        let mut out = Vec::new();
        let mut queue: BinaryHeap<Waiting> = items.into_iter().flatten().collect();
        while let Some(mut best) = queue.pop() {
            if left[pool.block[best.item]] == 0 || taken.contains(&pool.posture[best.item]) {
                continue;
            }
            self.problem.cancel.check()?;
            if best.after < chosen.len() {
                best.catch_up(&chosen);
                queue.push(best);
                continue;
            }
            left[pool.block[best.item]] -= 1;
            taken.insert(pool.posture[best.item]);
            out.push(best.item);
            if let Some(next) = Chosen::of(&best, &chosen) {
                chosen.push(next);
            }
        }
        Ok(out)
    }

    /// Each item with its gain where nothing is chosen yet; none where it shows nothing.
    fn items(&self, pool: &Pool<'_>) -> Result<Vec<Option<Waiting>>> {
        let (nominal, noise) = (self.problem.nominal(), self.problem.noise);
        let columns = (self.columns.as_slice(), self.prior_std.as_slice());
        let of_item = |(item, frames): (usize, &Vec<usize>)| {
            let factors = frame_factors(&self.problem, &nominal, noise, columns, frames)?;
            let factors: Vec<DMatrix<f64>> = factors.into_iter().flatten().collect();
            Ok((!factors.is_empty()).then(|| Waiting::new(item, &factors)))
        };
        pool.frames.par_iter().enumerate().map(of_item).collect()
    }
}

/// An item that may still be chosen.
struct Waiting {
    item: usize,
    /// J of all of its frames.
    factor: DMatrix<f64>,
    /// `C = J Σ Jᵀ` after so many that were chosen, and the gain then.
    spread: DMatrix<f64>,
    after: usize,
    gain: f64,
}

impl Waiting {
    fn new(item: usize, frames: &[DMatrix<f64>]) -> Self {
        let rows = frames.iter().flat_map(|f| f.row_iter().map(|row| row.into_owned()));
        let rows: Vec<_> = rows.collect();
        let factor = if rows.is_empty() { DMatrix::zeros(0, 0) } else { DMatrix::from_rows(&rows) };
        let spread = &factor * factor.transpose();
        let mut out = Self { item, factor, spread, after: 0, gain: 0.0 };
        out.gain = out.gain_now();
        out
    }

    /// `I + C`.
    fn whole(&self) -> DMatrix<f64> {
        &self.spread + DMatrix::identity(self.spread.nrows(), self.spread.nrows())
    }

    fn gain_now(&self) -> f64 {
        cholesky(self.whole()).map_or(0.0, |factor| log_det(&factor))
    }

    fn catch_up(&mut self, chosen: &[Chosen]) {
        for one in &chosen[self.after..] {
            let across = &self.factor * &one.0;
            self.spread -= &across * across.transpose();
        }
        self.after = chosen.len();
        // It cannot rise but by rounding.
        self.gain = self.gain.min(self.gain_now());
    }
}

/// B of one that was chosen.
struct Chosen(DMatrix<f64>);

impl Chosen {
    /// None where it adds nothing that numbers can tell.
    fn of(item: &Waiting, before: &[Self]) -> Option<Self> {
        let root = cholesky(item.whole())?.l();
        let mut across = item.factor.transpose();
        for one in before {
            across -= &one.0 * (&item.factor * &one.0).transpose();
        }
        let whitened = root.solve_lower_triangular(&across.transpose())?;
        Some(Self(whitened.transpose()))
    }
}

impl PartialEq for Waiting {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Waiting {}

impl PartialOrd for Waiting {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Waiting {
    /// The largest gain first, of equal ones the first item.
    fn cmp(&self, other: &Self) -> Ordering {
        self.gain.total_cmp(&other.gain).then(other.item.cmp(&self.item))
    }
}
