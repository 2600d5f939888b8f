//! Cholesky's factor of normal equations, `A = L Lᵀ`, by columns with vector registers.
//!
//! Fits with small errors everywhere factor matrices of a hundred columns and more, some of them hundreds of times. Of
//! `l_j = (a_j − Σ_{k<j} L_jk l_k) / L_jj` four columns k are subtracted at once. Each number is computed by the same operations in the
//! same order whatever a processor's registers hold.

use multiversion::multiversion;
use nalgebra::linalg::Cholesky;
use nalgebra::{DMatrix, Dyn};
use std::ops::Range;

/// The factor; none where the matrix is not positive definite, or has numbers that are none.
pub(crate) fn cholesky(mut matrix: DMatrix<f64>) -> Option<Cholesky<f64, Dyn>> {
    let count = matrix.nrows();
    factorise(matrix.as_mut_slice(), count).then(|| Cholesky::pack_dirty(matrix))
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn factorise(values: &mut [f64], count: usize) -> bool {
    for j in 0..count {
        let (before, rest) = values.split_at_mut(j * count);
        let own = &mut rest[j..count];
        let column = |k: usize| &before[k * count + j..(k + 1) * count];
        let fours = j - j % 4;
        for k in (0..fours).step_by(4) {
            let (a, b, c, d) = (column(k), column(k + 1), column(k + 2), column(k + 3));
            let by = [a[0], b[0], c[0], d[0]];
            for i in 0..own.len() {
                own[i] -= by[0] * a[i] + by[1] * b[i] + by[2] * c[i] + by[3] * d[i];
            }
        }
        for k in fours..j {
            let a = column(k);
            let by = a[0];
            own.iter_mut().zip(a).for_each(|(own, a)| *own -= by * a);
        }
        // Written so that NaN is refused.
        if !(own[0] > 0.0) {
            return false;
        }
        let root = own[0].sqrt();
        own.iter_mut().for_each(|own| *own /= root);
        own[0] = root;
    }
    true
}

/// `log det A`.
pub(crate) fn log_det(factor: &Cholesky<f64, Dyn>) -> f64 {
    2.0 * factor.l_dirty().diagonal().iter().map(|x| x.ln()).sum::<f64>()
}

/// Some diagonal entries of `A⁻¹`: the squared lengths of columns of `L⁻¹`.
pub(crate) fn variances(factor: &Cholesky<f64, Dyn>, which: Range<usize>) -> Vec<f64> {
    let l = factor.l_dirty();
    let mut column = vec![0.0; l.nrows()];
    which.map(|i| squared_length(l.as_slice(), i, &mut column)).collect()
}

/// Of the i-th column of `L⁻¹`; `column` is memory for it.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn squared_length(l: &[f64], i: usize, column: &mut [f64]) -> f64 {
    let count = column.len();
    column[i..].fill(0.0);
    column[i] = 1.0;
    let mut square = 0.0;
    for j in i..count {
        let below = &l[j * count + j..(j + 1) * count];
        let value = column[j] / below[0];
        square += value * value;
        column[j + 1..].iter_mut().zip(&below[1..]).for_each(|(x, l)| *x -= value * l);
    }
    square
}

/// `tr A⁻¹`.
pub(crate) fn trace_of_inverse(factor: &Cholesky<f64, Dyn>) -> f64 {
    variances(factor, 0..factor.l_dirty().nrows()).iter().sum()
}

/// `A⁻¹ = L⁻ᵀ L⁻¹`, a third of the operations of `A X = I`.
pub(crate) fn inverse(factor: &Cholesky<f64, Dyn>) -> DMatrix<f64> {
    let l = factor.l_dirty();
    let count = l.nrows();
    let mut rows = DMatrix::zeros(count, count);
    let mut out = DMatrix::zeros(count, count);
    invert(l.as_slice(), count, rows.as_mut_slice(), out.as_mut_slice());
    out.fill_lower_triangle_with_upper_triangle();
    out
}

/// Writes the rows of `L⁻¹` behind each other, `m_k = (e_k − Σ_{j<k} L_kj m_j) / L_kk`, and the upper triangle of `Σ_k m_kᵀ m_k`.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn invert(l: &[f64], count: usize, rows: &mut [f64], out: &mut [f64]) {
    let add = |to: &mut [f64], by: f64, from: &[f64]| {
        to.iter_mut().zip(from).for_each(|(to, x)| *to += by * x);
    };
    for k in 0..count {
        let (before, rest) = rows.split_at_mut(k * count);
        let own = &mut rest[..=k];
        own[k] = 1.0;
        for j in 0..k {
            add(own, -l[j * count + k], &before[j * count..=j * count + j]);
        }
        own.iter_mut().for_each(|x| *x /= l[k * count + k]);
        for j in 0..=k {
            add(&mut out[j * count..=j * count + j], own[j], own);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// Of the size n, positive definite.
    fn matrix(n: usize) -> DMatrix<f64> {
        let root = DMatrix::from_fn(n + 2, n, |i, j| (((3 * i + 5 * j * j) % 11) as f64 - 4.0) / 3.0);
        root.tr_mul(&root) + DMatrix::identity(n, n)
    }

    #[test]
    fn factors_inverses_and_variances_are_those_of_the_matrix() {
        for n in [1, 2, 5, 12, 31] {
            let matrix = matrix(n);
            let factor = cholesky(matrix.clone()).unwrap();
            let l = factor.l();
            assert!((&l * l.transpose() - &matrix).amax() < 1e-12 * matrix.amax(), "{n}");
            assert!((log_det(&factor) - matrix.determinant().ln()).abs() < 1e-10, "{n}");
            let inverse = matrix.try_inverse().unwrap();
            assert!((super::inverse(&factor) - &inverse).amax() < 1e-10 * inverse.amax(), "{n}");
            for (i, v) in (n / 3..n).zip(variances(&factor, n / 3..n)) {
                assert!((v - inverse[(i, i)]).abs() < 1e-10 * v, "{n}");
            }
        }
        assert!(cholesky(DMatrix::zeros(0, 0)).is_some());
    }

    #[test]
    fn what_is_not_positive_definite_has_no_factor() {
        for (at, value) in [((6, 6), -1.0), ((3, 3), f64::NAN), ((9, 2), f64::NAN), ((0, 0), 0.0)] {
            let mut matrix = matrix(10);
            matrix[at] = value;
            assert!(cholesky(matrix).is_none(), "{at:?} {value}");
        }
    }
}
