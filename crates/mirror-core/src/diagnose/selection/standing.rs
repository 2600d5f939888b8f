//! How a cause stands: its probability, beside those of its alternatives and of no cause.

use crate::diagnose::criteria::cross_validation::PostureGap;
use crate::diagnose::principles::{Size, TEMPER, UNTHOUGHT_OF};

/// Alternatives of a cause that are weighed.
pub(super) const RIVALS: Size = 8;
/// A hypothesis with its probability.
#[derive(Debug, Clone)]
pub(crate) struct Rival {
    pub hypothesis: usize,
    pub variant: f64,
    pub probability: f64,
}

/// The probability of the i-th cause, of its alternatives, best first, and of no cause.
#[derive(Debug, Clone)]
pub(crate) struct Standing {
    pub probability: f64,
    pub rivals: Vec<Rival>,
    pub(super) nothing: f64,
    /// The markers' mounts together, where they could do as well.
    pub(super) mounts: Option<ByMounts>,
    /// Other laws of its joint that are out of the question in its place once they are fitted exactly: near nothing, where
    /// linear models compare them, they may look the same.
    pub(super) outdone: Vec<usize>,
}

impl Standing {
    /// Of a cause with this probability among these alternatives and no cause.
    pub fn of(probability: f64, mut rivals: Vec<Rival>, nothing: f64) -> Self {
        rivals.retain(|r| r.probability >= UNTHOUGHT_OF);
        rivals.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        Self { probability, rivals, nothing, mounts: None, outdone: Vec::new() }
    }

    /// The alternative that is more probable than the cause.
    pub fn likelier(&self) -> Option<&Rival> {
        self.rivals.first().filter(|r| r.probability > self.probability && r.probability > self.nothing)
    }

    /// By what factor the evidence makes an alternative, or no cause, more probable than the cause; 1 or less where
    /// it does not.
    pub(super) fn challenged(&self) -> f64 {
        let best = self.rivals.first().map_or(0.0, |r| r.probability).max(self.nothing);
        best / self.probability
    }

    /// The same factor once held-out regions count as well, which favour the alternative by these log odds: both
    /// opinions are pooled with equal weights (Genest and Zidek 1986).
    pub fn pooled(&self, held_out: f64) -> f64 {
        (self.challenged() * (TEMPER * held_out).exp()).sqrt()
    }

    /// Makes room for something that none of these is, and that is as probable as all of them times this.
    pub fn besides_another(&mut self, weight: f64) {
        let scale = 1.0 / (1.0 + weight);
        self.rivals.iter_mut().for_each(|r| r.probability *= scale);
        self.nothing *= scale;
        self.probability *= scale;
    }

    /// Limits the cause's probability to `most`. What it loses goes, by this share, to its alternatives: they were found in its place.
    pub fn limited(&mut self, most: f64, to_rivals: f64) {
        let lost = (self.probability - most).max(0.0);
        self.probability -= lost;
        let among: f64 = self.rivals.iter().map(|r| r.probability).sum();
        let count = self.rivals.len() as f64;
        for rival in &mut self.rivals {
            let part = if among > 0.0 { rival.probability / among } else { 1.0 / count };
            rival.probability += lost * to_rivals * part;
        }
    }

    /// Limits the alternatives to this many times the cause's probability, which does not change.
    pub fn hold_back(&mut self, by: f64) {
        let scale = (by / self.challenged()).min(1.0);
        self.rivals.iter_mut().for_each(|r| r.probability *= scale);
    }

    /// The same with an alternative in the cause's place, and the cause, given by hypothesis and variant, among its
    /// alternatives.
    pub fn exchanged(&self, own: (usize, f64), rival: usize) -> Self {
        let mut rivals = self.rivals.clone();
        let Some(other) = rivals.iter_mut().find(|r| r.hypothesis == rival) else { return self.clone() };
        let its = other.probability;
        *other = Rival { hypothesis: own.0, variant: own.1, probability: self.probability };
        Self::of(its, rivals, self.nothing)
    }

    /// The alternatives are more probable than the cause by this factor at most, instead of what the evidence alone
    /// says.
    pub(super) fn disputed(&mut self, by: f64) {
        let scale = by / self.challenged();
        self.rivals.iter_mut().for_each(|r| r.probability *= scale);
        self.nothing *= scale;
        let total = self.probability + self.nothing + self.rivals.iter().map(|r| r.probability).sum::<f64>();
        let scale = (1.0 - UNTHOUGHT_OF) / total;
        self.rivals.iter_mut().for_each(|r| r.probability *= scale);
        self.nothing *= scale;
        self.probability *= scale;
    }
}

/// All markers' mounts at once in a cause's place.
#[derive(Debug, Clone)]
pub(super) struct ByMounts {
    /// The mount that takes over most of what the cause explains.
    pub mount: usize,
    /// Log odds of the cause against them.
    pub odds: f64,
    /// The gap that they leave on held-out regions.
    pub gap: Vec<PostureGap>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_none_of_them_is_takes_its_share_of_all() {
        let rivals = vec![Rival { hypothesis: 3, variant: 0.0, probability: 0.3 }];
        let mut standing =
            Standing { probability: 0.6, rivals, nothing: 0.09, mounts: None, outdone: Vec::new() };
        let challenged = standing.challenged();
        standing.besides_another(0.5);
        assert!((standing.probability - 0.4).abs() < 1e-12 && (standing.nothing - 0.06).abs() < 1e-12);
        assert!((standing.rivals[0].probability - 0.2).abs() < 1e-12);
        assert!((standing.challenged() - challenged).abs() < 1e-12);
    }

    #[test]
    fn an_alternative_takes_the_place_of_its_cause() {
        let rival = |hypothesis, probability| Rival { hypothesis, variant: 0.0, probability };
        let standing = Standing::of(0.1, vec![rival(7, 0.5), rival(8, 0.2)], 0.19);
        let after = standing.exchanged((3, 1.5), 7);
        assert_eq!((after.probability, after.nothing), (0.5, 0.19));
        let told: Vec<_> = after.rivals.iter().map(|r| (r.hypothesis, r.variant, r.probability)).collect();
        assert_eq!(told, [(8, 0.0, 0.2), (3, 1.5, 0.1)]);
        assert!(after.likelier().is_none() && standing.likelier().is_some());
        let mut held_back = standing.clone();
        held_back.hold_back(0.5);
        let told: Vec<_> = held_back.rivals.iter().map(|r| r.probability).collect();
        assert!((told[0] - 0.05).abs() < 1e-12 && (told[1] - 0.02).abs() < 1e-12, "{told:?}");
        assert_eq!(held_back.probability, 0.1);
    }

    #[test]
    fn what_a_cause_loses_its_alternatives_gain_as_far_as_they_were_found() {
        let rival = |probability| Rival { hypothesis: 0, variant: 0.0, probability };
        let mut standing = Standing::of(0.9, vec![rival(0.06), rival(0.03)], 0.01);
        standing.limited(0.3, 0.5);
        assert!((standing.probability - 0.3).abs() < 1e-12);
        let told: Vec<f64> = standing.rivals.iter().map(|r| r.probability).collect();
        assert!((told[0] - 0.26).abs() < 1e-12 && (told[1] - 0.13).abs() < 1e-12, "{told:?}");
        standing.limited(0.5, 1.0);
        assert!((standing.probability - 0.3).abs() < 1e-12, "a limit above it changes nothing");
    }
}
