//! Standard deviations of the causes' parameters, and how far model errors would move their values.
//!
//! The standard deviation of a parameter is the largest of: the fit's; that of a fit with discrepancy terms of the laws and with
//! correlated noise; that of a fit in which springs stiffen. Added to it is how far the last two move the value, and how far real
//! joints are known to depart from a law without the data showing it. The noise is what the whole model leaves, where that is
//! more than the estimate. [`super::resample_deviations`] and [`super::further_cause`] widen them where the model may not hold.
//!
//! A compliance is reported for small loads. A spring that stiffens, `δ = c τ (1 − s τ²/τ_max²)`, is softer there
//! than the linear law that fits best: s is fitted together with c, and the value moves by the difference of the two
//! laws. A link does not bend exactly in its middle: it is fitted with the bend off the middle, and the value moves
//! with the lever arm.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::assessment::noise_floor::Floor;
use crate::diagnose::criteria::marker_shift::marker_shift;
use crate::diagnose::effects::hypothesis::Term;
use crate::diagnose::effects::{LawFreedom, Place};
use crate::diagnose::likelihood::fit::{Fit, FitOptions, Group, fit};
use crate::diagnose::likelihood::noise::effective;
use crate::diagnose::likelihood::noise_correlation;
use crate::diagnose::model::elementary::{Atom, Column, Weight, transverse_moment};
use crate::diagnose::model::problem::Noise;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::Prior;
use crate::error::Result;

/// By how much a spring may be stiffer under its largest load than when hardly loaded: one standard deviation of s.
const STIFFENING_STD: Prior = 0.15;

/// By how much of its way from the joint to the middle a link's bend may be off: 5 % of the link's length.
const OFF_THE_MIDDLE: Prior = 0.1;

/// Of each term of a model.
#[derive(Debug, Clone, Default)]
pub(crate) struct Deviations {
    /// Standard deviations of its parameters.
    pub stds: Vec<Vec<f64>>,
    /// The same of the group of small errors and of the mounts, column by column.
    pub group: Vec<f64>,
    /// Mean square shift of the markers (px², or m² where points were measured) by possible errors of the laws, one
    /// entry for each parameter whose law is not exact.
    pub law_shifts: Vec<f64>,
}

/// The standard deviations of what was found.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn deviations(findings: &Findings<'_>, floor: &Floor) -> Result<Deviations> {
    let search = &findings.search;
    let found = &findings.found;
    let all = search.deformation(&found.fit.model);
    let mut seen = if search.noise_widening > 1.0 && search.scatter.is_none() {
        // Of one observation; its correlation with its neighbours is allowed for below, over all frames.
        effective(&search.problem, &all, search.noise_of_views(), None)?
    } else {
        found.noise
    };
    let left = search.detector_noise().marker_px * floor.fitted_scale;
    seen.marker_px = seen.marker_px.max(left);
    let noise = noise_correlation::of_means(&search.problem, &all, seen)?;
    let loose = search.fit_with_slack(&found.fit.model, None, noise, SOLVER.loose_steps)?;
    let stiffening = fit_of_stiffening(findings, noise)?;
    let measured = search.measured_noise;
    let unit = search.problem.of_observations(measured);
    let mut out = Deviations { group: of_group(&found.fit, &loose), ..Deviations::default() };
    for (i, term) in found.fit.model.terms.iter().enumerate() {
        let effect = search.catalogue.effect(term.hypothesis);
        let own_law = effect.law_freedom() != LawFreedom::Exact || effect.law_uncertainty() > 0.0;
        let (exact, slack) = (found.fit.stds(i), loose.stds(i));
        let by_place = elsewhere_bent(findings, term, noise)?;
        let by_place = by_place.as_ref();
        let mut stds = Vec::with_capacity(exact.len());
        for (k, value) in term.parameters.iter().enumerate() {
            let moved = value - loose.model.terms[i].parameters[k];
            let mut std = exact[k].max(slack[k]);
            let mut moved = moved.abs();
            if let Some(fit) = stiffening.as_ref().filter(|_| may_stiffen(effect.law_freedom())) {
                std = std.max(fit.stds(i)[k]);
                moved = moved.max((value - fit.model.terms[i].parameters[k]).abs());
            }
            let std =
                std.hypot(moved).hypot(by_place.map_or(0.0, |fit| value - fit.model.terms[i].parameters[k]));
            let std = std.hypot(effect.law_uncertainty() * value);
            stds.push(std);
            let beyond = (std * std - exact[k] * exact[k]).max(0.0).sqrt();
            if own_law && beyond > 0.0 && !search.catalogue.is_free(term.hypothesis) {
                let mut other = found.fit.model.clone();
                other.terms[i].parameters[k] += beyond;
                let shifts = marker_shift(&search.problem, &all, &search.deformation(&other), measured)?;
                out.law_shifts.push(shifts.iter().sum::<f64>() / shifts.len().max(1) as f64 * unit * unit);
            }
        }
        out.stds.push(stds);
    }
    Ok(out)
}

/// Standard deviations of the group's values: the fit's, or those with discrepancy terms and correlated noise,
/// including how far these move the values.
fn of_group(exact: &Fit, loose: &Fit) -> Vec<f64> {
    let first = exact.model.nuisances.len();
    let variance = |fit: &Fit, k: usize| fit.covariance[(first + k, first + k)].max(0.0);
    let values = exact.model.group.iter().zip(&loose.model.group).enumerate();
    values.map(|(k, (a, b))| variance(exact, k).max(variance(loose, k)).sqrt().hypot(a - b)).collect()
}

/// The model fitted once more with a link's bend off its middle; none where the term is no bending link.
fn elsewhere_bent(findings: &Findings<'_>, term: &Term, noise: Noise) -> Result<Option<Fit>> {
    let here = &findings.search;
    let Place::Link(Some(node)) = here.catalogue.hypotheses[term.hypothesis].place else { return Ok(None) };
    let effect = here.catalogue.effect(term.hypothesis);
    if effect.law_freedom() != LawFreedom::Moment || here.catalogue.is_free(term.hypothesis) {
        return Ok(None);
    }
    let model = &findings.found.fit.model;
    let mut search = here.clone();
    search.problem.scene.body.nodes[node].bend_pivot *= 1.0 + OFF_THE_MIDDLE;
    let deformation = search.deformation(model);
    search.problem.scene.update_loads(&deformation);
    search.fit(model, noise, SOLVER.loose_steps).map(Some)
}

/// Whether a law is that of a spring.
fn may_stiffen(freedom: LawFreedom) -> bool {
    matches!(freedom, LawFreedom::Load | LawFreedom::Moment)
}

/// The model fitted once more with every spring free to stiffen; none where there is no spring.
fn fit_of_stiffening(findings: &Findings<'_>, noise: Noise) -> Result<Option<Fit>> {
    let search = &findings.search;
    let model = &findings.found.fit.model;
    let scene = &search.problem.scene;
    let mut group = if model.group.is_empty() { Group::default() } else { search.group.clone() };
    let before = group.columns.len();
    for term in &model.terms {
        let effect = search.catalogue.effect(term.hypothesis);
        let place = search.catalogue.hypotheses[term.hypothesis].place;
        let (Some(node), Some(compliance)) = (place.node(), term.parameters.first()) else { continue };
        let free = search.catalogue.is_free(term.hypothesis);
        if free || !may_stiffen(effect.law_freedom()) || *compliance <= 0.0 {
            continue;
        }
        let loads: Vec<f64> = match place {
            Place::Link(_) => (0..scene.frames).map(|f| transverse_moment(scene, f, node).norm()).collect(),
            _ => (0..scene.frames).map(|f| scene.torque(f, node)).collect(),
        };
        let largest = loads.iter().fold(0.0, |most: f64, load| most.max(load.abs()));
        if largest <= 0.0 {
            continue;
        }
        let share = |load: &f64| (load / largest).powi(2);
        let (atom, weights) = match place {
            // A bend's column has the moment in it.
            Place::Link(_) => (Atom::Bend(node), loads.iter().map(share).collect()),
            _ => (Atom::Joint(node), loads.iter().map(|load| load * share(load)).collect()),
        };
        group.columns.push(Column { atom, weight: Weight::Frames(weights) });
        group.prior_std.push(STIFFENING_STD * compliance);
    }
    if group.columns.len() == before {
        return Ok(None);
    }
    let mut start = model.clone();
    start.group.resize(group.columns.len(), 0.0);
    let options = FitOptions { noise, steps: SOLVER.loose_steps };
    fit(&search.problem, search.catalogue, &group, &start, options, search.mask).map(Some)
}
