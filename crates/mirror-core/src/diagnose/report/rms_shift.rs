//! How far a cause moves the observations, in the unit of the measurement.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::criteria::marker_shift::marker_shift;
use crate::diagnose::model::deformation::Deformation;
use crate::error::Result;

/// RMS over markers of the shift between two deformations, in the unit of the observations.
pub(crate) fn rms_shift(findings: &Findings<'_>, from: &Deformation, to: &Deformation) -> Result<f64> {
    let search = &findings.search;
    let noise = search.measured_noise;
    let squares = marker_shift(&search.problem, from, to, noise)?;
    let unit = if search.problem.camera.is_some() { noise.marker_px } else { noise.point_m };
    Ok((squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt() * unit)
}
