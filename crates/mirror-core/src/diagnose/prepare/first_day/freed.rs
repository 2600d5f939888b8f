//! A joint's positions as they fit best, posture by posture: where its column says nothing of it.

use super::alternatives::{Session, least, range};

use super::placed::Placed;
use super::variant::Variant;
use crate::diagnose::principles::Size;

/// Positions that are tried where a joint's position is not known.
const FREE_POSITIONS: Size = 25;

/// A joint whose positions are free.
#[derive(Clone, Copy)]
pub(super) struct Free<'a> {
    pub joint: usize,
    /// The rows in which they are (ascending),
    pub rows: &'a [usize],
    /// those of them whose observations are used,
    pub shown: &'a [usize],
    /// and the range of positions.
    pub bounds: (f64, f64),
}

impl Free<'_> {
    /// By posture the rows in which the position is free, and those that show it; only postures that are shown.
    pub fn postures(&self, session: &Session<'_>) -> Vec<(Vec<usize>, Vec<usize>)> {
        let is_in = |rows: &[usize], f: &usize| rows.binary_search(f).is_ok();
        let of = |posture: &Vec<usize>| {
            let own: Vec<usize> = posture.iter().copied().filter(|f| is_in(self.rows, f)).collect();
            let shown: Vec<usize> = own.iter().copied().filter(|f| is_in(self.shown, f)).collect();
            (own, shown)
        };
        session.postures.iter().map(of).filter(|(_, shown)| !shown.is_empty()).collect()
    }
}

impl Session<'_> {
    /// A column whose positions over a run are those that fit best, posture by posture: for comparing, not for using.
    pub fn freed(&self, variant: &Variant, joint: usize, first: usize, last: usize) -> Variant {
        let column = variant.column(joint);
        let (low, high) = range(&column);
        let margin = 0.2 * (high - low);
        let rows: Vec<usize> = (first..=last).collect();
        let bounds = (low - margin, high + margin);
        let free = Free { joint, rows: &rows, shown: &rows, bounds };
        // Measured in an unknown frame: the other rows determine it.
        let others: Vec<usize> =
            (0..self.problem.frames.len()).filter(|f| !(first..=last).contains(f)).collect();
        let placed = self.misfit.placed(variant, &others);
        self.freed_at(variant, &free, placed.as_ref())
    }

    /// The same at a place of the unknown frame of measured points.
    pub fn freed_at(&self, variant: &Variant, free: &Free<'_>, placed: Option<&Placed>) -> Variant {
        let (joint, (low, high)) = (free.joint, free.bounds);
        let mut out = variant.clone();
        let mut work = self.misfit.work();
        work.placed = placed.cloned();
        for (own, frames) in free.postures(self) {
            let mut loss = |q: f64| {
                let mut sum = 0.0;
                for &f in &frames {
                    out.positions[f][joint] = q;
                    self.misfit.of_frame(&mut work, &out, f, |_, r| sum += self.misfit.loss(r));
                }
                sum
            };
            let step = (high - low) / (FREE_POSITIONS - 1) as f64;
            let best = (0..FREE_POSITIONS)
                .map(|k| low + step * k as f64)
                .map(|q| (loss(q), q))
                .min_by(|a, b| a.0.total_cmp(&b.0));
            let Some((_, at)) = best else { continue };
            let q = least(at - step, at + step, loss);
            own.iter().for_each(|&f| out.positions[f][joint] = q);
        }
        out
    }
}
