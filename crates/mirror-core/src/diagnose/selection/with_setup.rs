//! The search for causes with free mounts: parts that were mounted by hand are slightly displaced from the URDF.
//! This must neither hide a cause of the robot nor be taken for one.
//!
//! The mounts of board, camera and markers and the joints' zeros are random effects of every model fitted here: each
//! hypothesis is scored with all of them projected out at their scales, each candidate is fitted together with them.
//! The scales are estimated where they are not stated. Where the data are as probable without any of it, the search
//! without free mounts is the answer.

use crate::diagnose::criteria::lack_of_fit::adequacy;
use crate::diagnose::effects::hypothesis::Model;
use crate::diagnose::likelihood::fit::FitOptions;
use crate::diagnose::likelihood::noise;
use crate::diagnose::model::problem::Noise;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::model::work_budget::A_STAGE;
use crate::diagnose::prepare::false_observations::without_false;
use crate::diagnose::principles::{LOG_PRIOR_STRUCTURE, SEVERAL_CAUSES, Threshold};
use crate::diagnose::random_effects::displaced::all_displaced;
use crate::diagnose::random_effects::geometric_tolerances::{Geometry, SPREADS_SETTLED};
use crate::diagnose::random_effects::outlier_tolerances::standing_out;
use crate::diagnose::random_effects::small_errors::Kind;
use crate::diagnose::selection::nonparametric::log_odds;
use crate::diagnose::selection::pairwise_start::from_a_pair;
use crate::diagnose::selection::search::{Found, Search, SearchOptions};
use crate::error::Result;

/// A cause with free mounts is kept from these log odds on: its possible replacements are in the model already.
pub(crate) const LEAST_LOG_ODDS: Threshold = 2.0;

/// The causes found with displaced mounts.
pub(crate) struct WithSetup<'a> {
    pub setup: Geometry,
    pub search: Search<'a>,
    pub found: Found,
}

/// Whether a model leaves no more than noise, of the markers and of the board's corners.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn suffices(search: &Search<'_>, found: &Found) -> Result<bool> {
    let deformation = search.deformation(&found.fit.model);
    let (clean, _) = without_false(&search.problem, &deformation, found.noise)?;
    let left = adequacy(&clean, &deformation, search.measured_noise)?;
    Ok(!left.significant && !left.corners_significant)
}

/// The search for causes, with free mounts where a few causes are not sufficient; also returns the mounts, if they
/// are displaced.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn with_or_without_setup(
    search: &mut Search<'_>,
    nominal: &Model,
    stated: Noise,
    without: &[String],
) -> Result<(Found, Option<Geometry>)> {
    let mounted = Geometry::of_setup(&search.problem, without);
    if mounted.group.columns.is_empty() {
        return Ok((search.run(nominal.clone())?, None));
    }
    let most_causes = search.options.most_causes;
    search.options.most_causes = most_causes.min(SEVERAL_CAUSES);
    let mut few = search.run(nominal.clone())?;
    // What a displaced camera or board, or a wrong lens, does to the views of a posture was noise until here, and hid causes.
    go_on_at_smaller_noise(search, &mut few, stated)?;
    let mut enough = suffices(search, &few)?;
    // With few postures three wrong causes may leave a remainder that free mounts then absorb.
    if !enough
        && search.problem.budget.share() < A_STAGE
        && let Some(other) = from_a_pair(search, &few, nominal)?
    {
        (*search, few) = other;
        enough = suffices(search, &few)?;
    }
    search.options.most_causes = most_causes;
    let at_its_end = few.fit.model.terms.len() < most_causes.min(SEVERAL_CAUSES);
    let freed = if enough { None } else { with_setup(search, &few, nominal, stated, mounted)? };
    let all_off =
        |f: &WithSetup<'_>| !f.setup.group.columns.is_empty() && all_displaced(&f.setup, &f.found.fit);
    let settled = at_its_end || freed.as_ref().is_some_and(all_off);
    if settled || search.problem.budget.is_spent() {
        few.cut_off |= !settled;
        let Some(freed) = freed else { return Ok((few, None)) };
        *search = freed.search;
        return Ok((freed.found, Some(freed.setup).filter(|s| !s.group.columns.is_empty())));
    }
    // A few causes more may be all that there is.
    let mut plain = search.clone();
    let mut more = plain.run(few.fit.model.clone())?;
    let mut trace = freed.as_ref().map_or_else(|| few.trace.clone(), |f| f.found.trace.clone());
    trace.append(&mut more.trace);
    if let Some(mut freed) = freed {
        let displaced = !freed.setup.group.columns.is_empty();
        let prior = if displaced { LOG_PRIOR_STRUCTURE } else { 0.0 };
        let odds = log_odds((&freed.search, &freed.found), (&plain, &more))? + prior;
        trace.push(format!("with free mounts, compared with more causes: log odds {odds:.1}"));
        if odds > 0.0 {
            freed.found.trace = trace;
            *search = freed.search;
            return Ok((freed.found, displaced.then_some(freed.setup)));
        }
    }
    more.trace = trace;
    *search = plain;
    Ok((more, None))
}

/// The search with free mounts; none where there are no mounts, or where the data are no more probable with
/// displaced mounts than with the causes that were found `alone`.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn with_setup<'a>(
    plain: &Search<'a>,
    alone: &Found,
    nominal: &Model,
    stated: Noise,
    mounted: Geometry,
) -> Result<Option<WithSetup<'a>>> {
    let told_as_mounts = mounted.mounts().filter_map(|(effect, place)| plain.catalogue.find(effect, place));
    let left_out = plain.options.left_out.iter().copied().chain(told_as_mounts).collect();
    let mut start = nominal.clone();
    start.group = vec![0.0; mounted.group.columns.len()];
    start.group.extend(&alone.fit.model.group);
    let mut setup = mounted.beside(&plain.group);
    let mut search = Search {
        group: setup.group.clone(),
        options: SearchOptions { left_out, least_log_odds: LEAST_LOG_ODDS, ..plain.options.clone() },
        ..plain.clone()
    };
    // The mounts first at their common spreads, at the noise that they leave.
    start = search.fit_at_its_scatter(&start)?.0.model;
    look_again_at_noise(&mut search, &start, stated)?;
    let mut trace = alone.trace.clone();
    let mut result: Option<Found> = None;
    for round in 0..SOLVER.rounds {
        if round > 0 && search.problem.budget.is_spent() {
            break;
        }
        let mut next = search.run(start.clone())?;
        trace.append(&mut next.trace);
        let before = setup.clone();
        let options = FitOptions { noise: next.noise, steps: SOLVER.candidate_steps };
        next.fit = setup.fit(&search.problem, search.catalogue, &next.fit.model, options, search.mask)?;
        search.group = setup.group.clone();
        let mut again = look_again_at_noise(&mut search, &next.fit.model, stated)?;
        if let Some(term) = standing_out(&setup, search.catalogue, &next.fit) {
            let name = search.catalogue.name(&search.problem.scene, term.hypothesis);
            trace.push(format!("{name} is an outlier among the zeros"));
            next.fit.model.terms.push(term);
            next.fit = setup.fit(&search.problem, search.catalogue, &next.fit.model, options, search.mask)?;
            search.group = setup.group.clone();
            // It may be what the search had no work left for.
            next.cut_off = next.cut_off && search.could_add(&next.fit.model, next.noise)?;
            again = true;
        }
        start = next.fit.model.clone();
        next.noise = search.effective(&start)?;
        result = Some(next);
        if !again && setup.change_from(&before) < SPREADS_SETTLED {
            break;
        }
    }
    let Some(mut found) = result else { return Ok(None) };
    found.fit = search.prune(found.fit, found.noise, &mut trace)?.0;
    let odds = log_odds((&search, &found), (plain, alone))? + LOG_PRIOR_STRUCTURE;
    trace.push(format!("with free mounts ({}): log odds {odds:.1}", told(&setup)));
    found.trace = trace;
    if odds < 0.0 {
        return Ok(None);
    }
    if !all_displaced(&setup, &found.fit) && suffices(&search, &found)? {
        // The causes that were found so may be all that there is.
        let mut bare =
            Search { group: plain.group.clone(), options: plain.options.clone(), ..search.clone() };
        let causes = Model { group: alone.fit.model.group.clone(), ..found.fit.model.clone() };
        let mut without = bare.run(causes)?;
        if log_odds((&search, &found), (&bare, &without))? + LOG_PRIOR_STRUCTURE < 0.0 {
            found.trace.push("the mounts are as modelled".into());
            found.trace.append(&mut without.trace);
            without.trace = found.trace;
            return Ok(Some(WithSetup { setup: Geometry::empty(), search: bare, found: without }));
        }
    }
    Ok(Some(WithSetup { setup, search, found }))
}

/// A displaced camera looks like noise of the markers until it is known; the noise is estimated again, and used if
/// it is smaller.
pub(crate) fn look_again_at_noise(search: &mut Search<'_>, model: &Model, stated: Noise) -> Result<bool> {
    // The views of a posture do not show a scatter that they share.
    if search.scatter.is_some() {
        return Ok(false);
    }
    let again = noise::estimate(&search.problem, &search.deformation(model), stated)?;
    let before = search.measured_noise;
    let smaller = again.marker_px < noise::SETTLED * before.marker_px
        || again.point_m < noise::SETTLED * before.point_m;
    if smaller {
        search.measured_noise = again;
        search.problem.noise = again;
    }
    Ok(smaller)
}

/// Goes on with the search where the noise that the causes leave is smaller than the one at which they were found.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn go_on_at_smaller_noise(
    search: &mut Search<'_>,
    found: &mut Found,
    stated: Noise,
) -> Result<()> {
    if look_again_at_noise(search, &found.fit.model, stated)? {
        let first = core::mem::take(&mut found.trace);
        *found = search.run(found.fit.model.clone())?;
        found.trace.splice(0..0, first);
    }
    Ok(())
}

/// The scales in words.
fn told(setup: &Geometry) -> String {
    format!(
        "board {:.2} mm {:.2} mrad, camera {:.2} mm {:.2} mrad, markers {:.2} mm, zeros {:.2} mrad",
        setup.spread(Kind::BoardShift) * 1e3,
        setup.spread(Kind::BoardTurn) * 1e3,
        setup.spread(Kind::CameraShift) * 1e3,
        setup.spread(Kind::CameraTurn) * 1e3,
        setup.spread(Kind::Marker) * 1e3,
        setup.spread(Kind::Angle) * 1e3
    )
}
