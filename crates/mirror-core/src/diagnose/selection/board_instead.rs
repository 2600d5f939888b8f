//! The board's place on its link, in the place of a link's length.
//!
//! What is measured through the mirror is relative to the board. Where a link carries all that is seen but the board (the base of an arm beside a board on the
//! same stand), a shift of that link by v and one of the board by −v are the same. A board's place comes from a rule or a drawing as a link's length does, and
//! a mistake in either is often a pure translation: such a pair is compared by the likelihood alone. With the priors of all six numbers of a mount the link
//! would win by the three angles that it lacks, the surer the larger the shift is.

use crate::diagnose::effects::Place;
use crate::diagnose::effects::hypothesis::{Model, Term};
use crate::diagnose::likelihood::fit::Fit;
use crate::diagnose::likelihood::score_test::Score;
use crate::diagnose::model::elementary::Atom;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::Size;
use crate::diagnose::selection::search::{Found, Search};
use crate::error::Result;

/// Numbers of a mount that a translation lacks: each lowers −2 log likelihood by one on average without being needed.
const ANGLES: Size = 3;

/// Log odds of a translated board against the i-th cause, at most 0; none where that is no link's length, or the board's
/// place is free beside it.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn board_instead(search: &Search<'_>, found: &Found, i: usize) -> Result<Option<f64>> {
    let (catalogue, scene) = (search.catalogue, &search.problem.scene);
    let model = &found.fit.model;
    let shifts_link =
        |term: &Term| catalogue.columns(scene, term).iter().all(|c| matches!(c.atom, Atom::LinkShift(..)));
    let is_free = search.group.columns.iter().any(|c| matches!(c.atom, Atom::BoardMount(_)));
    let board = catalogue.find("board_mount", Place::Board);
    let Some(board) = board.filter(|h| !is_free && !search.options.left_out.contains(h)) else {
        return Ok(None);
    };
    if !shifts_link(&model.terms[i]) || model.terms.iter().any(|t| t.hypothesis == board) {
        return Ok(None);
    }
    let of = |model: &Model| search.fit_with_slack(model, None, found.noise, SOLVER.final_steps);
    let mut exchanged = search.taken_out(model, i, found.noise)?;
    // At the noise that the causes leave, all observations are outliers of a model without one of them.
    let loud = search.effective(&exchanged)?;
    let scores = search.scores(&exchanged, loud)?;
    let Some(start) = scores.into_iter().find(|s| s.hypothesis == board) else { return Ok(None) };
    let Score { variant, parameters, .. } = start;
    exchanged.terms.push(Term { hypothesis: board, variant, parameters, prior_scale: 1.0 });
    let exchanged = search.fit(&exchanged, loud, SOLVER.final_steps)?.model;
    let (own, instead) = (of(model)?, of(&exchanged)?);
    // −2 log likelihood: without the penalty of the priors of what is compared.
    let misfit = |fit: &Fit, hypothesis: usize| {
        let term = fit.model.terms.iter().find(|t| t.hypothesis == hypothesis);
        let stds = &catalogue.hypotheses[hypothesis].prior_std;
        let penalty = term.map_or(0.0, |t| t.parameters.iter().zip(stds).map(|(v, s)| (v / s).powi(2)).sum());
        fit.misfit - penalty
    };
    let worse = misfit(&instead, board) + ANGLES as f64 - misfit(&own, model.terms[i].hypothesis);
    Ok(Some(-0.5 * worse.max(0.0)))
}
