//! A coupling of two joints beside all small errors.
//!
//! The comparison of [`super::verify`] has no couplings among its small errors: there are as many as pairs of joints,
//! and all at once they would explain exchanged columns. A single one explains no mistake, but a large one looks like a
//! marker on another link to a comparison that has none. So a mistake that seems the most probable is also compared with
//! the likeliest single coupling, by the score test at the fit with all small errors, fitted beside these.

use super::verify::Tolerant;
use crate::diagnose::model::problem::Noise;
use crate::error::Result;

/// The effect that is tried.
const EFFECT: &str = "joint_coupling";

/// A fit with a coupling beside all small errors.
pub(super) struct Coupled {
    pub fit: Tolerant,
    /// Of the coupling, in the vocabulary of couplings.
    pub log_prior: f64,
    /// The effect's name and its place.
    pub told: (String, String),
}

/// The likeliest coupling beside what a fit has; none where none is likely at all. `least` is the measurement's noise.
///
/// # Errors
/// Invalid parameters of camera or mirror.
pub(super) fn coupled(without: &Tolerant, least: Noise) -> Result<Option<Coupled>> {
    let problem = without.problem();
    let causes = Tolerant::only(problem, &[EFFECT]);
    let Some((term, gained)) = without.likeliest(&causes)? else { return Ok(None) };
    let (hypothesis, variant) = (term.hypothesis, term.variant);
    let log_prior = causes.log_prior(&problem.scene, hypothesis, variant);
    if gained + log_prior <= 0.0 {
        return Ok(None);
    }
    let at = causes.hypotheses[hypothesis].place.name(&problem.scene);
    let fit = without.with_cause(causes, term, EFFECT, least)?;
    Ok(Some(Coupled { fit, log_prior, told: (EFFECT.to_owned(), at) }))
}
