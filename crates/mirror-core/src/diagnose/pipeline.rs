//! From a recording to a diagnosis: the order in which everything is tried, and what is said of it.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::criteria::cross_validation::{PostureGap, held_out, in_sample, seen_size};
use crate::diagnose::criteria::lack_of_fit::adequacy;
use crate::diagnose::data::diagnosis::{Checked, Diagnosis};
use crate::diagnose::data::recording::Recording;
use crate::diagnose::effects::hypothesis::{Catalogue, Model, Term};
use crate::diagnose::effects::own::{OwnEffect, own_effects};
use crate::diagnose::effects::vocabulary;
use crate::diagnose::likelihood::fit::{FitOptions, fit};
use crate::diagnose::likelihood::noise;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::prepare::false_observations::{MANY_FALSE, without_false};
use crate::diagnose::prepare::row_slip;
use crate::diagnose::random_effects::free_form::free_forms;
use crate::diagnose::selection::alternatives::{Standing, settled};
use crate::diagnose::selection::nonparametric::{
    beside_free_forms, elsewhere, is_suspicious, retract_imitators, unexplained,
};
use crate::diagnose::selection::pairwise_start::from_a_pair;
use crate::diagnose::selection::search::{Found, Search, SearchOptions};
use crate::diagnose::selection::with_tolerances::beside_geometry;
use crate::error::Result;
use crate::robot::Robot;
use std::sync::Arc;

/// How to diagnose.
#[derive(Debug, Clone, Default)]
pub struct DiagnoseOptions {
    /// Effects that are switched off.
    pub without: Vec<String>,
    /// No more causes than this; 0 for the usual six.
    pub most_causes: usize,
    /// Further effects beside the vocabulary.
    pub own: Vec<OwnEffect>,
    /// Whether the markers are told posture by posture.
    pub markers: bool,
}

/// A further session on which the result is checked.
#[derive(Debug, Clone)]
pub struct OtherSession {
    /// Its name.
    pub name: String,
    /// Its robot.
    pub robot: Robot,
    /// What was recorded.
    pub recording: Recording,
    /// The options' own effects, with their weights in this session; those that are not here are not predicted.
    pub own: Vec<OwnEffect>,
}

/// More causes than this at once are rather many small errors.
const MANY_CAUSES: usize = 4;
/// A cause must shrink the held-out gap by this share, or it is dropped.
const LEAST_HELD_OUT_GAIN: f64 = 0.002;
/// Held-out gaps are larger than fitted ones: one that is already larger by so many times the least gain decides.
const SURELY_WORSE: f64 = 2.0;
/// The same beside many small errors, of which a cause must stand out.
const LEAST_HELD_OUT_GAIN_BESIDE_GEOMETRY: f64 = 0.02;
/// A remainder smaller than this share (squared: 8 %) of what the causes move is what their laws are wrong by.
const LAW_REMAINDER: f64 = 0.0064;
/// A cause beside free-form errors may leave the gap larger by this factor: it may be small beside them.
const NO_LARGER: f64 = 1.0005;
/// Diagnoses a recording: where the model is wrong, which effect causes it, how far the gap shrinks.
///
/// In order: the noise from the data; slipped rows; the search for causes; where there is reason for doubt, the same with
/// free-form errors beside the vocabulary; where that leaves a remainder or many causes, the same beside many small errors
/// (`geometry`); causes that do not help on held-out regions are dropped, improbable ones give way; the remainder is tested
/// against the noise.
///
/// # Errors
/// A recording that is not valid, links that do not exist, a camera that cannot be.
pub fn diagnose(
    robot: &Robot,
    recording: &Recording,
    options: &DiagnoseOptions,
    others: &[OtherSession],
) -> Result<Diagnosis> {
    let mut problem = Problem::new(robot, recording)?;
    let stated = problem.noise;
    let nominal_deformation = problem.nominal();
    problem.noise = noise::estimate(&problem, &nominal_deformation, stated)?;
    let slip = if options.without.iter().any(|w| w == "pairing") {
        None
    } else {
        let scatter = noise::effective(&problem, &nominal_deformation, problem.noise, None)?;
        row_slip::find(&problem, scatter)?
    };
    if let Some(slip) = slip {
        problem.leave_out(slip.first..=slip.last);
        problem.noise = noise::estimate(&problem, &nominal_deformation, stated)?;
    }
    let mut effects = vocabulary();
    if options.without.iter().any(|w| w == "joint_compliance") {
        effects.retain(|e| e.name() != "stiction");
        effects.push(Box::new(crate::diagnose::effects::Stiction { droops: false }));
    }
    effects.extend(own_effects(&options.own, &problem.scene)?);
    let catalogue =
        Catalogue::new(&problem.scene, effects.into_iter().map(Arc::from).collect(), &options.without);
    let all = Catalogue::with_free_forms(&catalogue, &problem.scene, free_forms(&problem.scene));
    let most_causes =
        if options.most_causes == 0 { SearchOptions::default().most_causes } else { options.most_causes };
    let search_options = SearchOptions { most_causes, ..SearchOptions::default() };
    let nominal = Model::nominal(&problem);
    let ranking = {
        let scatter = noise::effective(&problem, &nominal_deformation, problem.noise, None)?;
        crate::diagnose::likelihood::score_test::screen(
            &problem,
            &catalogue,
            &crate::diagnose::likelihood::fit::Group::default(),
            &nominal,
            scatter,
            None,
        )?
    };
    let mut search = Search {
        measured_noise: problem.noise,
        problem,
        catalogue: &catalogue,
        group: crate::diagnose::likelihood::fit::Group::default(),
        options: search_options,
        mask: None,
    };
    let mut found = search.run(nominal.clone())?;
    if let Some(other) = from_a_pair(&search, &found, &nominal)? {
        (search, found) = other;
    }
    // Wrong optics pass for noise of the markers until they are known: look again at the noise that is left.
    let deformation = found.fit.model.deformation(&search.problem, &catalogue, &search.group.columns);
    if deformation.optics_differ() {
        let again = noise::estimate(&search.problem, &deformation, stated)?;
        if again.marker_px < 0.9 * search.measured_noise.marker_px {
            search.measured_noise = again;
            search.problem.noise = again;
            let first = found.trace;
            found = search.run(found.fit.model.clone())?;
            found.trace.splice(0..0, first);
        }
    }
    let (mut clean, mut false_share) =
        without_false(&search.problem, &search.deformation(&found.fit.model), found.noise)?;
    let mut fits_noise = adequacy(&clean, &search.deformation(&found.fit.model), search.measured_noise)?;
    let named = search.clone();
    let many_false = false_share > MANY_FALSE;
    let enough = !fits_noise.significant && !fits_noise.corners_significant && !many_false;
    if is_suspicious(&search, &found, &all, &fits_noise, many_false)?
        && let Some((its_search, its_found)) = beside_free_forms(&search, &found, &all, &nominal, enough)?
        && !only_their_laws(&search, &found, (&its_search, &its_found), &all)?
    {
        search = its_search;
        found = its_found;
        retract_imitators(&search, &mut found)?;
        (clean, false_share) =
            without_false(&search.problem, &search.deformation(&found.fit.model), found.noise)?;
        fits_noise = adequacy(&clean, &search.deformation(&found.fit.model), search.measured_noise)?;
    }
    let mut geometry = None;
    let off = options.without.iter().any(|w| w == "geometry");
    if !off && (fits_noise.significant || found.fit.model.terms.len() > MANY_CAUSES) {
        if let Some(beside) = beside_geometry(&named, (&mut search, &mut found), &nominal)? {
            geometry = Some(beside.geometry);
            search = beside.search;
            found = beside.found;
        }
        (clean, false_share) =
            without_false(&search.problem, &search.deformation(&found.fit.model), found.noise)?;
        fits_noise = adequacy(&clean, &search.deformation(&found.fit.model), search.measured_noise)?;
    }
    // From here on without the observations that the best model shows to be false.
    search.problem = clean;
    let (before, mut after) = gaps(&search, &nominal, &found)?;
    drop_useless(&mut search, &mut found, &mut after)?;
    comes_down(&search, &mut found, &mut after)?;
    let mut standings = settled(&search, &mut found, &mut after)?;
    let free = found.fit.model.terms.iter().any(|t| search.catalogue.is_free(t.hypothesis));
    let by_laws = !free
        && found.fit.model.terms.len() <= MANY_CAUSES
        && remainder_share(&search, &found, &after, None)? < LAW_REMAINDER;
    let unexplained = if by_laws { None } else { unexplained(&search, &found, &fits_noise)? };
    if free {
        after = without_names(&search, &mut found, &mut standings, &before)?;
    }
    let mut findings =
        Findings { search, found, geometry, slip, before, after, unexplained, false_share, standings };
    let mut checked = Vec::new();
    for other in others {
        checked.push(check(&findings, other)?);
    }
    let mut diagnosis =
        crate::diagnose::report::build::diagnosis(&mut findings, robot, recording, &ranking, checked)?;
    if options.markers {
        diagnosis.markers = crate::diagnose::report::seen_markers::seen_markers(&findings)?;
    }
    Ok(diagnosis)
}

/// Whether free-form errors only say that the causes found have not quite their textbook laws: they sit at the causes' own
/// places, and what they take up beyond the causes is a small part of what the causes move.
fn only_their_laws(
    search: &Search<'_>,
    found: &Found,
    (its_search, with_free): (&Search<'_>, &Found),
    all: &Catalogue,
) -> Result<bool> {
    let terms = found.fit.model.terms.len();
    if !(1..=MANY_CAUSES).contains(&terms)
        || terms > with_free.fit.model.terms.len()
        || elsewhere(all, &with_free.fit.model, &found.fit.model)
    {
        return Ok(false);
    }
    let after = search.held_out(&found.fit.model, found.noise)?;
    let after_free = its_search.held_out(&with_free.fit.model, with_free.noise)?;
    Ok(remainder_share(search, found, &after, Some(&after_free))? < LAW_REMAINDER)
}

fn gaps(search: &Search<'_>, nominal: &Model, found: &Found) -> Result<(Vec<PostureGap>, Vec<PostureGap>)> {
    let none = crate::diagnose::likelihood::fit::Group::default();
    let scatter = search.effective(nominal)?;
    let measured = search.measured_noise;
    let before = held_out(&search.problem, search.catalogue, &none, nominal, scatter, measured, false)?;
    let after = search.held_out(&found.fit.model, found.noise)?;
    Ok((before, after))
}

/// Calls causes by the simpler name that they come down to: stiction without a dead band is compliance.
fn comes_down(search: &Search<'_>, found: &mut Found, after: &mut Vec<PostureGap>) -> Result<()> {
    let catalogue = search.catalogue;
    let mut model = found.fit.model.clone();
    let mut changed = false;
    for term in &mut model.terms {
        let place = catalogue.hypotheses[term.hypothesis].place;
        let Some((effect, parameters)) = catalogue.effect(term.hypothesis).comes_down_to(&term.parameters)
        else {
            continue;
        };
        if let Some(hypothesis) = catalogue.find(effect, place) {
            *term = Term { hypothesis, variant: 0.0, parameters, prior_scale: 1.0 };
            changed = true;
        }
    }
    if changed {
        found.fit = search.fit(&model, found.noise, 8)?;
        *after = search.held_out(&found.fit.model, found.noise)?;
    }
    Ok(())
}

/// Drops causes that do not help where they were not fitted.
fn drop_useless(search: &mut Search<'_>, found: &mut Found, after: &mut Vec<PostureGap>) -> Result<()> {
    let least = if search.group.columns.is_empty() {
        LEAST_HELD_OUT_GAIN
    } else {
        LEAST_HELD_OUT_GAIN_BESIDE_GEOMETRY
    };
    let mut i = 0;
    while i < found.fit.model.terms.len() {
        let without = search.fit(&found.fit.model.without(i), found.noise, 6)?;
        // Where even the fitted postures are worse off, those held out need not be looked at.
        let fitted = in_sample(&search.problem, &search.deformation(&without.model), search.measured_noise)?;
        if seen_size(&fitted) >= seen_size(after) * (1.0 + SURELY_WORSE * least) {
            i += 1;
            continue;
        }
        let gap = search.held_out(&without.model, found.noise)?;
        if seen_size(&gap) < seen_size(after) * (1.0 + least) {
            let name = search.catalogue.name(&search.problem.scene, found.fit.model.terms[i].hypothesis);
            found.trace.push(format!("drop {name}: no gain on held-out regions"));
            found.fit = without;
            *after = gap;
            i = 0;
        } else {
            i += 1;
        }
    }
    Ok(())
}

/// The held-out gap of the named causes alone: what has no name cannot be added to a model, so what it leaves is left. A cause
/// that makes the gap no smaller by itself only served the free-form errors, and is taken back.
fn without_names(
    search: &Search<'_>,
    found: &mut Found,
    standings: &mut Vec<Option<Standing>>,
    before: &[PostureGap],
) -> Result<Vec<PostureGap>> {
    let is_free = |t: &Term| search.catalogue.is_free(t.hypothesis);
    let gap_of = |model: &Model| -> Result<Vec<PostureGap>> {
        let mut causes = model.clone();
        causes.terms.retain(|t| !is_free(t));
        if causes.terms.is_empty() && causes.group.is_empty() {
            return Ok(before.to_vec());
        }
        search.held_out(&causes, found.noise)
    };
    let mut model = found.fit.model.clone();
    let mut after = gap_of(&model)?;
    let mut i = 0;
    while i < model.terms.len() {
        let rest = model.without(i);
        if is_free(&model.terms[i]) {
            i += 1;
            continue;
        }
        let without = gap_of(&rest)?;
        if seen_size(&after) <= seen_size(&without) * NO_LARGER {
            i += 1;
            continue;
        }
        let name = search.catalogue.name(&search.problem.scene, model.terms[i].hypothesis);
        found.trace.push(format!("drop {name}: by itself it does not make the gap smaller"));
        (model, after) = (rest, without);
        standings.remove(i);
        i = 0;
    }
    if model.terms.len() < found.fit.model.terms.len() {
        found.fit = search.fit(&model, found.noise, 8)?;
    }
    if model.group.is_empty() && model.terms.iter().all(is_free) {
        return Ok(after);
    }
    // The gap that is claimed is that of the parameters that are claimed: those found beside what has no name.
    let (s, measured) = (search, search.measured_noise);
    held_out(&s.problem, s.catalogue, &s.group, &found.fit.model, found.noise, measured, true)
}

/// What is left above the noise (or above `least`, another model's remainder), squared, as a share of what the causes move.
fn remainder_share(
    search: &Search<'_>,
    found: &Found,
    after: &[PostureGap],
    least: Option<&[PostureGap]>,
) -> Result<f64> {
    let mut none = found.fit.model.clone();
    none.terms.clear();
    none.group.iter_mut().for_each(|g| *g = 0.0);
    let noise = search.measured_noise;
    let (from, to) = (search.deformation(&none), search.deformation(&found.fit.model));
    let moved = crate::diagnose::criteria::marker_shift::marker_shift(&search.problem, &from, &to, noise)?;
    let moved = moved.iter().sum::<f64>() / moved.len().max(1) as f64;
    let unit = if search.problem.camera.is_some() { noise.marker_px } else { noise.point_m };
    let axes = if search.problem.camera.is_some() { 2.0 } else { 3.0 };
    let square = |gaps: &[PostureGap]| (seen_size(gaps) / unit).powi(2);
    let left = square(after) - least.map_or(axes, |gaps| square(gaps).max(axes));
    Ok(if moved > 0.0 { left.max(0.0) / moved } else { f64::INFINITY })
}

/// Predicts another session with the causes as they were found; only its own nuisances are fitted.
fn check(findings: &Findings<'_>, other: &OtherSession) -> Result<Checked> {
    let recording = other.recording.clone().validated(other.robot.position_count())?;
    let mut problem = Problem::new(&other.robot, &recording)?;
    let nominal_deformation = problem.nominal();
    problem.noise = noise::estimate(&problem, &nominal_deformation, problem.noise)?;
    let here = &findings.search;
    let mut effects = vocabulary();
    effects.extend(own_effects(&other.own, &problem.scene)?);
    let catalogue = Catalogue::new(&problem.scene, effects.into_iter().map(Arc::from).collect(), &[]);
    let mut model = Model::nominal(&problem);
    model.frozen = true;
    let none = crate::diagnose::likelihood::fit::Group::default();
    let measure =
        |problem: &Problem, model: &Model, group: &crate::diagnose::likelihood::fit::Group| -> Result<f64> {
            let mut model = model.clone();
            let mut problem = problem.clone();
            for _ in 0..2 {
                let deformation = model.deformation(&problem, &catalogue, &group.columns);
                problem.scene.update_loads(&deformation);
                let scatter = noise::effective(&problem, &deformation, problem.noise, None)?;
                model =
                    fit(&problem, &catalogue, group, &model, FitOptions { noise: scatter, steps: 6 }, None)?
                        .model;
            }
            let deformation = model.deformation(&problem, &catalogue, &group.columns);
            let postures = crate::diagnose::likelihood::saturated::free_markers(
                &problem,
                &deformation,
                problem.noise,
                true,
                None,
            )?;
            let (sum, count) = postures
                .iter()
                .flat_map(|p| &p.markers)
                .fold((0.0, 0.0), |(s, c), m| (s + m.displacement.norm_squared(), c + 1.0));
            Ok((sum / f64::max(count, 1.0)).sqrt())
        };
    let before_m = measure(&problem, &model, &none)?;
    model.terms = findings
        .found
        .fit
        .model
        .causes_in((here.catalogue, &here.problem.scene), (&catalogue, &problem.scene));
    let group =
        if here.group.columns.iter().all(|c| problem.has_atom(c.atom)) { here.group.clone() } else { none };
    if group.columns.len() == findings.found.fit.model.group.len() {
        model.group.clone_from(&findings.found.fit.model.group);
    }
    let after_m = measure(&problem, &model, &group)?;
    Ok(Checked { session: other.name.clone(), before_m, after_m })
}
