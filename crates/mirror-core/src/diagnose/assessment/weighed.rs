//! The findings after model comparison: causes that do not help on held-out regions are dropped, improbable ones are
//! replaced, the remainder is tested against the noise.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::assessment::noise_floor::{is_no_noise, is_reached};
use crate::diagnose::criteria::cross_validation::{PostureGap, in_sample, seen_size};
use crate::diagnose::criteria::lack_of_fit::adequacy;
use crate::diagnose::data::diagnosis::Alternative;
use crate::diagnose::effects::Place;
use crate::diagnose::effects::hypothesis::Model;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::prepare::first_day::Doubt;
use crate::diagnose::prepare::prepared::Prepared;
use crate::diagnose::principles::{TEMPER, UNTHOUGHT_OF, WORTH_NAMING};
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::random_effects::outlier_tolerances::odds_of_standing_out;
use crate::diagnose::selection::alternatives::settled;
use crate::diagnose::selection::board_instead::board_instead;
use crate::diagnose::selection::extended_models::Extended;
use crate::diagnose::selection::nonparametric::{Unexplained, unexplained};
use crate::diagnose::selection::search::{Found, Search};
use crate::diagnose::selection::simplify::{
    comes_down, drop_useless, gaps, name_nothing, named_for_little, named_in_vain, nominal_gap, without_names,
};
use crate::diagnose::selection::standing::Standing;
use crate::diagnose::selection::zeros_of_link::{ZerosInstead, zeros_instead};
use crate::error::Result;

/// Compares the causes found, without the observations that the best model shows to be false.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn weighed<'a>(
    (mut search, mut found): (Search<'a>, Found),
    extended: Extended,
    nominal: &Model,
    prepared: &Prepared,
) -> Result<Findings<'a>> {
    let Extended { mut geometry, erratic, unnamed, unnamed_law, ended_with, clean } = extended;
    let scattered = search.scatter.map(|_| Unexplained::scattered());
    search.problem = clean;
    let unfinished = search.problem.budget.was_refused() && geometry.is_none();
    let (nominal_gap, mut after) = gaps(&search, nominal, &found)?;
    let has_free = |search: &Search<'_>, found: &Found| {
        found.fit.model.terms.iter().any(|t| search.catalogue.is_free(t.hypothesis))
    };
    let with_free = has_free(&search, &found);
    let left = |search: &Search<'_>, found: &Found| {
        adequacy(&search.problem, &search.deformation(&found.fit.model), search.measured_noise)
    };
    // No model agrees with views that disagree among themselves.
    let loud = is_no_noise(search.noise_of_views(), prepared.stated, search.problem.scene.reach_m);
    // Causes with a remainder are accepted if they were found together with small errors. A search that was cut off
    // without small errors may have found only a part.
    let cut_off = unfinished
        && (loud || left(&search, &found)?.significant && !is_reached(&search, &found.fit, &after)?);
    if cut_off {
        found.cut_off = true;
        found.trace.push("the search for causes did not end: what it found so far may be a part".into());
    }
    let needed_there = drop_useless(&mut search, &mut found, &mut after, geometry.as_ref())?;
    comes_down(&search, &mut found, &mut after)?;
    // What is left without the free-form errors is what a search found that came to its end.
    let causes: Vec<usize> = found.fit.model.terms.iter().map(|t| t.hypothesis).collect();
    found.cut_off &= cut_off || !(with_free && ended_with.is_some_and(|ended| ended == causes));
    let mut standings = settled(&search, &mut found, &mut after, geometry.as_ref())?;
    if let Some(law) = unnamed_law {
        for (term, standing) in found.fit.model.terms.iter().zip(&mut standings) {
            let instead = standing.as_mut().filter(|_| !law.beside.contains(&term.hypothesis));
            instead.into_iter().for_each(|standing| standing.besides_another(law.weight));
        }
    }
    let mut doubts = prepared.doubts().to_vec();
    // Small errors everywhere contain all zeros already.
    let shapes_vary = geometry.as_ref().is_some_and(|g| !g.setup_only);
    for i in (0..standings.len()).filter(|&i| !shapes_vary && standings[i].is_some()) {
        doubts.extend(zeros_of_its_joints(&search, &mut found, i)?);
        doubts.extend(board_in_its_place(&search, &mut found, i)?);
        doubts.extend(geometry.as_ref().and_then(|setup| one_of_the_zeros(&search, &mut found, setup, i)));
    }
    let free = has_free(&search, &found);
    let left = left(&search, &found)?;
    // If the named causes reach the floor, a remainder without structure is the noise's tails. So is a structure of
    // the corners that does not improve the prediction of held-out markers.
    let in_vain = with_free && !free && !left.significant;
    let reached =
        (found.fit.model.explains() && !free || in_vain) && is_reached(&search, &found.fit, &after)?;
    // Free-form errors that explain more than the reported small errors are kept, however little these leave: with
    // many parameters any model reaches the floor.
    let unexplained = match erratic.map(Unexplained::erratic).or(unnamed).or(scattered) {
        Some(told) => Some(told),
        None => unexplained(&search, &found, &left, reached)?,
    };
    let unexplained = unexplained
        .or_else(|| Unexplained::at(search.catalogue, &needed_there))
        .or((loud || cut_off).then(Unexplained::anywhere));
    if free {
        after = without_names(&search, &mut found, &mut standings)?;
    }
    // Beside joints that scatter causes were weighed with all that the scatter absorbs.
    let lawless = search.scatter.is_none() && unexplained.as_ref().is_some_and(Unexplained::is_lawless);
    let no_smaller = named_in_vain(&search, &found, &nominal_gap, &after);
    let mut in_picture_only = Vec::new();
    if no_smaller && seen_size(&after) < seen_size(&nominal_gap) {
        in_picture_only = probable(&search, &found, &standings);
    }
    if no_smaller || lawless && named_for_little(&search, &found, &nominal_gap, &after) {
        let left =
            if no_smaller { "the held-out gap no smaller" } else { "nearly all of a gap that has no place" };
        name_nothing(&search, &mut found, nominal, &format!("together they leave {left}"))?;
        (geometry, after) = (None, nominal_gap.clone());
        standings.clear();
    }
    let before =
        if prepared.mistakes().is_empty() { nominal_gap } else { as_given(&search, &prepared.given)? };
    found.trace.splice(0..0, prepared.trace().iter().cloned());
    Ok(Findings {
        search,
        found,
        geometry,
        slip: prepared.slip,
        before,
        after,
        unexplained,
        standings,
        mistakes: prepared.mistakes().to_vec(),
        doubts,
        in_picture_only,
        step: None,
        resampled: None,
    })
}

/// The causes that are more probable than not: effect and place.
fn probable(search: &Search<'_>, found: &Found, standings: &[Option<Standing>]) -> Vec<(String, String)> {
    let of_terms = found.fit.model.terms.iter().zip(standings);
    let sure = of_terms.filter(|(_, s)| s.as_ref().is_some_and(|s| s.probability >= WORTH_NAMING));
    sure.map(|(term, _)| effect_and_place(search, term.hypothesis)).collect()
}

fn effect_and_place(search: &Search<'_>, hypothesis: usize) -> (String, String) {
    let place = search.catalogue.hypotheses[hypothesis].place.name(&search.problem.scene);
    (search.catalogue.effect(hypothesis).name().to_owned(), place)
}

/// The gap of the nominal model of a session as it was given. What the session states as unknown (mounts, the frame of measured points) is
/// fitted; without that there is nothing to fit.
pub(super) fn as_given(search: &Search<'_>, given: &Problem) -> Result<Vec<PostureGap>> {
    let nominal = Model::nominal(given);
    if nominal.nuisances.is_empty() {
        return in_sample(given, &given.nominal(), search.detector_noise());
    }
    let as_given = Search { problem: given.clone(), mask: None, ..search.clone() };
    nominal_gap(&as_given, &nominal)
}

/// The zeros of both joints of a link as an alternative of its length, told at the joint that carries it; none where they
/// are not worth naming.
fn zeros_of_its_joints(search: &Search<'_>, found: &mut Found, i: usize) -> Result<Option<Doubt>> {
    let Some(ZerosInstead { joints: (first, second), odds }) = zeros_instead(search, found, i)? else {
        return Ok(None);
    };
    let scene = &search.problem.scene;
    let place = |node| Place::Joint(node).name(scene);
    let told = format!("zeros of {} and {}", place(first), place(second));
    Ok(instead_of(search, found, i, (("joint_offset", place(first)), told, odds)))
}

/// A translated board as an alternative of a link's length; none where it is not worth naming.
fn board_in_its_place(search: &Search<'_>, found: &mut Found, i: usize) -> Result<Option<Doubt>> {
    let Some(odds) = board_instead(search, found, i)? else { return Ok(None) };
    let board = Place::Board.name(&search.problem.scene);
    Ok(instead_of(search, found, i, (("board_mount", board), "a translated board".into(), odds)))
}

/// The small errors of all joints' zeros as an alternative of one that is a cause; none where it is not worth naming, or where
/// they are the more probable: then the search found the cause all the same, at the scale that the others have.
fn one_of_the_zeros(search: &Search<'_>, found: &mut Found, setup: &Geometry, i: usize) -> Option<Doubt> {
    let hypothesis = found.fit.model.terms[i].hypothesis;
    let odds = odds_of_standing_out(setup, search.catalogue, &found.fit, hypothesis)?;
    let told = "small errors of all zeros".into();
    if odds < 0.0 { None } else { instead_of(search, found, i, (("geometry", "robot".into()), told, -odds)) }
}

/// What could be in the place of the i-th cause, by its log odds.
fn instead_of(
    search: &Search<'_>,
    found: &mut Found,
    i: usize,
    ((effect, at), told, odds): ((&str, String), String, f64),
) -> Option<Doubt> {
    let weight = (TEMPER * odds).exp().min(1.0);
    if weight < UNTHOUGHT_OF {
        return None;
    }
    let scene = &search.problem.scene;
    let own = found.fit.model.terms[i].hypothesis;
    found.trace.push(format!("{told} instead of {}: log odds {odds:.1}", search.catalogue.name(scene, own)));
    let probability = weight / (1.0 + weight);
    Some(Doubt {
        of: effect_and_place(search, own),
        mistake: Alternative { effect: effect.into(), at, probability },
    })
}
