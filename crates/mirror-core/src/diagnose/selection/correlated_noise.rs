//! Noise that is correlated over frames: a detection error that persists partly in the next frames. It is larger
//! than the disagreement of the views of one posture shows. In a posture it looks like an independent joint error,
//! or like an unknown law.

use crate::diagnose::likelihood::noise_correlation::widening_of_views;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::selection::search::{Found, Search};
use crate::error::Result;

/// Increases the measured noise where residuals are correlated over frames, and repeats the search with it.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn allow_for_correlation(search: &mut Search<'_>, found: &mut Found) -> Result<()> {
    // Errors of postures are allowed for already.
    if search.scatter.is_some() {
        return Ok(());
    }
    let deformation = search.deformation(&found.fit.model);
    let widening = widening_of_views(&search.problem, &deformation, search.measured_noise)?;
    if widening <= 1.0 {
        return Ok(());
    }
    search.noise_widening = widening;
    search.measured_noise.marker_px *= widening;
    search.problem.noise = search.measured_noise;
    if search.problem.budget.is_spent() {
        // No further search: what was found is fitted again.
        found.noise = search.effective(&found.fit.model)?;
        found.fit = search.fit(&found.fit.model, found.noise, SOLVER.final_steps)?;
        return Ok(());
    }
    let mut again = search.run(found.fit.model.clone())?;
    let mut trace = std::mem::take(&mut found.trace);
    trace.push(format!("detection errors are correlated over frames: noise {widening:.2} times what the views of a posture show"));
    trace.append(&mut again.trace);
    *found = Found { trace, ..again };
    Ok(())
}
