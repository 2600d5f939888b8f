//! Members of the group of small errors that are too large for it: they are reported as single causes.

use crate::diagnose::effects::hypothesis::{Catalogue, Model, Term};
use crate::diagnose::likelihood::fit::Fit;
use crate::diagnose::model::elementary::Atom;
use crate::diagnose::model::scene::Scene;
use crate::diagnose::principles::{Count, Threshold, WORTH_NAMING};
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::random_effects::small_errors::{KINDS, Kind, single_effect, spring_of};
use std::collections::BTreeMap;

/// An error with this share of the squares of all of its kind is no member of a group: of tens with one scale the
/// largest has a tenth or a third. With a half, a link's length was removed from a real arm's group, and a spring
/// was lost by that.
const OUTLYING_SHARE: Threshold = 0.6;
/// Of fewer errors than this one is easily the largest by far.
const FEWEST: Count = 5;

/// Whether an error is too large for a group of so many of its kind, by its square and the sum of all squares.
///
/// Loads differ by orders of magnitude along an arm, so one of the springs, few or many, may have most of the
/// squares, but hardly all.
pub(crate) fn outweighs(kind: Kind, square: f64, total: f64, errors: usize) -> bool {
    let (fewest, share) =
        if kind == Kind::Spring { (2, 1.0 - WORTH_NAMING) } else { (FEWEST, OUTLYING_SHARE) };
    errors >= fewest && square > share * total.max(1e-30)
}

/// The small errors of a group by hypothesis, each with its kind, its columns and its square, and the sums of
/// squares of all kinds.
///
/// The size of an error is its effect in this session: of a spring, the angle under its largest load, rad.
struct Errors {
    of_hypothesis: BTreeMap<usize, (Kind, Vec<usize>, f64)>,
    totals: [f64; KINDS],
}

impl Errors {
    fn of((geometry, scene): (&Geometry, &Scene), catalogue: &Catalogue, values: &[f64]) -> Self {
        let (mut of_hypothesis, mut totals) = (BTreeMap::new(), [0.0; KINDS]);
        for (k, column) in geometry.group.columns.iter().enumerate() {
            let kind = Kind::of(column);
            let moves = spring_of(column).map_or(values[k], |n| values[k] * scene.largest_torque(n));
            let square = moves.powi(2);
            totals[kind as usize] += square;
            let Some((effect, place, _)) = single_effect(column) else { continue };
            if let Some(h) = catalogue.find(effect, place) {
                let own = of_hypothesis.entry(h).or_insert((kind, Vec::new(), 0.0));
                own.1.push(k);
                own.2 += square;
            }
        }
        Self { of_hypothesis, totals }
    }

    /// Whether one is too large for its kind.
    fn outweighs(&self, hypothesis: usize) -> bool {
        self.of_hypothesis.get(&hypothesis).is_some_and(|(kind, _, square)| {
            let errors = self.of_hypothesis.values().filter(|(other, ..)| other == kind).count();
            outweighs(*kind, *square, self.totals[*kind as usize], errors)
        })
    }

    fn columns(&self, hypothesis: usize) -> &[usize] {
        self.of_hypothesis.get(&hypothesis).map_or(&[], |(_, columns, _)| columns)
    }
}

/// Removes the one error that outweighs all others of its kind (lengths, angles) from the group's values and
/// returns it as a single cause: its hypothesis, none where there is none.
pub(crate) fn name_outlying(
    group: (&Geometry, &Scene),
    catalogue: &Catalogue,
    model: &mut Model,
) -> Option<usize> {
    let errors = Errors::of(group, catalogue, &model.group);
    let known = |h: usize| model.terms.iter().any(|t| t.hypothesis == h);
    // Several joints of one link may each have a separate shift there: no single cause is all of these.
    let is_one_cause = |h: usize| errors.columns(h).len() == catalogue.hypotheses[h].prior_std.len();
    let outlying = |h: &usize| !known(*h) && is_one_cause(*h) && errors.outweighs(*h);
    let hypothesis = errors.of_hypothesis.keys().copied().find(outlying)?;
    let parameters =
        errors.columns(hypothesis).iter().map(|&k| core::mem::take(&mut model.group[k])).collect();
    model.terms.push(Term { hypothesis, variant: 0.0, parameters, prior_scale: 1.0 });
    Some(hypothesis)
}

/// Returns outliers to the group that, given the causes added later, no longer outweigh their kind; whether there
/// was any. Of two springs that became causes one after the other, neither may be an outlier alone.
pub(crate) fn put_back(
    group: (&Geometry, &Scene),
    catalogue: &Catalogue,
    named: &[usize],
    model: &mut Model,
) -> bool {
    let columns = Errors::of(group, catalogue, &model.group);
    let mut all = model.group.clone();
    for term in model.terms.iter().filter(|t| named.contains(&t.hypothesis)) {
        let own = columns.columns(term.hypothesis).iter();
        own.zip(&term.parameters).for_each(|(&k, value)| all[k] += value);
    }
    let errors = Errors::of(group, catalogue, &all);
    let stays = |term: &Term| !named.contains(&term.hypothesis) || errors.outweighs(term.hypothesis);
    let (kept, back): (Vec<Term>, Vec<Term>) = model.terms.drain(..).partition(stays);
    model.terms = kept;
    for term in &back {
        errors.columns(term.hypothesis).iter().for_each(|&k| model.group[k] = all[k]);
    }
    !back.is_empty()
}

/// The zero of a joint.
pub(crate) struct Zero {
    pub hypothesis: usize,
    pub value_rad: f64,
    /// The share of it that the data determine.
    pub told: f64,
    /// Whether it is a cause already.
    pub is_cause: bool,
}

/// The zeros of the joints of a group.
pub(crate) struct Zeros<'a> {
    pub setup: &'a Geometry,
    pub catalogue: &'a Catalogue,
    pub each: Vec<Zero>,
}

impl<'a> Zeros<'a> {
    fn of(setup: &'a Geometry, catalogue: &'a Catalogue, fit: &Fit) -> Self {
        let first = fit.model.nuisances.len();
        let mut each = Vec::new();
        for (k, (column, prior)) in setup.group.columns.iter().zip(&setup.group.prior_std).enumerate() {
            let (Atom::Joint(_), Some((effect, place, _))) = (column.atom, single_effect(column)) else {
                continue;
            };
            let Some(h) = catalogue.find(effect, place) else { continue };
            let own = fit.model.terms.iter().find(|t| t.hypothesis == h);
            let told = 1.0 - (fit.covariance[(first + k, first + k)] / (prior * prior)).clamp(0.0, 1.0);
            let is_cause = own.is_some();
            each.push(Zero {
                hypothesis: h,
                value_rad: fit.model.group[k] + own.map_or(0.0, |t| t.parameters[0]),
                told: if is_cause { 1.0 } else { told },
                is_cause,
            });
        }
        Self { setup, catalogue, each }
    }

    /// The common scale of all that are no causes, with one of them or without.
    fn spread(&self, (of, included): (usize, bool)) -> f64 {
        let others =
            self.each.iter().enumerate().filter(|(i, z)| if *i == of { included } else { !z.is_cause });
        let (sum, count) =
            others.fold((0.0, 0.0), |(s, c), (_, z)| (s + z.value_rad * z.value_rad, c + z.told));
        self.setup.usual_zero(sum, count)
    }

    /// Log odds of the k-th as a cause of its own against one of the small errors. Values count by the share that the data
    /// determine.
    ///
    /// `log BF = Σ_{j≠k} [ln N(μ_j; s₋ₖ) − ln N(μ_j; s)] − ln N(μ_k; s) + ln N(μ_k; σ₀) + ln P`, s and s₋ₖ the scales
    /// with and without it, σ₀ and P its prior as a cause.
    pub fn log_odds(&self, k: usize) -> f64 {
        let log_normal = |v: f64, s: f64| -0.5 * (v / s).powi(2) - s.ln();
        let (rest, all) = (self.spread((k, false)), self.spread((k, true)));
        let others = self.each.iter().enumerate().filter(|(i, z)| *i != k && !z.is_cause);
        let others =
            others.map(|(_, z)| z.told * (log_normal(z.value_rad, rest) - log_normal(z.value_rad, all)));
        let Zero { hypothesis, value_rad, .. } = self.each[k];
        let hypothesis = &self.catalogue.hypotheses[hypothesis];
        let own = log_normal(value_rad, hypothesis.prior_std[0]) - log_normal(value_rad, all);
        others.sum::<f64>() + own + hypothesis.log_prior
    }
}

/// The joint's zero that is more probably a cause of its own than one of the small errors: without it the others' scale
/// is so much smaller.
pub(crate) fn standing_out(setup: &Geometry, catalogue: &Catalogue, fit: &Fit) -> Option<Term> {
    let zeros = Zeros::of(setup, catalogue, fit);
    let free = (0..zeros.each.len()).filter(|&k| !zeros.each[k].is_cause);
    let (best, odds) = free.map(|k| (k, zeros.log_odds(k))).max_by(|a, b| a.1.total_cmp(&b.1))?;
    let hypothesis = zeros.each[best].hypothesis;
    (odds > 0.0).then(|| Term { hypothesis, variant: 0.0, parameters: vec![0.0], prior_scale: 1.0 })
}

/// Log odds of a zero that is a cause against one of the small errors of all zeros; none of another cause.
pub(crate) fn odds_of_standing_out(
    setup: &Geometry,
    catalogue: &Catalogue,
    fit: &Fit,
    hypothesis: usize,
) -> Option<f64> {
    let zeros = Zeros::of(setup, catalogue, fit);
    let k = zeros.each.iter().position(|z| z.hypothesis == hypothesis && z.is_cause)?;
    Some(zeros.log_odds(k))
}
