//! How much a joint's zero scatters from posture to posture beside a change of it: joints that rest elsewhere in each posture.
//! The views of a posture have that error in common, so a few postures at the end of a session can seem to have another zero,
//! and the likelihood, for which all rows are independent, counts each view as evidence.
//!
//! With the products of the joint's column with itself and with the residual, `h_p = Σ xᵀx` and `g_p = Σ xᵀr` over the frames
//! of posture p, at the fit with the change, `z_p = g_p / √h_p` has unit variance where the noise is all. The factor is
//! `φ = Σ (z_p − z_{p+1})² / 2 (n − 1)`, by differences of successive postures (von Neumann 1941): a second change, or what wanders
//! over the session, is no scatter. Log evidence is divided by φ, as deviances are in a quasi-likelihood (McCullagh and Nelder
//! 1989, 4.5).

use super::by_frame::zeros;
use super::verify::Tolerant;
use crate::diagnose::likelihood::saturated::postures;
use crate::diagnose::model::body::NodeId;
use crate::error::Result;

/// The factor, 1 at least, of a joint at a fit with the change.
///
/// # Errors
/// Invalid parameters of camera or mirror.
pub(super) fn factor(fit: &Tolerant, node: NodeId) -> Result<f64> {
    let (problem, deformation) = (fit.problem(), fit.deformation());
    let places = zeros(problem, &deformation, fit.noise, &[node])?;
    let errors = postures(problem).into_iter().filter_map(|frames| {
        let frames = frames.into_iter().flat_map(|f| places.first().map(|place| &place.frames[f]));
        let (h, g) = frames.fold((0.0, 0.0), |(h, g), of| (h + of.0[(0, 0)], g + of.1[0]));
        (h > 0.0).then(|| g / h.sqrt())
    });
    Ok(overdispersion(&errors.collect::<Vec<f64>>()))
}

/// `Σ (z_p − z_{p+1})² / 2 (n − 1)`, 1 at least.
fn overdispersion(errors: &[f64]) -> f64 {
    let squares: f64 = errors.windows(2).map(|pair| (pair[0] - pair[1]).powi(2)).sum();
    let pairs = errors.len().saturating_sub(1).max(1);
    (squares / (2 * pairs) as f64).max(1.0)
}

#[cfg(test)]
mod tests {
    use super::overdispersion;
    use crate::random::Random;

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
