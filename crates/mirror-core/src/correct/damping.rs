//! How strongly the pseudo-inverse `Jᵀ (J Jᵀ + μ² I)⁻¹` is damped.

use super::cholesky::{factor, inverse_of_lower};
use crate::error::{Result, not_negative, positive};

/// The damping μ of the pseudo-inverse, m/rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Damping {
    /// The μ that the user gives; 0 is the paper's plain pseudo-inverse.
    Fixed {
        /// μ, m/rad.
        mu_m_per_rad: f64,
    },
    /// The smallest μ for which the measurement's noise turns the joints by no more than this in one undamped step.
    ///
    /// With σᵢ the singular values of the whitened J and s the measurement's deviation, the joints' variance is
    /// `s² Σ σᵢ² / (σᵢ² + μ²)²`. Where it is small enough at μ = 0, J⁺ is not damped at all.
    Noise {
        /// Standard deviation of the step (all joints together), rad.
        step_std_rad: f64,
    },
}

impl Default for Damping {
    /// Default: noise may turn the joints by half a degree in a step, which is about the play of a small servo.
    fn default() -> Self {
        Self::Noise { step_std_rad: 0.5_f64.to_radians() }
    }
}

impl Damping {
    pub(super) fn check(&self) -> Result<()> {
        match *self {
            Self::Fixed { mu_m_per_rad } => {
                not_negative("damping mu_m_per_rad", mu_m_per_rad)?;
            }
            Self::Noise { step_std_rad } => {
                positive("damping step_std_rad", step_std_rad)?;
            }
        }
        Ok(())
    }
}

/// Number of bisections for μ: it is then known to a thousandth of its upper bound.
const HALVINGS: usize = 10;
/// Without damping and with a singular matrix, this part of the root of its trace replaces "μ → 0".
const LEAST_MU: f64 = 1e-6;

/// The Gram matrix of the whitened Jacobian, with storage for its damping and factorisation.
pub(super) struct Gram<'a> {
    /// n×n by rows, undamped.
    pub matrix: &'a [f64],
    pub n: usize,
    /// Receives the factor of the damped matrix.
    pub factor: &'a mut [f64],
    pub inverse: &'a mut [f64],
}

impl Gram<'_> {
    /// Factors `matrix + μ² I`; false where it is singular.
    pub fn damp(&mut self, mu: f64) -> bool {
        let n = self.n;
        self.factor[..n * n].copy_from_slice(&self.matrix[..n * n]);
        for i in 0..n {
            self.factor[i * n + i] += mu * mu;
        }
        factor(&mut self.factor[..n * n], n)
    }

    /// `Σ σᵢ² / (σᵢ² + μ²)² = tr A⁻¹ − μ² tr A⁻²` of the matrix as damped.
    fn amplification(&mut self, mu: f64) -> f64 {
        let n = self.n;
        inverse_of_lower(self.factor, n, self.inverse);
        let inverse = &self.inverse;
        if mu == 0.0 {
            // tr A⁻¹ = ‖L⁻¹‖².
            return (0..n).map(|i| inverse[i * n..=i * n + i].iter().map(|x| x * x).sum::<f64>()).sum();
        }
        let (mut trace, mut square) = (0.0, 0.0);
        for i in 0..n {
            for j in 0..=i {
                // A⁻¹ = L⁻ᵀ L⁻¹.
                let entry: f64 = (i..n).map(|k| inverse[k * n + i] * inverse[k * n + j]).sum();
                if i == j {
                    trace += entry;
                }
                square += entry * entry * if i == j { 1.0 } else { 2.0 };
            }
        }
        trace - mu * mu * square
    }

    /// Leaves the matrix damped and factored; returns μ (m/rad).
    ///
    /// `noise_m` is the measurement's standard deviation s.
    pub fn choose(&mut self, damping: Damping, noise_m: f64) -> f64 {
        match damping {
            Damping::Fixed { mu_m_per_rad } => self.at_least(mu_m_per_rad),
            Damping::Noise { step_std_rad } => {
                let allowed = (step_std_rad / noise_m).powi(2);
                if self.damp(0.0) && self.amplification(0.0) <= allowed {
                    return 0.0;
                }
                // Each of the n terms is at most 1/(4 μ²).
                let (mut low, mut high) = (0.0, 0.5 * (self.n as f64 / allowed).sqrt());
                for _ in 0..HALVINGS {
                    let middle = 0.5 * (low + high);
                    if self.damp(middle) && self.amplification(middle) <= allowed {
                        high = middle;
                    } else {
                        low = middle;
                    }
                }
                self.at_least(high)
            }
        }
    }

    fn at_least(&mut self, mu: f64) -> f64 {
        if self.damp(mu) {
            return mu;
        }
        let trace: f64 = (0..self.n).map(|i| self.matrix[i * self.n + i]).sum();
        let least = mu.max(LEAST_MU * trace.sqrt()).max(f64::MIN_POSITIVE.sqrt());
        self.damp(least);
        least
    }
}
