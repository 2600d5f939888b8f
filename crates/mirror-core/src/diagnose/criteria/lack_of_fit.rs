//! The lack-of-fit test on free markers: whether what a model leaves is more than noise.

use crate::diagnose::likelihood::noise::{STATED_LOG_STD, corner_excess};
use crate::diagnose::likelihood::saturated::free_markers;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::principles::{
    A_GAP, ABOVE_SCATTER, FAR_DEVIATIONS, FEWEST_REDUNDANT_ROWS, Guard, Prior, Threshold, WORTH_NAMING,
};
use crate::error::Result;
use crate::statistics::{normal_quantile, reduced_chi_squared_at};

/// Quantile of the postures' misfit that is compared with that of χ².
const QUANTILE: Threshold = 0.7;
/// Postures whose free markers use fewer degrees of freedom than this give no information on the fit.
const LEAST_TAKEN: Guard = 0.5;
/// With no more redundant rows than this the noise is the stated one, and
const FEW_LEFT: Threshold = FEWEST_REDUNDANT_ROWS / 2.0;
/// its variance counts as known from a hundred rows; that of a measuring device, whose data sheet or calibration states it,
/// from four hundred.
const STATED_SCATTER: Prior = 0.02;
const STATED_SCATTER_OF_DEVICE: Prior = 0.005;

/// The minimum remainder, as a share of the noise's variance: it must be a gap, and significantly above 0. Smaller
/// remainders are real but negligible.
pub(crate) fn noticeable_excess() -> f64 {
    A_GAP * A_GAP - 1.0
}

/// What is left of a gap, against the noise.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Adequacy {
    /// Variance of what free markers explain, over the noise's, minus 1.
    pub excess: f64,
    /// The excess from which it is significant where its structure is unknown: larger where the session states the
    /// noise, no two views of a posture show it, and all postures exceed it alike.
    pub stands_out_from: f64,
    pub significant: bool,
    /// Whether it may be the noise all the same: no two views show that, all postures exceed it alike, and by no more than a
    /// stated noise is usually wrong.
    pub may_be_noise: bool,
    pub corners_significant: bool,
}

/// Tests a model: under noise alone, the gain of free markers is χ² with as many degrees of freedom as they use.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn adequacy(problem: &Problem, deformation: &Deformation, noise: Noise) -> Result<Adequacy> {
    let mut postures = free_markers(problem, deformation, noise, true, None)?;
    let ratio = |p: &crate::diagnose::likelihood::saturated::FreePosture| {
        (p.chi2_predicted - p.chi2_free) / p.freedom_taken.max(1e-9)
    };
    postures.retain(|p| p.freedom_taken > LEAST_TAKEN);
    postures.sort_by(|a, b| ratio(a).total_cmp(&ratio(b)));
    // A quantile instead of a sum: postures with false observations, or that had not settled, lie beyond it.
    let excess_at = |quantile: f64| {
        let at = ((postures.len() as f64 * quantile) as usize).min(postures.len().saturating_sub(1));
        let noise = |freedom: f64| reduced_chi_squared_at(normal_quantile(quantile), freedom);
        postures.get(at).map_or(0.0, |p| ratio(p) / noise(p.freedom_taken) - 1.0)
    };
    let excess = excess_at(QUANTILE);
    let taken: f64 = postures.iter().map(|p| p.freedom_taken).sum();
    let kept = &postures;
    let left: f64 = kept.iter().map(|p| p.freedom_left.max(0.0)).sum();
    // The noise itself is estimated from as many degrees of freedom as the views leave.
    let stated = if problem.camera.is_some() { STATED_SCATTER } else { STATED_SCATTER_OF_DEVICE };
    let scatter = (2.0 / taken.max(1.0) + if left > FEW_LEFT { 2.0 / left } else { stated }).sqrt();
    let of_corners = corner_excess(problem, deformation, noise)?;
    // A wrong noise widens all postures alike, except the few with false observations. If more postures differ, as
    // in a run of rows in which a joint stood still, it is not the noise.
    let alike = 1.0 + excess_at(1.0 - WORTH_NAMING) < ABOVE_SCATTER.powi(2) * (1.0 + excess);
    let by_rule_of_thumb = problem.camera.is_some() && left < FEWEST_REDUNDANT_ROWS && alike;
    let uncertain = if by_rule_of_thumb { STATED_LOG_STD.exp() } else { 1.0 };
    let stands_out_from = (ABOVE_SCATTER * uncertain).powi(2) - 1.0;
    Ok(Adequacy {
        excess,
        stands_out_from,
        may_be_noise: by_rule_of_thumb && excess < stands_out_from,
        significant: excess > noticeable_excess() && excess > FAR_DEVIATIONS * scatter,
        corners_significant: of_corners > noticeable_excess(),
    })
}
