//! The covariance of a fit's parameters, computed when it is first asked for: most fits are only compared.

use core::ops::{Index, Range};
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
                    let mut covariance = factor.inverse();
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

/// Some diagonal entries of `A⁻¹` by `A = L Lᵀ`: the squared lengths of columns of `L⁻¹`.
pub(crate) fn variances(factor: &Cholesky<f64, Dyn>, which: Range<usize>) -> Vec<f64> {
    let l = factor.l_dirty();
    let count = l.nrows();
    let mut column = vec![0.0; count];
    let of = |i: usize| {
        column[i..].fill(0.0);
        column[i] = 1.0;
        let mut square = 0.0;
        for j in i..count {
            let value = column[j] / l[(j, j)];
            square += value * value;
            let below = l.column(j);
            let (below, rest) = (&below.as_slice()[j + 1..], &mut column[j + 1..]);
            rest.iter_mut().zip(below).for_each(|(x, l)| *x -= value * l);
        }
        square
    };
    which.map(of).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn variances_are_the_diagonal_of_the_inverse() {
        let root = DMatrix::from_fn(7, 5, |i, j| (((3 * i + 5 * j) % 11) as f64 - 4.0) / 3.0);
        let matrix = root.tr_mul(&root) + DMatrix::identity(5, 5);
        let factor = matrix.cholesky().unwrap();
        let inverse = factor.inverse();
        for (i, v) in (1..4).zip(variances(&factor, 1..4)) {
            assert!((v - inverse[(i, i)]).abs() < 1e-12 * v);
        }
    }
}
