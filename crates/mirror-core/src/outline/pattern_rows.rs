//! Rows of numbers by pixel, their products, and the rows that a drawn pattern without a ghost can have.

use multiversion::multiversion;
use nalgebra::{SMatrix, SVector};

/// Sums are taken in so many parts.
const LANES: usize = 16;
/// The pattern, its slopes (2) and bends (3), and its contrast's change across and down.
pub(super) const TERMS: usize = 8;
/// Least eigenvalue of the rows' products that counts, as a share of their trace.
const LEAST_SHARE: f64 = 1e-9;

/// A number by pixel; filled up with zeros to whole lanes.
#[derive(Debug, Clone)]
pub(super) struct Row {
    values: Vec<f32>,
    count: usize,
}

impl Row {
    pub fn of(kept: &[usize], value: impl Fn(usize) -> f32) -> Self {
        Self::from_values(kept.iter().map(|at| value(*at)))
    }

    pub fn from_values(values: impl Iterator<Item = f32>) -> Self {
        let mut values: Vec<f32> = values.collect();
        let count = values.len();
        values.resize(count.next_multiple_of(LANES), 0.0);
        Self { values, count }
    }

    pub fn len(&self) -> usize {
        self.count
    }

    pub fn values(&self) -> impl Iterator<Item = f64> {
        self.values[..self.count].iter().map(|v| f64::from(*v))
    }

    fn by(&self, other: &Self, both: impl Fn(f32, f32) -> f32) -> Self {
        let own = &self.values[..self.count];
        Self::from_values(own.iter().zip(&other.values).map(|(a, b)| both(*a, *b)))
    }

    pub fn times(&self, other: &Self) -> Self {
        self.by(other, |a, b| a * b)
    }

    pub fn over(&self, other: &Self) -> Self {
        self.by(other, |a, b| a / b)
    }

    /// Less `share` of another row.
    pub fn less(&self, share: f64, other: &Self) -> Self {
        self.by(other, |a, b| a - share as f32 * b)
    }
}

/// What the pattern alone can explain, and the squares of its slopes.
///
/// The slopes: corners are pulled by a ghost too, and the pattern is drawn by them. The bends: its blur is known only roughly, and may differ by direction.
#[derive(Debug, Clone)]
pub(super) struct Rows {
    pub rows: [Row; TERMS],
    pub steepness: Row,
}

impl Rows {
    /// By a drawn pattern (rows of pixels, at least one beyond those kept).
    pub fn of_pattern(model: &[f32], width: usize, height: usize, kept: &[usize]) -> Self {
        // Sobel's, an eighth of them: all at once of the nine pixels around each, in plain loops, which the compiler keeps in place.
        let (smooth, slope, bend) = ([1.0f32, 2.0, 1.0], [-1.0f32, 0.0, 1.0], [1.0f32, -2.0, 1.0]);
        let kinds = [(smooth, slope), (slope, smooth), (smooth, bend), (slope, slope), (bend, smooth)];
        let mut values = [(); 5].map(|()| Vec::with_capacity(kept.len().next_multiple_of(LANES)));
        for at in kept {
            let (above, here, below) =
                (&model[at - width - 1..][..3], &model[at - 1..][..3], &model[at + width - 1..][..3]);
            for ((down, across), values) in kinds.iter().zip(&mut values) {
                let of = |row: &[f32]| row[0] * across[0] + row[1] * across[1] + row[2] * across[2];
                values.push(0.125 * (of(above) * down[0] + of(here) * down[1] + of(below) * down[2]));
            }
        }
        let [across, down, wide, mixed, high] = values.map(|values| Row::from_values(values.into_iter()));
        let steepness = across.by(&down, |a, b| a * a + b * b);
        let evenly = |place: usize, size: usize| 2.0 * place as f32 / (size as f32 - 1.0) - 1.0;
        let rows = [
            Row::of(kept, |at| model[at]),
            across,
            down,
            wide,
            mixed,
            high,
            Row::of(kept, |at| model[at] * evenly(at % width, width)),
            Row::of(kept, |at| model[at] * evenly(at / width, height)),
        ];
        Self { rows, steepness }
    }

    pub fn times(&self, weight: &Row) -> Self {
        Self { rows: core::array::from_fn(|i| self.rows[i].times(weight)), steepness: self.steepness.clone() }
    }

    fn gram(&self) -> SMatrix<f64, TERMS, TERMS> {
        let mut gram = SMatrix::zeros();
        for i in 0..TERMS {
            for j in 0..=i {
                gram[(i, j)] = dot(&self.rows[i], &self.rows[j]);
                gram[(j, i)] = gram[(i, j)];
            }
        }
        gram
    }

    /// Orthonormal rows of the same span, by the Cholesky factor of their products.
    pub fn flat(&self) -> Option<Self> {
        let gram = self.gram();
        let lifted = gram + SMatrix::identity() * (LEAST_SHARE * gram.trace());
        let inverse = lifted.cholesky()?.l().try_inverse()?;
        let row = |i: usize| {
            let mut sum = vec![0.0f32; self.rows[0].values.len()];
            for j in 0..=i {
                add(&mut sum, inverse[(i, j)] as f32, &self.rows[j].values);
            }
            Row { values: sum, count: self.rows[0].count }
        };
        Some(Self { rows: core::array::from_fn(row), steepness: self.steepness.clone() })
    }

    /// What orthonormal rows leave of another.
    pub fn rest(&self, row: &Row) -> Row {
        let mut rest = row.clone();
        for own in &self.rows {
            let share = dot(own, row);
            add(&mut rest.values, -share as f32, &own.values);
        }
        rest
    }

    /// The first row's part in the least squares of another row.
    pub fn main_of(&self, row: &Row) -> Option<f64> {
        let with = SVector::<f64, TERMS>::from_fn(|i, _| dot(&self.rows[i], row));
        self.gram().lu().solve(&with).map(|parts| parts[0])
    }
}

/// Both rows of a pair times a weight.
pub(super) fn weighted(pair: &[Row; 2], weight: &Row, both: &mut Row, apart: &mut Row) {
    for (one, to) in pair.iter().zip([both, apart]) {
        for ((to, value), weight) in to.values.iter_mut().zip(&one.values).zip(&weight.values) {
            *to = value * weight;
        }
    }
}

/// `to + share · row`.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn add(to: &mut [f32], share: f32, row: &[f32]) {
    for (to, value) in to.iter_mut().zip(row) {
        *to += share * value;
    }
}

/// The product of two rows.
pub(super) fn dot(one: &Row, other: &Row) -> f64 {
    dots_of(&one.values, &one.values, &other.values).0
}

/// The products of two rows with a third.
pub(super) fn dots(one: &Row, other: &Row, third: &Row) -> (f64, f64) {
    dots_of(&one.values, &other.values, &third.values)
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn dots_of(one: &[f32], other: &[f32], third: &[f32]) -> (f64, f64) {
    let (mut first, mut second) = ([0.0f32; LANES], [0.0f32; LANES]);
    let lanes = one.chunks_exact(LANES).zip(other.chunks_exact(LANES)).zip(third.chunks_exact(LANES));
    for ((a, b), c) in lanes {
        for i in 0..LANES {
            first[i] += a[i] * c[i];
            second[i] += b[i] * c[i];
        }
    }
    let sum = |lanes: &[f32; LANES]| lanes.iter().map(|v| f64::from(*v)).sum();
    (sum(&first), sum(&second))
}
