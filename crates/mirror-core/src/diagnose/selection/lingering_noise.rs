//! Noise that lingers: an error of the detector that the next frames keep a part of is larger than the views of one posture show, and
//! what it makes of a posture looks like a joint that rests elsewhere each time, or like a law that nobody knows.

use crate::diagnose::likelihood::noise_correlation::widening_of_views;
use crate::diagnose::selection::search::{Found, Search};
use crate::error::Result;

/// Widens the measured noise where what was found leaves errors that linger, and searches again with it.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn allow_for_lingering(search: &mut Search<'_>, found: &mut Found) -> Result<()> {
    let deformation = search.deformation(&found.fit.model);
    let widening = widening_of_views(&search.problem, &deformation, search.measured_noise)?;
    if widening <= 1.0 {
        return Ok(());
    }
    search.lingering = widening;
    search.measured_noise.marker_px *= widening;
    search.problem.noise = search.measured_noise;
    let mut again = search.run(found.fit.model.clone())?;
    let mut trace = std::mem::take(&mut found.trace);
    trace.push(format!("errors that linger from view to view: noise {widening:.2} times what views show"));
    trace.append(&mut again.trace);
    *found = Found { trace, ..again };
    Ok(())
}
