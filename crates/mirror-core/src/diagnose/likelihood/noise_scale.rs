//! How well the scale of the markers' noise is known, and what a model pays that needs a larger one.
//!
//! Two models at one noise are compared by what they leave of it. Where one of them would be as good with a slightly
//! larger noise, that is the wrong question: errors that are independent in each posture absorb noise. With the noise
//! `σ = s σ₀` of each model its own, the log likelihood of n rows is `−n ln s − ½ χ²(σ)`, and the prior of s is
//! log-normal around the noise that was measured or stated.

use crate::diagnose::likelihood::noise::STATED_LOG_STD;
use crate::diagnose::likelihood::saturated::free_markers;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::principles::{FEWEST_REDUNDANT_ROWS, Prior};
use crate::error::Result;

/// Relative uncertainty of the views' noise by what their planes share (one mirror a view, its board's corners).
const VIEWS_LOG_STD: Prior = 0.04;

/// The scale of the markers' noise.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NoiseScale {
    /// Rows of the markers.
    rows: f64,
    /// Standard deviation of the scale's logarithm.
    log_std: f64,
}

impl NoiseScale {
    /// The scale of a session's noise, from the rows that the free markers of each posture leave.
    ///
    /// # Errors
    /// Invalid parameters of the camera or mirror.
    pub fn new(
        problem: &Problem,
        deformation: &Deformation,
        noise: Noise,
        mask: Option<&[bool]>,
    ) -> Result<Self> {
        let postures = free_markers(problem, deformation, noise, true, mask)?;
        let redundant = postures.iter().map(|p| p.freedom_left.max(0.0)).sum();
        let rows = postures.iter().map(|p| p.freedom_left + p.freedom_taken).sum();
        let of_views = problem.camera.is_some() && redundant >= FEWEST_REDUNDANT_ROWS;
        Ok(Self { rows, log_std: if of_views { log_std_of_views(redundant) } else { STATED_LOG_STD } })
    }

    /// Log density of a model that needs the noise `own` where `known` was measured or stated.
    pub fn log_density(&self, own: Noise, known: Noise) -> f64 {
        // A session has pixels or points, and the other kind's noise does not change.
        let log_scale = (own.marker_px / known.marker_px).ln() + (own.point_m / known.point_m).ln();
        -self.rows * log_scale - 0.5 * (log_scale / self.log_std).powi(2)
    }
}

/// Standard deviation of the logarithm of a noise that so many redundant rows of views of one posture show.
pub(crate) fn log_std_of_views(redundant: f64) -> f64 {
    VIEWS_LOG_STD.hypot((2.0 * redundant).sqrt().recip())
}
