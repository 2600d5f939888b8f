//! Products of a frame's columns: a table of all columns, row by row, and what a frame adds to the sums of products.

use crate::diagnose::principles::Size;
use multiversion::multiversion;
use nalgebra::{Matrix3, Vector3};

/// Extra numbers behind a column's rows: its projection on the plane's three parameters.
pub(crate) const PROJECTED: Size = 3;
/// Numbers that are handled at once: tables are as wide as a multiple of it.
pub(crate) const LANES: Size = 8;
/// Columns whose products with [`LANES`] others are summed at once: so many sums stay in sixteen registers of four numbers.
const TILE: Size = 4;
/// Rows that are marked in one number.
const BITS: Size = u64::BITS as usize;

/// The columns of one frame, row by row. Their parts along the plane's three parameters are the last rows.
#[derive(Debug, Default)]
pub(crate) struct Table {
    columns: usize,
    stride: usize,
    /// Rows that are the frame's, and all.
    own: usize,
    rows: usize,
    values: Vec<f64>,
    /// The rows in which any of each [`LANES`] columns is not 0, in so many numbers.
    filled: Vec<u64>,
    words: usize,
}

/// A table of which is known where it is not 0.
#[derive(Clone, Copy)]
pub(crate) struct Filled<'t>(&'t Table);

/// How far apart the rows of a table, or of sums, of so many columns are.
pub(crate) fn stride(columns: usize) -> usize {
    columns.next_multiple_of(LANES)
}

impl Table {
    /// All 0, of a frame with so many rows.
    pub fn clear(&mut self, columns: usize, rows: usize) {
        self.columns = columns;
        self.stride = stride(columns);
        self.own = rows;
        self.rows = self.own + PROJECTED;
        self.values.clear();
        self.values.resize(self.rows * self.stride, 0.0);
    }

    /// All 0, of so many rows without any along a plane.
    pub fn clear_rows(&mut self, columns: usize, rows: usize) {
        self.clear(columns, rows);
        self.rows = self.own;
    }

    /// Reads a column, its parts along the plane last.
    pub fn read(&self, column: usize, out: &mut [f64]) {
        let (own, along) = out.split_at_mut(out.len() - PROJECTED);
        let read = |rows: &mut [f64], first: usize| {
            let of_column = self.values[first * self.stride + column..].iter().step_by(self.stride);
            rows.iter_mut().zip(of_column).for_each(|(out, x)| *out = *x);
        };
        read(own, 0);
        read(along, self.own);
    }

    /// Finds where it is not 0, once all is written.
    pub fn filled(&mut self) -> Filled<'_> {
        self.words = self.rows.div_ceil(BITS);
        self.filled.clear();
        self.filled.resize(self.stride / LANES * self.words, 0);
        mark_filled(&self.values[..self.rows * self.stride], self.stride, self.words, &mut self.filled);
        Filled(self)
    }

    /// The rows in which the [`LANES`] columns that a column is among are not all 0: a bit for each.
    #[inline(always)]
    fn filled_around(&self, column: usize) -> &[u64] {
        &self.filled[column / LANES * self.words..][..self.words]
    }

    /// Leaves out all columns but the first ones.
    pub fn keep_first(&mut self, columns: usize) {
        self.columns = self.columns.min(columns);
    }

    /// How many numbers a row has: those of all columns, and up to a multiple of [`LANES`].
    pub fn width(&self) -> usize {
        self.stride
    }

    /// A column's parts along the plane's parameters.
    pub fn along(&self, column: usize) -> Vector3<f64> {
        Vector3::from_fn(|k, _| self.values[(self.own + k) * self.stride + column])
    }

    /// Adds `plane · row` to the parts along the plane of all columns.
    pub fn add_along(&mut self, row: usize, plane: &[f64; PROJECTED]) {
        let (own, along) = self.values.split_at_mut(self.own * self.stride);
        add_three(&own[row * self.stride..(row + 1) * self.stride], plane, along);
    }

    /// Transforms the parts along the plane of all columns.
    pub fn transform_along(&mut self, by: &Matrix3<f64>) {
        let along = &mut self.values[self.own * self.stride..];
        let (a, rest) = along.split_at_mut(self.stride);
        let (b, rest) = rest.split_at_mut(self.stride);
        let c = &mut rest[..self.stride];
        for ((a, b), c) in a.iter_mut().zip(b).zip(c) {
            let v = by * Vector3::new(*a, *b, *c);
            (*a, *b, *c) = (v.x, v.y, v.z);
        }
    }

    /// The rows, those along the plane last, of all columns.
    pub fn rows(&self) -> impl ExactSizeIterator<Item = &[f64]> {
        self.values.chunks_exact(self.stride.max(1)).take(self.rows).map(|row| &row[..self.columns])
    }

    /// A row, to be written.
    pub fn row_mut(&mut self, row: usize) -> &mut [f64] {
        &mut self.values[row * self.stride..(row + 1) * self.stride]
    }

    /// Writes a column, `weight` times a vector.
    pub fn write(&mut self, column: usize, vector: &[f64], weight: f64) {
        let rows = vector.len() - PROJECTED;
        for row in 0..rows {
            self.values[row * self.stride + column] = weight * vector[row];
        }
        for k in 0..PROJECTED {
            self.values[(self.own + k) * self.stride + column] = weight * vector[rows + k];
        }
    }
}

/// Adds a row times each of three numbers to three rows.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn add_three(row: &[f64], by: &[f64; PROJECTED], to: &mut [f64]) {
    let (a, rest) = to.split_at_mut(row.len());
    let (b, rest) = rest.split_at_mut(row.len());
    let c = &mut rest[..row.len()];
    for i in 0..row.len() {
        a[i] += by[0] * row[i];
        b[i] += by[1] * row[i];
        c[i] += by[2] * row[i];
    }
}

/// Marks, for each [`LANES`] columns, the rows in which any of them is not 0: a bit for each.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn mark_filled(values: &[f64], stride: usize, words: usize, filled: &mut [u64]) {
    // Nothing is written of no columns.
    for (row, values) in values.chunks_exact(stride.max(1)).enumerate() {
        for (tile, columns) in values.chunks_exact(LANES).enumerate() {
            let any = columns.iter().fold(false, |any, x| any | (*x != 0.0));
            filled[tile * words + row / BITS] |= u64::from(any) << (row % BITS);
        }
    }
}

/// Adds the products of the columns of `left` with those of `right`, `sums[j * stride + i] += ⟨left_j, right_i⟩`:
/// rows minus the parts along the plane. For a table with itself (`half`) the products with `i ≤ j` are sufficient.
pub(crate) fn add_products(left: Filled<'_>, right: Filled<'_>, half: bool, sums: &mut [f64]) {
    add_tiles(left.0, right.0, half, sums);
}

/// Some columns by some others at once, in registers, over the rows in which neither are all 0: a joint of one arm moves no
/// marker of the other.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn add_tiles(left: &Table, right: &Table, half: bool, sums: &mut [f64]) {
    let stride = right.stride;
    for j in (0..left.columns).step_by(TILE) {
        let few = TILE.min(left.columns - j);
        let end = if half { (j + TILE).next_multiple_of(LANES) } else { stride };
        for i in (0..end).step_by(LANES) {
            let tile = products_of((left, j), (right, i));
            for (k, tile) in tile[..few].iter().enumerate() {
                let sums = &mut sums[(j + k) * stride + i..][..LANES];
                sums.iter_mut().zip(tile).for_each(|(sum, x)| *sum += x);
            }
        }
    }
}

/// The products of [`TILE`] columns, from the j-th on, with [`LANES`] others. A sum for each column by name: only these stay in
/// registers.
#[inline(always)]
fn products_of((left, j): (&Table, usize), (right, i): (&Table, usize)) -> [[f64; LANES]; TILE] {
    let none = [0.0; LANES];
    let (mut a, mut b, mut c, mut d) = (none, none, none, none);
    let (some, others) = (left.filled_around(j), right.filled_around(i));
    for (word, (one, other)) in some.iter().zip(others).enumerate() {
        let mut bits = one & other;
        while bits != 0 {
            let row = word * BITS + bits.trailing_zeros() as usize;
            bits &= bits - 1;
            // Parts along the plane are taken off.
            let sign = if row < right.own { 1.0 } else { -1.0 };
            let x = &left.values[row * left.stride + j..][..TILE];
            let y = &right.values[row * right.stride + i..][..LANES];
            add_times(&mut a, sign * x[0], y);
            add_times(&mut b, sign * x[1], y);
            add_times(&mut c, sign * x[2], y);
            add_times(&mut d, sign * x[3], y);
        }
    }
    [a, b, c, d]
}

#[inline(always)]
fn add_times(to: &mut [f64; LANES], x: f64, y: &[f64]) {
    for (to, y) in to.iter_mut().zip(y) {
        *to += x * y;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Columns that are 0 outside a span, as they are written and in a table. The last one is in all rows.
    fn columns(count: usize, rows: usize, rng: &mut ChaCha8Rng) -> (Table, Vec<Vec<f64>>) {
        let mut table = Table::default();
        table.clear(count, rows);
        let written = (0..count).map(|column| {
            let start = if column + 1 == count { 0 } else { rng.random_range(0..rows) };
            let end = if column + 1 == count { rows } else { rng.random_range(start..=rows) };
            let mut vector = vec![0.0; rows + PROJECTED];
            vector[start..end].iter_mut().for_each(|x| *x = rng.random_range(-1.0..1.0));
            if column % 3 != 0 {
                vector[rows..].iter_mut().for_each(|x| *x = rng.random_range(-0.1..0.1));
            }
            let weight = rng.random_range(0.5..2.0);
            table.write(column, &vector, weight);
            vector.iter().map(|x| weight * x).collect()
        });
        let written = written.collect();
        (table, written)
    }

    /// Against the equation itself, of few rows and many, and of columns that fill no table.
    #[test]
    fn products_are_of_the_rows_less_those_along_the_plane() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        for (rows, many, few) in [(1, 1, 1), (7, 9, 3), (38, 50, 21), (301, 30, 12)] {
            let (mut left, own) = columns(few, rows, &mut rng);
            let (mut right, others) = columns(many, rows, &mut rng);
            let wanted = |x: &[f64], y: &[f64]| -> f64 {
                (0..rows + PROJECTED).map(|r| if r < rows { x[r] * y[r] } else { -x[r] * y[r] }).sum()
            };
            let (stride, begun) = (stride(many), 0.25);
            let (left, right) = (left.filled(), right.filled());
            let mut sums = vec![begun; few * stride];
            add_products(left, right, false, &mut sums);
            let mut half = vec![begun; many * stride];
            add_products(right, right, true, &mut half);
            for i in 0..many {
                for j in 0..few {
                    assert!((sums[j * stride + i] - begun - wanted(&own[j], &others[i])).abs() < 1e-12);
                }
                for j in i..many {
                    assert!((half[j * stride + i] - begun - wanted(&others[j], &others[i])).abs() < 1e-12);
                }
            }
        }
    }

    #[test]
    fn of_no_columns_there_are_no_products() {
        let (mut none, mut some) = (Table::default(), Table::default());
        none.clear(0, 3);
        some.clear(2, 3);
        some.write(1, &[1.0; 3 + PROJECTED], 1.0);
        let (none, some) = (none.filled(), some.filled());
        let mut sums = Vec::new();
        add_products(none, some, false, &mut sums);
        add_products(none, none, true, &mut sums);
        assert!(sums.is_empty());
    }

    #[test]
    fn rows_that_are_written_whole_count_whole() {
        let mut table = Table::default();
        table.clear_rows(5, 6);
        (0..6).for_each(|row| table.row_mut(row)[..5].copy_from_slice(&[1.0, 2.0, 0.0, -1.0, row as f64]));
        let mut sums = vec![0.0; 5 * stride(5)];
        let table = table.filled();
        add_products(table, table, true, &mut sums);
        let of = |j: usize| sums[j * stride(5)..][..5].to_vec();
        assert_eq!(of(4), [15.0, 30.0, 0.0, -15.0, 55.0]);
    }
}
