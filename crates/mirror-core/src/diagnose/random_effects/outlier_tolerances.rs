//! Members of the group of small errors that are too large for it: single causes that only hide among the others.

use crate::diagnose::effects::hypothesis::{Catalogue, Model, Term};
use crate::diagnose::likelihood::fit::Fit;
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::scene::Scene;
use crate::diagnose::principles::{Count, LEAST_LOG_ODDS, Threshold, WORTH_NAMING};
use crate::diagnose::random_effects::geometric_tolerances::{Geometry, KINDS, Kind, single_effect};
use std::collections::BTreeMap;

/// One error with this share of the squares of all of its kind is no member of a group: of tens that are spread alike the largest
/// has a tenth or a third. At half a link's length was taken out of a real arm's group, and a spring was lost by it.
const OUTLYING_SHARE: Threshold = 0.6;
/// Of fewer errors than this one is easily the largest by far.
const FEWEST: Count = 5;

/// Whether an error of so many of a kind is too large to be one of them, by its square and the sum of all squares.
///
/// Loads differ by orders of magnitude along an arm: of springs, few or many, one may have most of the squares, and hardly all.
pub(crate) fn outweighs(kind: Kind, square: f64, total: f64, errors: usize) -> bool {
    let (fewest, share) =
        if kind == Kind::Spring { (2, 1.0 - WORTH_NAMING) } else { (FEWEST, OUTLYING_SHARE) };
    errors >= fewest && square > share * total.max(1e-30)
}

/// An error's size by what it does in this session: of a spring the angle under its largest load, rad; else the value itself.
fn moves(scene: &Scene, column: &Column, value: f64) -> f64 {
    match (Kind::of(column), column.atom) {
        (Kind::Spring, Atom::Joint(n)) => value * scene.largest_torque(n),
        _ => value,
    }
}

/// Takes the one error that outweighs all others of its kind (lengths, angles) out of the group's values and names it as a cause
/// of its own: its hypothesis, none where there is none.
pub(crate) fn name_outlying(
    (geometry, scene): (&Geometry, &Scene),
    catalogue: &Catalogue,
    model: &mut Model,
) -> Option<usize> {
    let mut totals = [0.0; KINDS];
    let mut errors: BTreeMap<usize, (Kind, Vec<usize>)> = BTreeMap::new();
    for (k, column) in geometry.group.columns.iter().enumerate() {
        let its_kind = Kind::of(column);
        totals[its_kind as usize] += moves(scene, &geometry.group.columns[k], model.group[k]).powi(2);
        let Some((effect, place, _)) = single_effect(column) else { continue };
        if let Some(h) = catalogue.find(effect, place) {
            errors.entry(h).or_insert((its_kind, Vec::new())).1.push(k);
        }
    }
    let square = |columns: &[usize]| {
        columns.iter().map(|&k| moves(scene, &geometry.group.columns[k], model.group[k]).powi(2)).sum::<f64>()
    };
    let outlying = errors.iter().find(|(h, (its_kind, columns))| {
        let known = model.terms.iter().any(|t| t.hypothesis == **h);
        let others = errors.values().filter(|(kind, _)| kind == its_kind).count();
        !known && outweighs(*its_kind, square(columns), totals[*its_kind as usize], others)
    });
    let (&hypothesis, (_, columns)) = outlying?;
    // Several joints of one link may each have a shift of their own there: no single cause is all of these.
    if columns.len() != catalogue.hypotheses[hypothesis].prior_std.len() {
        return None;
    }
    let parameters = columns.iter().map(|&k| core::mem::take(&mut model.group[k])).collect();
    model.terms.push(Term { hypothesis, variant: 0.0, parameters, prior_scale: 1.0 });
    Some(hypothesis)
}

/// Puts back what was named as outlying and, beside the causes that came after it, outweighs its kind no more; whether there was any. Of two
/// springs that were named one after the other neither may be alone.
pub(crate) fn put_back(
    (geometry, scene): (&Geometry, &Scene),
    catalogue: &Catalogue,
    named: &[usize],
    model: &mut Model,
) -> bool {
    let columns_of = |hypothesis: usize| -> Vec<usize> {
        let own = |column| single_effect(column).and_then(|(effect, place, _)| catalogue.find(effect, place));
        let all = geometry.group.columns.iter().enumerate();
        all.filter(|(_, column)| own(column) == Some(hypothesis)).map(|(k, _)| k).collect()
    };
    let mut all = model.group.clone();
    for term in model.terms.iter().filter(|t| named.contains(&t.hypothesis)) {
        columns_of(term.hypothesis).into_iter().zip(&term.parameters).for_each(|(k, value)| all[k] += value);
    }
    let square = |k: &usize| moves(scene, &geometry.group.columns[*k], all[*k]).powi(2);
    let kind = |k: usize| Kind::of(&geometry.group.columns[k]);
    let stays = |term: &Term| {
        let own = columns_of(term.hypothesis);
        let Some(&first) = own.first().filter(|_| named.contains(&term.hypothesis)) else { return true };
        let of_kind: Vec<usize> = (0..all.len()).filter(|&k| kind(k) == kind(first)).collect();
        let total = of_kind.iter().map(square).sum();
        outweighs(kind(first), own.iter().map(square).sum(), total, of_kind.len() / own.len())
    };
    let (kept, back): (Vec<Term>, Vec<Term>) = model.terms.drain(..).partition(stays);
    model.terms = kept;
    for term in &back {
        columns_of(term.hypothesis).into_iter().for_each(|k| model.group[k] = all[k]);
    }
    !back.is_empty()
}

/// The joint's zero that stands out of all others by so much that it is an error of its own: with it taken out, the others' spread is
/// so much smaller that the data are likelier. Values count by the share of them that the data tell.
///
/// `log BF = Σ_{j≠k} [ln N(μ_j; s₋ₖ) − ln N(μ_j; s)] − ln N(μ_k; s) + ln N(μ_k; σ₀) + ln P`, s and s₋ₖ the spreads with and without it,
/// σ₀ and P its prior as a cause.
pub(crate) fn standing_out(setup: &Geometry, catalogue: &Catalogue, fit: &Fit) -> Option<Term> {
    let first = fit.model.nuisances.len();
    let mut zeros: Vec<(usize, f64, f64)> = Vec::new();
    for (k, (column, prior)) in setup.group.columns.iter().zip(&setup.group.prior_std).enumerate() {
        let (Atom::Joint(_), Some((effect, place, _))) = (column.atom, single_effect(column)) else {
            continue;
        };
        let told = 1.0 - (fit.covariance[(first + k, first + k)] / (prior * prior)).clamp(0.0, 1.0);
        if let Some(h) = catalogue.find(effect, place)
            && !fit.model.terms.iter().any(|t| t.hypothesis == h)
        {
            zeros.push((h, fit.model.group[k], told));
        }
    }
    let spread = |but: Option<usize>| {
        let others = zeros.iter().enumerate().filter(|(i, _)| Some(*i) != but);
        let (sum, count) = others.fold((0.0, 0.0), |(s, c), (_, (_, v, told))| (s + v * v, c + told));
        setup.usual_zero(sum, count)
    };
    let log_normal = |v: f64, s: f64| -0.5 * (v / s).powi(2) - s.ln();
    let all = spread(None);
    let value = |k: usize| {
        let (h, own, _) = zeros[k];
        let rest = spread(Some(k));
        let others: f64 = zeros
            .iter()
            .enumerate()
            .filter(|(i, _)| *i != k)
            .map(|(_, (_, v, told))| told * (log_normal(*v, rest) - log_normal(*v, all)))
            .sum();
        let hypothesis = &catalogue.hypotheses[h];
        let own = log_normal(own, hypothesis.prior_std[0]) - log_normal(own, all);
        others + own + hypothesis.log_prior
    };
    let best = (0..zeros.len()).max_by(|&a, &b| value(a).total_cmp(&value(b)))?;
    (value(best) > LEAST_LOG_ODDS).then(|| Term {
        hypothesis: zeros[best].0,
        variant: 0.0,
        parameters: vec![0.0],
        prior_scale: 1.0,
    })
}
