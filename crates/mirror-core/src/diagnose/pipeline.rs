//! From a recording to a diagnosis: the order in which everything is tried, and what is said of it.

use crate::diagnose::assessment::evidence::{self, Sources};
use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::assessment::noise_floor::{is_no_noise, is_reached};
use crate::diagnose::assessment::other_session::check;
use crate::diagnose::assessment::survivors::keep_survivors;
use crate::diagnose::criteria::cross_validation::in_sample;
use crate::diagnose::criteria::lack_of_fit::adequacy;
use crate::diagnose::data::diagnosis::{Diagnosis, Verdict};
use crate::diagnose::data::recording::Recording;
use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::effects::own::own_effects;
use crate::diagnose::effects::{Stiction, vocabulary};
use crate::diagnose::likelihood::fit::Group;
use crate::diagnose::likelihood::noise;
use crate::diagnose::likelihood::score_test::screen;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::prepare::boards::leave_out_wrong_grids;
use crate::diagnose::prepare::false_observations::{MANY_FALSE, without_false};
use crate::diagnose::prepare::first_day;
use crate::diagnose::prepare::options::{DiagnoseOptions, OtherSession};
use crate::diagnose::prepare::row_slip;
use crate::diagnose::random_effects::free_form::free_forms;
use crate::diagnose::report::build;
use crate::diagnose::report::seen_markers::seen_markers;
use crate::diagnose::selection::alternatives::settled;
use crate::diagnose::selection::law_remainder::{MANY_CAUSES, only_their_laws};
use crate::diagnose::selection::nonparametric::{
    Unexplained, beside_free_forms, is_suspicious, retract_imitators, unexplained,
};
use crate::diagnose::selection::pairwise_start::from_a_pair;
use crate::diagnose::selection::restless::beside_restless_joint;
use crate::diagnose::selection::search::{Search, SearchOptions};
use crate::diagnose::selection::simplify::{comes_down, drop_useless, gaps, named_in_vain, without_names};
use crate::diagnose::selection::with_setup::{look_again_at_noise, with_or_without_setup};
use crate::diagnose::selection::with_tolerances::beside_geometry;
use crate::error::Result;
use crate::robot::Robot;
use std::sync::Arc;

/// Diagnoses a recording: where the model is wrong, which effect causes it, how far the gap shrinks.
///
/// In order: the noise from the data; slipped rows; the search for causes, with the set-up free where a few causes do not suffice; where there is reason for doubt, the same with
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
    problem.cancel = options.cancel.clone();
    problem.progress = options.progress.clone();
    options.progress.enter("looking for whole mistakes");
    let stated = problem.noise;
    let mut left_out = leave_out_wrong_grids(&mut problem);
    let given = problem.clone();
    let given_recording = recording;
    let undone = first_day::undone(robot, recording, &problem, &options.without)?;
    let (mut robot, mut recording) = (robot, recording);
    let (mut mistakes, mut trace) = (Vec::new(), Vec::new());
    if let Some(undone) = &undone {
        (robot, recording) = (&undone.robot, &undone.recording);
        problem = undone.problem.clone();
        problem.cancel = options.cancel.clone();
        problem.progress = options.progress.clone();
        options.progress.tell_mistakes(&undone.told);
        leave_out_wrong_grids(&mut problem);
        mistakes.clone_from(&undone.told);
        trace.clone_from(&undone.trace);
        left_out.extend(undone.left_out.iter().cloned());
    }
    let arranged = problem.clone();
    let nominal_deformation = problem.nominal();
    problem.noise = noise::estimate(&problem, &nominal_deformation, stated)?;
    let slip = if !options.allows("pairing") {
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
    if !options.allows("joint_compliance") {
        effects.retain(|e| e.name() != "stiction");
        effects.push(Box::new(Stiction { droops: false }));
    }
    effects.extend(own_effects(&options.own, &problem.scene)?);
    options.check_names(&effects)?;
    let catalogue =
        Catalogue::new(&problem.scene, effects.into_iter().map(Arc::from).collect(), &options.without);
    let all = Catalogue::with_free_forms(&catalogue, &problem.scene, free_forms(&problem.scene));
    let most_causes =
        if options.most_causes == 0 { SearchOptions::default().most_causes } else { options.most_causes };
    let search_options = SearchOptions { most_causes, ..SearchOptions::default() };
    let nominal = Model::nominal(&problem);
    let ranking = {
        let scatter = noise::effective(&problem, &nominal_deformation, problem.noise, None)?;
        screen(&problem, &catalogue, &Group::default(), &nominal, scatter, None)?
    };
    let mut search = Search {
        measured_noise: problem.noise,
        problem,
        catalogue: &catalogue,
        group: Group::default(),
        options: search_options,
        mask: None,
    };
    options.progress.enter("searching for causes");
    let (mut found, mut geometry) = with_or_without_setup(&mut search, &nominal, stated, &options.without)?;
    let freed = geometry.is_some();
    if !freed && let Some(other) = from_a_pair(&search, &found, &nominal)? {
        (search, found) = other;
    }
    // Wrong optics pass for noise of the markers until they are known, and a stated noise may be too large: look again at what is left.
    let deformation = found.fit.model.deformation(&search.problem, &catalogue, &search.group.columns);
    if !freed
        && (deformation.optics_differ() || search.problem.camera.is_none())
        && look_again_at_noise(&mut search, &found.fit.model, stated)?
    {
        let first = found.trace;
        found = search.run(found.fit.model.clone())?;
        found.trace.splice(0..0, first);
    }
    let (mut clean, mut false_share) =
        without_false(&search.problem, &search.deformation(&found.fit.model), found.noise)?;
    let mut fits_noise = adequacy(&clean, &search.deformation(&found.fit.model), search.measured_noise)?;
    let named = search.clone();
    let doubtful = fits_noise.significant && !freed;
    let many_false = false_share > MANY_FALSE;
    let enough = !fits_noise.significant && !fits_noise.corners_significant && !many_false;
    if !(freed && enough)
        && is_suspicious(&search, &found, &all, &fits_noise, many_false)?
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
    let mut restless = None;
    if doubtful && let Some(beside) = beside_restless_joint(&search, &found, &nominal)? {
        restless = Some(beside.node);
        (search, found) = (beside.search, beside.found);
        (clean, false_share) =
            without_false(&search.problem, &search.deformation(&found.fit.model), found.noise)?;
    }
    if restless.is_none()
        && options.allows("geometry")
        && (fits_noise.significant || found.fit.model.terms.len() > MANY_CAUSES)
    {
        if let Some(beside) = beside_geometry(&named, (&mut search, &mut found), &nominal)? {
            geometry = Some(beside.geometry);
            (search, found) = (beside.search, beside.found);
        }
        (clean, false_share) =
            without_false(&search.problem, &search.deformation(&found.fit.model), found.noise)?;
    }
    geometry = geometry.filter(|_| !found.fit.model.group.is_empty());
    options.progress.enter("weighing what was found");
    // From here on without the observations that the best model shows to be false.
    search.problem = clean;
    let (nominal_gap, mut after) = gaps(&search, &nominal, &found)?;
    drop_useless(&mut search, &mut found, &mut after, geometry.as_ref())?;
    comes_down(&search, &mut found, &mut after)?;
    let mut standings = settled(&search, &mut found, &mut after)?;
    let free = found.fit.model.terms.iter().any(|t| search.catalogue.is_free(t.hypothesis));
    let left = adequacy(&search.problem, &search.deformation(&found.fit.model), search.measured_noise)?;
    // Where the named causes reach the floor, a remainder of no structure is the noise's tails.
    let reached = found.fit.model.explains() && !free && is_reached(&search, &found.fit, &after)?;
    let unexplained = match restless {
        Some(node) => Some(Unexplained::restless(node)),
        None => unexplained(&search, &found, &left, reached)?,
    };
    // Nothing agrees with views that disagree among themselves.
    let loud = is_no_noise(search.measured_noise, stated).then(Unexplained::anywhere);
    let unexplained = unexplained.or(loud);
    if free {
        after = without_names(&search, &mut found, &mut standings)?;
    }
    if named_in_vain(&search, &found, &nominal_gap, &after) {
        found.trace.push("no cause is named: together they leave the held-out gap no smaller".into());
        found.fit = search.fit(&nominal, found.noise, 6)?;
        (geometry, after) = (None, nominal_gap.clone());
        standings.clear();
    }
    let before = if mistakes.is_empty() {
        nominal_gap
    } else {
        // The nominal model is that of the session as it was given.
        in_sample(&given, &given.nominal(), search.measured_noise)?
    };
    found.trace.splice(0..0, trace);
    let mut findings = Findings {
        search,
        found,
        geometry,
        slip,
        before,
        after,
        unexplained,
        false_share,
        standings,
        mistakes,
    };
    options.progress.enter("telling what it is worth");
    keep_survivors(&mut findings, &ranking)?;
    let mut checked = Vec::new();
    for other in others {
        checked.push(check(&findings, other)?);
    }
    let mut diagnosis = build::diagnosis(&mut findings, robot, recording, &ranking, checked)?;
    let sources =
        Sources { given: given_recording, undone: recording, arranged: &arranged, left_out: &left_out };
    diagnosis.data = evidence::data(&sources, &findings)?;
    if diagnosis.verdict == Verdict::None && evidence::much_is_false(&diagnosis.data) {
        diagnosis.sentence = evidence::what_is_false(&diagnosis.data);
        diagnosis.verdict = Verdict::Unknown;
    }
    let agrees_unseen = diagnosis.verdict == Verdict::None && !diagnosis.gap.is_told();
    if evidence::insufficient(&diagnosis.data) || agrees_unseen {
        diagnosis.sentence = evidence::what_is_missing(&diagnosis.data);
        diagnosis.verdict = Verdict::Insufficient;
        diagnosis.causes.clear();
        diagnosis.gap.steps.truncate(1);
        diagnosis.limits.clear();
        diagnosis.r#where.clear();
        diagnosis.signatures.clear();
        diagnosis.tracks.clear();
        diagnosis.fields.clear();
        diagnosis.next_postures.clear();
    }
    if options.markers {
        diagnosis.markers = seen_markers(&findings)?;
    }
    // Frames that were passed over on the way out left numbers that mean nothing.
    options.cancel.check()?;
    Ok(diagnosis)
}
