//! Products of a frame's columns: a table of all columns, row by row, and what a frame adds to the sums of products.

use crate::diagnose::principles::Size;
use multiversion::multiversion;

/// Extra numbers behind a column's rows: its projection on the plane's three parameters.
pub(crate) const PROJECTED: Size = 3;
/// Numbers that are handled at once: tables are as wide as a multiple of it.
pub(crate) const LANES: Size = 8;
/// Rows that are handled at once.
const ROWS: Size = 4;

/// The rows of a column that are not 0, from `start` to before `end`.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Span {
    pub start: usize,
    pub end: usize,
}

impl Span {
    /// The rows of both; as many as none where they have none in common.
    pub fn common(self, other: Self) -> Self {
        let start = self.start.max(other.start);
        Self { start, end: self.end.min(other.end).max(start) }
    }
}

/// The columns of one frame, row by row. Their parts along the plane's three parameters are the last rows.
#[derive(Debug, Default)]
pub(crate) struct Table {
    columns: usize,
    stride: usize,
    /// Rows that are the frame's, and all: a multiple of [`ROWS`] each.
    own: usize,
    rows: usize,
    values: Vec<f64>,
}

/// How far apart the rows of a table, or of sums, of so many columns are.
pub(crate) fn stride(columns: usize) -> usize {
    columns.next_multiple_of(LANES)
}

impl Table {
    /// All 0, of a frame with so many rows.
    pub fn clear(&mut self, columns: usize, rows: usize) {
        self.columns = columns;
        self.stride = stride(columns);
        self.own = rows.next_multiple_of(ROWS);
        self.rows = self.own + PROJECTED.next_multiple_of(ROWS);
        self.values.clear();
        self.values.resize(self.rows * self.stride, 0.0);
    }

    /// All 0, of so many rows without any along a plane.
    pub fn clear_rows(&mut self, columns: usize, rows: usize) {
        self.clear(columns, rows);
        self.rows = self.own;
    }

    /// A row, to be written.
    pub fn row_mut(&mut self, row: usize) -> &mut [f64] {
        &mut self.values[row * self.stride..(row + 1) * self.stride]
    }

    /// Writes a column, `weight` times a vector that is 0 outside its span.
    pub fn write(&mut self, column: usize, vector: &[f64], span: Span, weight: f64) {
        for row in span.start..span.end {
            self.values[row * self.stride + column] = weight * vector[row];
        }
        let rows = vector.len() - PROJECTED;
        for k in 0..PROJECTED {
            self.values[(self.own + k) * self.stride + column] = weight * vector[rows + k];
        }
    }
}

/// Adds the products of the columns of `left` with those of `right`, `sums[j * stride + i] += ⟨left_j, right_i⟩`:
/// rows minus the parts along the plane. For a table with itself (`half`) the products with `i ≤ j` are sufficient.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
pub(crate) fn add_products(left: &Table, right: &Table, half: bool, sums: &mut [f64]) {
    let stride = right.stride;
    for first in (0..right.rows).step_by(ROWS) {
        let sign = if first < right.own { 1.0 } else { -1.0 };
        let rows = &right.values[first * stride..(first + ROWS) * stride];
        let (a, rest) = rows.split_at(stride);
        let (b, rest) = rest.split_at(stride);
        let (c, d) = rest.split_at(stride);
        let own = &left.values[first * left.stride..(first + ROWS) * left.stride];
        for j in 0..left.columns {
            let x = [own[j], own[left.stride + j], own[2 * left.stride + j], own[3 * left.stride + j]];
            if x == [0.0; ROWS] {
                continue;
            }
            let x = x.map(|x| sign * x);
            let end = if half { (j + 1).next_multiple_of(LANES) } else { stride };
            let out = &mut sums[j * stride..j * stride + end];
            let (a, b, c, d) = (&a[..end], &b[..end], &c[..end], &d[..end]);
            for i in 0..end {
                out[i] += x[0] * a[i] + x[1] * b[i] + x[2] * c[i] + x[3] * d[i];
            }
        }
    }
}
