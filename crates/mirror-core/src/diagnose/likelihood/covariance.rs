//! The covariance of a fit's parameters, computed when it is first asked for: most fits are only compared.

use crate::diagnose::likelihood::factor::inverse;
use core::ops::Index;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use std::sync::OnceLock;

/// `S (I + S H S)⁻¹ S`, S the priors' standard deviations.
#[derive(Debug, Clone)]
pub(crate) struct Covariance {
    /// Of `I + S H S`; none where numbers overflow: the priors' own variances then.
    factor: Option<Cholesky<f64, Dyn>>,
    std: Vec<f64>,
    computed: OnceLock<DMatrix<f64>>,
}

impl Covariance {
    pub fn new(factor: Option<Cholesky<f64, Dyn>>, std: Vec<f64>) -> Self {
        Self { factor, std, computed: OnceLock::new() }
    }

    pub fn matrix(&self) -> &DMatrix<f64> {
        self.computed.get_or_init(|| {
            let s = DVector::from_column_slice(&self.std);
            match &self.factor {
                Some(factor) => {
                    let mut covariance = inverse(factor);
                    for i in 0..s.len() {
                        for j in 0..s.len() {
                            covariance[(i, j)] *= s[i] * s[j];
                        }
                    }
                    covariance
                }
                None => DMatrix::from_diagonal(&s.component_mul(&s)),
            }
        })
    }
}

impl Index<(usize, usize)> for Covariance {
    type Output = f64;

    fn index(&self, at: (usize, usize)) -> &f64 {
        &self.matrix()[at]
    }
}
