//! The pixels of a ball by column, and their weighted sums: what the fit of the ball's light (`shading`) spends its time on.

use multiversion::multiversion;
use nalgebra::SVector;

/// Terms of a pixel's basis.
pub(super) const TERMS: usize = 10;
/// Sums over pixels are taken in so many parts: enough that the compiler makes a loop of whole vectors of them.
const LANES: usize = 64;

/// Pixels by column: the terms of the basis, and last the light; filled up with zeros to whole lanes.
#[derive(Clone)]
pub(super) struct Columns {
    pub columns: [Vec<f64>; TERMS + 1],
    pub count: usize,
}

impl Columns {
    /// Of the basis by pixel, without light.
    pub fn of(rows: &[[f64; TERMS]]) -> Self {
        let filled = rows.len().next_multiple_of(LANES);
        let column = |term: usize| {
            let mut column: Vec<f64> = Vec::with_capacity(filled);
            if term < TERMS {
                column.extend(rows.iter().map(|row| row[term]));
            }
            column.resize(filled, 0.0);
            column
        };
        Self { columns: core::array::from_fn(column), count: rows.len() }
    }

    /// Some of the pixels, with their light.
    pub fn lit(&self, kept: &[usize], light: impl Iterator<Item = f64>) -> Self {
        let mut result = if kept.len() == self.count {
            self.clone()
        } else {
            let rows: Vec<[f64; TERMS]> =
                kept.iter().map(|pixel| core::array::from_fn(|term| self.columns[term][*pixel])).collect();
            Self::of(&rows)
        };
        for (to, light) in result.columns[TERMS].iter_mut().zip(light) {
            *to = light;
        }
        result
    }

    pub fn light(&self) -> &[f64] {
        &self.columns[TERMS][..self.count]
    }

    /// What terms leave of the light.
    pub fn rest(&self, terms: &SVector<f64, TERMS>) -> Vec<f64> {
        let mut rest = self.light().to_vec();
        for (column, term) in self.columns.iter().zip(terms.iter()) {
            for (left, number) in rest.iter_mut().zip(column) {
                *left -= term * number;
            }
        }
        rest
    }
}

/// The product of two columns.
#[inline(always)]
fn product(one: &[f64], other: &[f64]) -> f64 {
    let mut lanes = [0.0; LANES];
    for (a, b) in one.chunks_exact(LANES).zip(other.chunks_exact(LANES)) {
        for ((lane, a), b) in lanes.iter_mut().zip(a).zip(b) {
            *lane += a * b;
        }
    }
    let (low, high) = lanes.split_at_mut(LANES / 2);
    for (lane, more) in low.iter_mut().zip(high) {
        *lane += *more;
    }
    let mut few = [0.0; 8];
    for lanes in low.chunks_exact(8) {
        for (lane, more) in few.iter_mut().zip(lanes) {
            *lane += more;
        }
    }
    few.iter().sum()
}

/// `Σ w r_i r_j` of columns, on the diagonal and beyond it.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
pub(super) fn weighted_sums(columns: &[Vec<f64>; TERMS + 1], weights: &[f64]) -> [[f64; TERMS + 1]; TERMS] {
    let mut sums = [[0.0; TERMS + 1]; TERMS];
    let mut weighted = vec![0.0; columns[0].len()];
    for i in 0..TERMS {
        for ((to, weight), number) in weighted.iter_mut().zip(weights).zip(&columns[i]) {
            *to = weight * number;
        }
        for j in i..=TERMS {
            sums[i][j] = product(&weighted, &columns[j]);
        }
    }
    sums
}
