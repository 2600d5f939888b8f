//! How uncertain the causes' parameters are, and what that uncertainty moves.
//!
//! A parameter is as uncertain as the fit says, or as it says when the laws have their slack and the noise its colour,
//! whichever is more; beside that, by as far as slack and colour move its value (a spring that stiffens is softer at small
//! loads than the straight law that fits best), and by what real joints are known to depart from a law that no data show.

use super::colour;
use super::diagnose::Findings;
use super::effects::LawFreedom;
use super::shift::marker_shift;
use crate::error::Result;

/// Steps of the fit in which all laws have their slack.
const LOOSE_STEPS: usize = 6;

/// Of each term of a model.
#[derive(Debug, Clone, Default)]
pub(crate) struct Deviations {
    /// Standard deviations of its parameters.
    pub stds: Vec<Vec<f64>>,
    /// Mean square shift of the markers (px², or m² where points were measured) by what laws may be wrong by, one entry a
    /// parameter whose law is not exact.
    pub law_shifts: Vec<f64>,
}

/// The deviations of what was found.
///
/// # Errors
/// A camera or mirror that cannot be.
pub(crate) fn deviations(findings: &Findings<'_>) -> Result<Deviations> {
    let search = &findings.search;
    let found = &findings.found;
    let all = search.deformation(&found.fit.model);
    let noise = colour::of_means(&search.problem, &all, found.noise)?;
    let loose = search.fit_with_slack(&found.fit.model, None, noise, LOOSE_STEPS)?;
    let measured = search.measured_noise;
    let unit = if search.problem.camera.is_some() { measured.marker_px } else { measured.point_m };
    let mut out = Deviations::default();
    for (i, term) in found.fit.model.terms.iter().enumerate() {
        let effect = search.catalogue.effect(term.hypothesis);
        let own_law = effect.law_freedom() != LawFreedom::Exact || effect.law_uncertainty() > 0.0;
        let (exact, slack) = (found.fit.stds(i), loose.stds(i));
        let mut stds = Vec::with_capacity(exact.len());
        for (k, value) in term.parameters.iter().enumerate() {
            let moved = value - loose.model.terms[i].parameters[k];
            let std = exact[k].max(slack[k]).hypot(moved).hypot(effect.law_uncertainty() * value);
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
