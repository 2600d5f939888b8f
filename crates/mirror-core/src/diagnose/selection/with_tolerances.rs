//! The search for causes together with small errors everywhere: a real robot has both, and neither may hide the
//! other or be taken for it.

use crate::diagnose::criteria::cross_validation::seen_size;
use crate::diagnose::criteria::lack_of_fit::adequacy;
use crate::diagnose::criteria::marker_shift::marker_shift;
use crate::diagnose::effects::hypothesis::{Model, Term};
use crate::diagnose::likelihood::fit::{FitOptions, fit};
use crate::diagnose::likelihood::linearised::Linearised;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::{
    ABOVE_SCATTER, BEYOND_DOUBT, Grid, LEAST_HELD_OUT_RATIO, LEAST_LOG_ODDS, LOG_PRIOR_STRUCTURE, MAJORITY,
    SEVERAL_CAUSES, Threshold,
};
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::random_effects::law_columns::LAW_SHARE;
use crate::diagnose::random_effects::outlier_tolerances::{name_outlying, put_back};
use crate::diagnose::random_effects::small_errors::Kind;
use crate::diagnose::selection::large_members::choose_members;
use crate::diagnose::selection::linear_search::by_linear_models;
use crate::diagnose::selection::nonparametric::{Unexplained, log_odds, retract_imitators, unexplained};
use crate::diagnose::selection::search::{Found, Search};
use crate::diagnose::selection::tolerance_rounds::{linear_rounds, one_at_a_time};
use crate::error::Result;

/// Minimum effective number of values for a scale of the small errors: it is known to better than a half.
pub(crate) const FEWEST_TOLD: Threshold = 2.5;

/// The causes found together with small errors everywhere.
pub(crate) struct BesideGeometry<'a> {
    pub geometry: Geometry,
    pub search: Search<'a>,
    pub found: Found,
    /// Places where free-form errors explain more than the small errors.
    pub unnamed: Option<Unexplained>,
    /// The evidence for the small errors is twice what their prior requires.
    pub settled: bool,
}

/// The search together with small errors everywhere; none where what was found without them explains the data
/// better. Causes that it finds among the small errors, and that without the small errors are better than what was
/// found before, replace that.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn beside_geometry<'a>(
    named: &Search<'a>,
    (its_search, alone): (&mut Search<'a>, &mut Found),
    nominal: &Model,
) -> Result<Option<BesideGeometry<'a>>> {
    let mut geometry = Geometry::new(&named.problem, named.catalogue, !named.group.columns.is_empty());
    if geometry.group.columns.is_empty() || named.problem.budget.is_spent() {
        return Ok(None);
    }
    let mut search = Search { group: geometry.group.clone(), ..named.clone() };
    // Scales first at the scatter that single causes leave, then with the outliers of the group as causes.
    let at = |noise, steps| FitOptions { noise, steps };
    let mut start = geometry.fit(&named.problem, named.catalogue, nominal, at(alone.noise, 6), named.mask)?;
    let in_rounds = match by_linear_models(&named.problem, Some(&geometry)) {
        Some(_) => linear_rounds((&mut search, &mut geometry), &mut start, alone)?,
        None => None,
    };
    let mut found = match in_rounds {
        Some(found) => found,
        None => one_at_a_time((&mut search, &mut geometry), start.model)?,
    };
    let noise = found.noise;
    let mut start = found.fit.model.clone();
    let (scene, mut hidden) = (&named.problem.scene, Vec::new());
    for _ in 0..SOLVER.rounds {
        let Some(outlying) = name_outlying((&geometry, scene), named.catalogue, &mut start) else { break };
        hidden.push(outlying);
        start = geometry.fit(&search.problem, named.catalogue, &start, at(noise, 6), named.mask)?.model;
        search.group = geometry.group.clone();
    }
    found.fit = fit(&search.problem, named.catalogue, &search.group, &start, at(noise, 6), named.mask)?;
    // Causes that the spreads found last make needless.
    found.fit = search.prune(found.fit, noise, &mut found.trace)?.0;
    if !named.problem.budget.is_spent() {
        drop_tolerances(&search, &geometry, &mut found)?;
    }
    let mut model = found.fit.model.clone();
    if put_back((&geometry, scene), named.catalogue, &hidden, &mut model) {
        found.fit = geometry.fit(&search.problem, named.catalogue, &model, at(noise, 4), named.mask)?;
        search.group = geometry.group.clone();
    }
    choose_members((&mut search, &mut geometry), &mut found, nominal)?;
    if !hidden.is_empty() {
        // The outliers alone may explain everything.
        let mut bare = named.clone();
        let causes = Model { group: vec![0.0; named.group.columns.len()], ..found.fit.model.clone() };
        let mut without = bare.run(causes)?;
        if log_odds((&bare, &without), (its_search, alone))? > 0.0 {
            alone
                .trace
                .push("outliers of the small errors as single causes, without the small errors:".into());
            alone.trace.append(&mut without.trace);
            without.trace = core::mem::take(&mut alone.trace);
            (*its_search, *alone) = (bare, without);
        }
    }
    let odds = log_odds((&search, &found), (its_search, alone))? + LOG_PRIOR_STRUCTURE;
    // A scale from a few values says nothing about many.
    let known = geometry.told(&found.fit) > FEWEST_TOLD;
    let mut better = odds > 0.0 && known;
    let mut unnamed = None;
    let mut told = format!(
        "with small errors everywhere (scale {:.3} mm, {:.3} mrad): log odds {odds:.1}",
        geometry.spread(Kind::Length) * 1e3,
        geometry.spread(Kind::Angle) * 1e3
    );
    let free = alone.fit.model.terms.iter().any(|t| its_search.catalogue.is_free(t.hypothesis));
    // Many pieces together can imitate what they are not. They were selected on the same regions that are held out;
    // the group was not. So their better prediction does not outweigh evidence for the group that is twice what its
    // prior requires. The group's better prediction may outweigh evidence.
    let in_pieces = places(its_search, alone, |_| true) >= SEVERAL_CAUSES;
    let pieces = in_pieces && odds > -BEYOND_DOUBT;
    // So can fewer of them where no views show the noise of measured points: what they leave is taken for noise.
    let few = its_search.problem.camera.is_none() && !alone.fit.model.terms.is_empty();
    let settled = better && (pieces || few) && !free && odds > -LOG_PRIOR_STRUCTURE;
    if !settled && (better || pieces || free) {
        let with = seen_size(&search.held_out(&found.fit.model, found.noise)?);
        let without = seen_size(&its_search.held_out(&alone.fit.model, alone.noise)?);
        // What is told beside free-form errors: no causes that imitate them.
        let mut named = alone.clone();
        retract_imitators(its_search, &mut named)?;
        let told_without = match named.fit.model.terms.len() < alone.fit.model.terms.len() {
            true => seen_size(&its_search.held_out(&named.fit.model, named.noise)?),
            false => without,
        };
        // One of several pieces may have no name: evidence for the group that is twice what its prior requires stands, unless it is refuted.
        let likelier = better && in_pieces && odds > -LOG_PRIOR_STRUCTURE && !is_refuted(with, without);
        better = if likelier || free && known && is_refuted(told_without, with) {
            true
        } else {
            (better || pieces) && with < LEAST_HELD_OUT_RATIO * without
        };
        // One error of no name at one place is an answer; errors in many places are the small errors' pieces.
        let is_free = |t: &Term| its_search.catalogue.is_free(t.hypothesis);
        if !better && known && in_pieces && places(its_search, alone, is_free) > 1 {
            // Free-form errors that fit better cannot be added to a model.
            let named_alone = seen_size(&its_search.held_out_of_causes(&named.fit.model, named.noise)?);
            if with < MAJORITY * named_alone {
                better = true;
                let left = its_search.deformation(&alone.fit.model);
                let left = adequacy(&its_search.problem, &left, its_search.measured_noise)?;
                unnamed = unexplained(its_search, alone, &left, false)?;
            }
        }
        told += &format!(", held-out gap {:.3} times that without them", with / without.max(1e-30));
    }
    let mut trace = alone.trace.clone();
    trace.append(&mut found.trace);
    trace.push(told);
    alone.trace.clone_from(&trace);
    found.trace = trace;
    Ok((better && matters(&search, &found)?).then_some(BesideGeometry {
        geometry,
        search,
        found,
        unnamed,
        settled,
    }))
}

/// Whether several causes without free-form errors are more probable together with small errors everywhere, by one
/// linear model at the causes found: the evidence with the group at its usual scales, or at smaller ones, against
/// none.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn small_errors_help(search: &Search<'_>, found: &Found) -> Result<bool> {
    let model = &found.fit.model;
    let free = model.terms.iter().any(|t| search.catalogue.is_free(t.hypothesis));
    if free || model.terms.len() < SEVERAL_CAUSES || search.problem.budget.is_spent() {
        return Ok(false);
    }
    Ok(gain_of_small_errors(search, found)? > LEAST_LOG_ODDS)
}

/// How much more probable the causes found are together with small errors everywhere, by one linear model: the log evidence with
/// these at their usual spreads, or at smaller ones, whichever is largest, less that with none.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn gain_of_small_errors(search: &Search<'_>, found: &Found) -> Result<f64> {
    let model = &found.fit.model;
    let geometry = Geometry::new(&search.problem, search.catalogue, false);
    let mut group = search.group.clone();
    let own = group.columns.len();
    for (column, std) in geometry.group.columns.iter().zip(&geometry.group.prior_std) {
        if !group.columns.iter().any(|c| c == column) {
            group.columns.push(column.clone());
            group.prior_std.push(*std);
        }
    }
    let mut wider = model.clone();
    wider.group.resize(group.columns.len(), 0.0);
    let options = FitOptions { noise: found.noise, steps: 0 };
    let here = Linearised::at(&search.problem, search.catalogue, &group, &wider, options, search.mask)?;
    let added = here.first_group() + own..here.first_group() + group.columns.len();
    let value = |scale: f64| here.log_evidence(added.clone(), scale).unwrap_or(f64::NEG_INFINITY);
    let none = value(NEXT_TO_NONE);
    Ok(SPREADS.iter().map(|&scale| value(scale) - none).fold(f64::NEG_INFINITY, f64::max))
}

/// Spreads that are tried, in units of the usual ones, and one at which the group is as good as not there.
const SPREADS: [Grid; 3] = [1.0, 0.3, 0.1];
const NEXT_TO_NONE: Grid = 1e-4;

/// Drops errors of gears that vary no more than the tolerance of every joint, unless held-out regions need them: a small
/// eccentricity of one gear may be the largest law that the small errors lack.
fn drop_tolerances(search: &Search<'_>, geometry: &Geometry, found: &mut Found) -> Result<()> {
    let frames = 0..search.problem.scene.frames;
    let within = |term: &Term| {
        let node = search.catalogue.hypotheses[term.hypothesis].place.node();
        let Some(node) = node.filter(|_| search.catalogue.effect(term.hypothesis).is_tolerance()) else {
            return false;
        };
        let alone = Model { terms: vec![term.clone()], ..Model::nominal(&search.problem) };
        let error = search.deformation(&alone);
        let (low, high) = frames
            .clone()
            .map(|f| error.joint_delta(f, node))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
        !search.problem.scene.body.nodes[node].prismatic
            && 0.5 * (high - low) < ABOVE_SCATTER * geometry.spread(Kind::Angle)
    };
    let mut rest = found.fit.model.clone();
    let scene = &search.problem.scene;
    rest.terms.retain(|t| !within(t));
    if rest.terms.len() < found.fit.model.terms.len() {
        let fit = search.fit(&rest, found.noise, SOLVER.loose_steps)?;
        let with = seen_size(&search.held_out(&found.fit.model, found.noise)?);
        if with < LEAST_HELD_OUT_RATIO * seen_size(&search.held_out(&fit.model, found.noise)?) {
            return Ok(());
        }
        for term in found.fit.model.terms.iter().filter(|t| within(t)) {
            let name = search.catalogue.name(scene, term.hypothesis);
            found.trace.push(format!("drop {name}: no larger than the scale of the small errors"));
        }
        found.fit = fit;
    }
    Ok(())
}

/// Whether a model is refuted by held-out prediction: the other one predicts the regions on which nothing was fitted to less than half of its
/// gap. However well free-form errors fit, the robot has others then.
fn is_refuted(its_gap: f64, other_gap: f64) -> bool {
    other_gap < MAJORITY * its_gap
}

/// How many different places those of the causes and free-form errors have that are `counted`.
fn places(search: &Search<'_>, found: &Found, counted: impl Fn(&Term) -> bool) -> usize {
    let mut seen = Vec::new();
    for term in found.fit.model.terms.iter().filter(|t| counted(t)) {
        let place = search.catalogue.hypotheses[term.hypothesis].place;
        let at = place.node().map_or_else(|| Err(place), Ok);
        if !seen.contains(&at) {
            seen.push(at);
        }
    }
    seen.len()
}

/// A group that moves almost nothing in addition to the causes only absorbs the errors of their laws.
fn matters(search: &Search<'_>, found: &Found) -> Result<bool> {
    let all = search.deformation(&found.fit.model);
    let mut bare = found.fit.model.clone();
    bare.group.iter_mut().for_each(|g| *g = 0.0);
    let only_causes = search.deformation(&bare);
    bare.terms.clear();
    let neither = search.deformation(&bare);
    let sum = |from, to| -> Result<f64> {
        Ok(marker_shift(&search.problem, from, to, search.measured_noise)?.iter().sum())
    };
    Ok(sum(&only_causes, &all)? > LAW_SHARE.powi(2) * sum(&neither, &only_causes)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn free_forms_are_refuted_by_a_prediction_twice_as_good() {
        assert!(is_refuted(1.48, 0.53));
        assert!(!is_refuted(1.0, 0.6));
        assert!(!is_refuted(1.0, 1.0));
        // A gap that could not be computed refutes nothing.
        assert!(!is_refuted(f64::NAN, 0.5));
        assert!(!is_refuted(1.0, f64::NAN));
    }
}
