//! How far a cause moves the observations, in the unit of the measurement.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::criteria::marker_shift::marker_shift;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::prepare::row_slip::Slip;
use crate::error::Result;

/// Mean square of a marker's observation error by noise alone, in the unit of the observations.
pub(crate) fn noise_square(problem: &Problem, noise: Noise) -> f64 {
    if problem.camera.is_some() { 2.0 * noise.marker_px.powi(2) } else { 3.0 * noise.point_m.powi(2) }
}

/// RMS shift of the observations of all n markers by slipped rows, from their gain in χ²: `σ √(gain / n)`.
pub(crate) fn shift_of_rows(problem: &Problem, noise: Noise, slip: &Slip) -> f64 {
    let markers = problem.frames.iter().map(|f| f.others.len()).sum::<usize>().max(1);
    (slip.gain / markers as f64).sqrt() * problem.of_observations(noise)
}

/// RMS over markers of the shift between two deformations, in the unit of the observations.
pub(crate) fn rms_shift(findings: &Findings<'_>, from: &Deformation, to: &Deformation) -> Result<f64> {
    let search = &findings.search;
    let noise = search.detector_noise();
    let squares = marker_shift(&search.problem, from, to, noise)?;
    let mean = squares.iter().sum::<f64>() / squares.len().max(1) as f64;
    Ok(mean.sqrt() * search.problem.of_observations(noise))
}
