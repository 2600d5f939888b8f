//! Which causes beside small errors everywhere help on held-out regions, by one linear model.
//!
//! Small errors everywhere take over most of what a single cause explains, so a cause among them must be an outlier: the
//! regions that are held out must be predicted better with it. One linear model of each region ([`LinearSearch`]) gives
//! the parameters without any region and without any cause.
//!
//! What is no part of the robot (the size of the board's squares, the focal length) small errors everywhere can imitate
//! on held-out regions, too, but only if they are larger by much. So they can one of them that is large: a zero by a degree is
//! shared out among its neighbours. Such a cause is kept where the evidence says so, the scales estimated with and without it.

use crate::diagnose::criteria::cross_validation::{PostureGap, gaps_in, seen_size};
use crate::diagnose::criteria::regions::{frames_of, only, regions};
use crate::diagnose::effects::Effect;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::{LEAST_HELD_OUT_GAIN, LEAST_HELD_OUT_RATIO, LEAST_LOG_ODDS, TEMPER};
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::selection::competing::Competing;
use crate::diagnose::selection::linear_search::LinearSearch;
use crate::diagnose::selection::search::{Found, Search};
use crate::error::Result;
use rayon::prelude::*;

/// By what share the held-out gap must be larger without a cause among many small errors: it must be an outlier. A
/// compliance is no error of a shape and predicts other loads; it needs to help no more than among single causes.
pub(super) fn least_gain(effect: &dyn Effect) -> f64 {
    if effect.depends_on_load() { LEAST_HELD_OUT_GAIN } else { 1.0 - LEAST_HELD_OUT_RATIO }
}

/// Drops causes that do not help where they were not fitted; whether there were any.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(super) fn drop_useless_beside(
    geometry: &Geometry,
    search: &Search<'_>,
    found: &mut Found,
) -> Result<bool> {
    let (model, catalogue) = (found.fit.model.clone(), search.catalogue);
    let labels = regions(&search.problem);
    let parts = frames_of(&labels);
    let none = Competing::all(core::iter::empty());
    let linear = LinearSearch::new((search, &model, found.noise), Some(geometry), &none, &parts)?;
    let gap_with = |set: &[usize]| -> Result<f64> {
        let of_region = |region: usize| -> Result<Vec<PostureGap>> {
            let fitted = linear.model_with(search, &model, (&linear.all_but(region), set));
            let (measured, test) = (search.detector_noise(), only(&labels, region));
            gaps_in(&search.problem, &search.deformation(&fitted), measured, Some(&test))
        };
        let gaps = (0..parts.len()).into_par_iter().map(of_region).collect::<Result<Vec<_>>>()?;
        Ok(seen_size(&gaps.concat()))
    };
    let whole = linear.sum(&vec![1.0; parts.len()]);
    let by_evidence = |set: &[usize]| Some(linear.with_scales(&whole, set.to_vec())?.log_posterior);
    let mut set: Vec<usize> = (0..linear.found).collect();
    let mut with = gap_with(&set)?;
    let mut at = 0;
    while at < set.len() {
        let hypothesis = linear.candidates[set[at]].hypothesis;
        let place = catalogue.hypotheses[hypothesis].place;
        let least = least_gain(catalogue.effect(hypothesis));
        let rest: Vec<usize> = set.iter().copied().filter(|c| *c != set[at]).collect();
        let without = gap_with(&rest)?;
        // What small errors everywhere can imitate: what is no part of the robot, and one of them that is large.
        let is_imitated = place.node().is_none() || geometry.holds(catalogue, hypothesis);
        let leaves_smaller_errors = || {
            let ahead = by_evidence(&set).zip(by_evidence(&rest)).map(|(with, without)| with - without);
            ahead.is_some_and(|ahead| TEMPER * ahead > LEAST_LOG_ODDS)
        };
        let is_needed = without >= with * (1.0 + least) || is_imitated && leaves_smaller_errors();
        if is_needed {
            at += 1;
        } else {
            let name = catalogue.name(&search.problem.scene, hypothesis);
            found.trace.push(format!("drop {name}: no gain on held-out regions"));
            (set, with) = (rest, without);
        }
    }
    let dropped = set.len() < linear.found;
    if dropped {
        let rest = linear.model_with(search, &model, (&whole, &set));
        found.fit = search.fit(&rest, found.noise, SOLVER.loose_steps)?;
    }
    Ok(dropped)
}
