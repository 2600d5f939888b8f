//! Small errors everywhere in place of several causes, where an earlier diagnosis named them.
//!
//! A law that the vocabulary lacks (a link that was twisted at assembly) has several causes far from its place that
//! together move nearly the same, each of them certain. The small errors say no more than is known: that the robot's
//! geometry is off.

use crate::diagnose::criteria::cross_validation::seen_size;
use crate::diagnose::effects::hypothesis::Model;
use crate::diagnose::likelihood::fit::FitOptions;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::prepare::false_observations::without_false;
use crate::diagnose::principles::LEAST_HELD_OUT_RATIO;
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::selection::extended_models::Extended;
use crate::diagnose::selection::search::{Found, Search};
use crate::diagnose::selection::with_tolerances::FEWEST_TOLD;
use crate::error::Result;

/// Replaces the causes found, if there are more than one, with small errors everywhere alone if these predict held-out
/// regions clearly better.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn small_errors_instead(
    (search, found): (&mut Search<'_>, &mut Found),
    extended: &mut Extended,
    nominal: &Model,
) -> Result<()> {
    // One cause by itself, whatever else is mounted by hand, is no set of pieces.
    if found.fit.model.terms.len() < 2 || search.problem.budget.is_spent() {
        return Ok(());
    }
    // What is mounted by hand was found before, and stays free.
    let mounted = extended.geometry.as_ref().is_some_and(|g| g.mounted) || !search.group.columns.is_empty();
    let mut geometry = Geometry::new(&search.problem, search.catalogue, mounted);
    let options = FitOptions { noise: found.noise, steps: SOLVER.few_steps };
    let fit = geometry.fit(&search.problem, search.catalogue, nominal, options, search.mask)?;
    let alone = Search { group: geometry.group.clone(), ..search.clone() };
    let with = seen_size(&alone.held_out(&fit.model, found.noise)?);
    let without = seen_size(&search.held_out(&found.fit.model, found.noise)?);
    let known = geometry.told(&fit) > FEWEST_TOLD;
    let better = known && with < LEAST_HELD_OUT_RATIO * without;
    found.trace.push(format!(
        "small errors everywhere in place of all causes: held-out gap {:.3} times that of the causes",
        with / without.max(1e-30)
    ));
    if better {
        *search = alone;
        found.fit = fit;
        let deformation = search.deformation(&found.fit.model);
        (extended.clean, _) = without_false(&search.problem, &deformation, found.noise)?;
        (extended.geometry, extended.unnamed, extended.unnamed_law) = (Some(geometry), None, None);
    }
    Ok(())
}
