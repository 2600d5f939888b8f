//! Causes that can be taken for each other.
//!
//! With the set-up free, S is the information on all effects, in units of the sizes that they commonly have. Where a
//! cause h of size p is real and another one, k, is fitted in its place, −2 log likelihood rises by `p² (S_hh − S_hk
//! (S_kk + P)⁻¹ S_kh)`; P keeps k within sizes that mean anything. Against that stand the priors and Occam factors of
//! both, `2 log (π_k / π_h) + log det(I + S_hh) − log det(I + S_kk)`: what one number explains is not taken for what
//! needs three. They are separated from the size on at which the odds tell them apart, as an alternative that is not
//! worth naming, in 19 of 20 sessions. A cause of several parameters is separated where any of them is.

use super::expected::PlannedSession;
use crate::diagnose::assessment::limits::{LARGEST, noncentrality};
use crate::diagnose::likelihood::factor::{cholesky, log_det};
use crate::diagnose::principles::WORTH_NAMING;
use nalgebra::DMatrix;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Another hypothesis, with the size from which on both are separated, in sizes that the cause commonly has.
pub(super) type Rival = (usize, f64);

/// Of each hypothesis all others, given the information on all columns.
pub(super) fn rivals(session: &PlannedSession, information: &DMatrix<f64>) -> BTreeMap<usize, Vec<Rival>> {
    let first = session.first_effect;
    let is_mount = |h: &usize| session.of[h].iter().all(|&column| column < first);
    let (mounts, others): (Vec<usize>, Vec<usize>) = session.of.keys().copied().partition(is_mount);
    let setup: Vec<usize> = (0..first).collect();
    let whole = Beside::new(session, information, &setup, &others);
    let of_others = others
        .par_iter()
        .flat_map_iter(|&h| others.iter().filter(move |&&k| k != h).map(move |&k| (h, k)))
        .map(|(h, k)| (h, (k, whole.apart_from(h, k))));
    // A mount is a part of the set-up: beside it the rest is free.
    let of_mounts = mounts.par_iter().flat_map_iter(|&m| {
        let free: Vec<usize> = setup.iter().copied().filter(|c| !session.of[&m].contains(c)).collect();
        let both: Vec<usize> = others.iter().copied().chain([m]).collect();
        let beside = Beside::new(session, information, &free, &both);
        let pairs = others
            .iter()
            .flat_map(|&k| [(m, (k, beside.apart_from(m, k))), (k, (m, beside.apart_from(k, m)))]);
        pairs.collect::<Vec<_>>()
    });
    let mut found: BTreeMap<usize, Vec<Rival>> = session.of.keys().map(|&h| (h, Vec::new())).collect();
    let pairs: Vec<(usize, Rival)> = of_others.chain(of_mounts).collect();
    for (h, rival) in pairs {
        found.entry(h).or_default().push(rival);
    }
    found
}

/// What the postures tell of some hypotheses where other columns are free.
struct Beside<'a> {
    session: &'a PlannedSession,
    /// S, in units of the usual sizes.
    information: DMatrix<f64>,
    /// `log det(I + S_hh) − 2 log π_h` by hypothesis.
    costs: BTreeMap<usize, f64>,
}

impl<'a> Beside<'a> {
    fn new(
        session: &'a PlannedSession,
        information: &DMatrix<f64>,
        free: &[usize],
        hypotheses: &[usize],
    ) -> Self {
        let mut left = reduced(information, free, &session.prior_std);
        let usual = &session.usual;
        left.iter_mut()
            .enumerate()
            .for_each(|(at, x)| *x *= usual[at % usual.len()] * usual[at / usual.len()]);
        let mut out = Self { session, information: left, costs: BTreeMap::new() };
        out.costs = hypotheses.iter().map(|&h| (h, out.cost(h))).collect();
        out
    }

    fn block(&self, rows: usize, columns: usize) -> DMatrix<f64> {
        let (rows, columns) = (&self.session.of[&rows], &self.session.of[&columns]);
        DMatrix::from_fn(rows.len(), columns.len(), |i, j| self.information[(rows[i], columns[j])])
    }

    fn cost(&self, h: usize) -> f64 {
        let own = self.block(h, h);
        let volume =
            cholesky(&own + DMatrix::identity(own.nrows(), own.nrows())).map_or(0.0, |f| log_det(&f));
        volume - 2.0 * self.session.catalogue.hypotheses[h].log_prior
    }

    /// The size of h from which on k cannot be taken for it.
    fn apart_from(&self, h: usize, k: usize) -> f64 {
        let odds = 2.0 * ((1.0 - WORTH_NAMING) / WORTH_NAMING).ln();
        let needed = odds - (self.costs[&k] - self.costs[&h]);
        if needed <= 0.0 {
            return 0.0;
        }
        let (mut rival, across) = (self.block(k, k), self.block(k, h));
        rival += DMatrix::identity(rival.nrows(), rival.nrows()) / (LARGEST * LARGEST);
        let Some(factor) = cholesky(rival) else { return f64::INFINITY };
        let explained = across.tr_mul(&factor.solve(&across));
        let left = self.block(h, h) - explained;
        let rise = left.diagonal().iter().copied().fold(0.0, f64::max);
        if rise > 0.0 { (noncentrality(needed, 1.0) / rise).sqrt() } else { f64::INFINITY }
    }
}

/// What is left of the information where some columns are fitted as well, within their priors: `H − H_·f (H_ff + P_f)⁻¹
/// H_f·`.
fn reduced(h: &DMatrix<f64>, free: &[usize], prior_std: &[f64]) -> DMatrix<f64> {
    let block = DMatrix::from_fn(free.len(), free.len(), |a, b| {
        let one = if a == b { 1.0 } else { 0.0 };
        h[(free[a], free[b])] * prior_std[free[a]] * prior_std[free[b]] + one
    });
    let across = DMatrix::from_fn(free.len(), h.ncols(), |a, j| h[(free[a], j)] * prior_std[free[a]]);
    match cholesky(block) {
        Some(factor) => h - across.tr_mul(&factor.solve(&across)),
        None => h.clone(),
    }
}
