//! Cholesky factors of small symmetric matrices, in place, by rows: what a step needs, without allocation.

/// A pivot below this part of the mean of the diagonal is no pivot: the matrix is singular to double precision.
const LEAST_PIVOT: f64 = 1e-12;

/// Factors `A = L Lᵀ` (n×n by rows, lower triangle read and overwritten); false where A is not positive definite.
pub(super) fn factor(a: &mut [f64], n: usize) -> bool {
    let mean = (0..n).map(|i| a[i * n + i]).sum::<f64>() / n.max(1) as f64;
    let least = LEAST_PIVOT * mean;
    for j in 0..n {
        let (above, from_j) = a.split_at_mut(j * n);
        let row_j = &mut from_j[..n];
        for k in 0..j {
            let row_k = &above[k * n..k * n + k + 1];
            let mut sum = row_j[k];
            for (x, y) in row_j[..k].iter().zip(&row_k[..k]) {
                sum -= x * y;
            }
            row_j[k] = sum / row_k[k];
        }
        let pivot = row_j[j] - row_j[..j].iter().map(|x| x * x).sum::<f64>();
        if !(pivot > least) {
            return false;
        }
        row_j[j] = pivot.sqrt();
    }
    true
}

/// Solves `L Lᵀ x = b` in place.
pub(super) fn solve(l: &[f64], n: usize, x: &mut [f64]) {
    for i in 0..n {
        let row = &l[i * n..i * n + i + 1];
        let sum: f64 = row[..i].iter().zip(&x[..i]).map(|(a, b)| a * b).sum();
        x[i] = (x[i] - sum) / row[i];
    }
    for i in (0..n).rev() {
        let mut sum = x[i];
        for k in i + 1..n {
            sum -= l[k * n + i] * x[k];
        }
        x[i] = sum / l[i * n + i];
    }
}

/// The inverse of L by rows (lower triangle; the rest is left as it is).
pub(super) fn inverse_of_lower(l: &[f64], n: usize, inverse: &mut [f64]) {
    for j in 0..n {
        inverse[j * n + j] = 1.0 / l[j * n + j];
        for i in j + 1..n {
            let sum: f64 = (j..i).map(|k| l[i * n + k] * inverse[k * n + j]).sum();
            inverse[i * n + j] = -sum / l[i * n + i];
        }
    }
}
