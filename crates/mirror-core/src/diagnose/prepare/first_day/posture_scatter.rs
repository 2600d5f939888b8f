//! How much a joint's zero scatters from posture to posture beside a change of it: joints that rest elsewhere in each posture.
//! The views of a posture have that error in common, so a few postures at the end of a session can seem to have another zero,
//! and the likelihood, for which all rows are independent, counts each view as evidence.
//!
//! With the products of the joint's column with itself and with the residual, `h_p = Σ xᵀx` and `g_p = Σ xᵀr` over the frames
//! of posture p, at the fit with the change, `z_p = g_p / √h_p` has the variance `1 + s² h_p`. From differences of successive
//! postures (von Neumann 1941; a second change, or what wanders over the session, is no scatter) its mean is
//! `φ = Σ (z_p − z_{p+1})² / 2 (n − 1)`, so `s² = (φ − 1) / mean h`. A change by b from a row on then gains
//! `b² A B / (A + B)` in χ², A and B being the sums of `1 / (1 / h_p + s²)` over the postures before it and from it on.

use super::by_frame::zeros;
use super::verify::Tolerant;
use crate::diagnose::likelihood::saturated::postures;
use crate::diagnose::model::body::NodeId;
use crate::diagnose::principles::BEYOND_DOUBT;
use crate::error::Result;

/// Whether a change of a joint's zero, rad or m from a row on, is beyond doubt beside the joint's scatter; at a fit with the
/// change.
///
/// # Errors
/// Invalid parameters of camera or mirror.
pub(super) fn is_beyond(fit: &Tolerant, node: NodeId, (first, change): (usize, f64)) -> Result<bool> {
    let (problem, deformation) = (fit.problem(), fit.deformation());
    let places = zeros(problem, &deformation, fit.noise, &[node])?;
    let Some(place) = places.first() else { return Ok(false) };
    let of_posture = |frames: Vec<usize>| {
        let sums = frames.iter().map(|&f| &place.frames[f]);
        let (h, g) = sums.fold((0.0, 0.0), |(h, g), of| (h + of.0[(0, 0)], g + of.1[0]));
        let is_after = frames.first().is_some_and(|&f| f >= first);
        (h > 0.0).then_some(OfPosture { h, g, is_after })
    };
    let all: Vec<OfPosture> = postures(problem).into_iter().filter_map(of_posture).collect();
    Ok(0.5 * gain_beside_scatter(&all, change) > BEYOND_DOUBT)
}

/// The products of a joint's column in one posture, and whether the change is before it.
struct OfPosture {
    h: f64,
    g: f64,
    is_after: bool,
}

/// What a change gains in χ² beside the scatter.
fn gain_beside_scatter(postures: &[OfPosture], change: f64) -> f64 {
    let errors: Vec<f64> = postures.iter().map(|p| p.g / p.h.sqrt()).collect();
    let mean = postures.iter().map(|p| p.h).sum::<f64>() / postures.len().max(1) as f64;
    let square = (overdispersion(&errors) - 1.0) / mean.max(1e-30);
    let information = |after: bool| -> f64 {
        let own = postures.iter().filter(|p| p.is_after == after);
        own.map(|p| 1.0 / (1.0 / p.h + square)).sum()
    };
    let (before, after) = (information(false), information(true));
    change * change * before * after / (before + after).max(1e-30)
}

/// `Σ (z_p − z_{p+1})² / 2 (n − 1)`, 1 at least.
fn overdispersion(errors: &[f64]) -> f64 {
    let squares: f64 = errors.windows(2).map(|pair| (pair[0] - pair[1]).powi(2)).sum();
    let pairs = errors.len().saturating_sub(1).max(1);
    (squares / (2 * pairs) as f64).max(1.0)
}

#[cfg(test)]
mod tests {
    use super::{OfPosture, gain_beside_scatter, overdispersion};
    use crate::random::Random;

    /// Postures of a joint whose errors scatter by so much, known to 0.001 each, the last `after` of 100 behind a change.
    fn scattered(scatter: f64, after: usize) -> Vec<OfPosture> {
        let (mut random, h) = (Random::new(3), 1e6);
        let of = |p: usize| {
            let error = scatter * random.normal() + 1e-3 * random.normal();
            OfPosture { h, g: h * error, is_after: p >= 100 - after }
        };
        (0..100).map(of).collect()
    }

    #[test]
    fn a_change_gains_what_it_is_in_deviations_of_its_two_means() {
        for (scatter, after) in [(0.0, 2), (0.0, 50), (0.01, 2), (0.01, 50)] {
            let deviation =
                (scatter * scatter + 1e-6_f64) * (1.0 / after as f64 + 1.0 / (100 - after) as f64);
            let gain = gain_beside_scatter(&scattered(scatter, after), 0.02);
            let wanted = 0.02 * 0.02 / deviation;
            assert!((gain / wanted - 1.0).abs() < 0.35, "{scatter} {after}: {gain} {wanted}");
        }
        assert!(gain_beside_scatter(&[], 1.0).abs() < 1e-12);
    }

    #[test]
    fn independent_errors_count_and_a_step_or_a_drift_does_not() {
        let mut random = Random::new(7);
        let noise: Vec<f64> = (0..400).map(|_| random.normal()).collect();
        let of = |scale: f64, step: f64, drift: f64| {
            let value = |(p, z): (usize, &f64)| {
                scale * z + if p < 250 { 0.0 } else { step } + drift * p as f64 / 400.0
            };
            overdispersion(&noise.iter().enumerate().map(value).collect::<Vec<f64>>())
        };
        assert!((of(1.0, 0.0, 0.0) - 1.0).abs() < 0.2, "{}", of(1.0, 0.0, 0.0));
        assert!((of(5.0, 0.0, 0.0) / 25.0 - 1.0).abs() < 0.2, "{}", of(5.0, 0.0, 0.0));
        assert!(of(1.0, 8.0, 20.0) < 1.3, "{}", of(1.0, 8.0, 20.0));
        assert!((overdispersion(&[3.0]) - 1.0).abs() < 1e-12);
    }
}
