//! Columns of the images of many points, weighted and multiplied with each other.

use super::products::LANES;
use crate::diagnose::principles::Size;
use multiversion::multiversion;

/// Columns of a point's image: its motion in the camera's frame (a turn and a shift), focal length, centre, k1, the
/// board's scale, glass, curvature, the mirror's foot point, the residual.
pub(super) const COLUMNS: Size = 17;
pub(super) const OF_OPTICS: Size = 6;
pub(super) const OF_PLANE: Size = 13;
pub(super) const RESIDUAL: Size = 16;

/// The columns of some points, list by list.
#[derive(Debug, Default)]
pub(super) struct Pictures {
    pub rows: usize,
    /// Whether those of the optics are among them.
    pub optics: bool,
    /// A list of `2 · rows` numbers each, all u before all v.
    pub values: Vec<f64>,
    /// Not 0 where a point cannot be seen.
    pub unseen: Vec<f64>,
}

impl Pictures {
    /// Weights of the first `count` points: `weight` of a point's squared residual (px²), 0 where it was not seen.
    /// Later entries have none.
    pub fn weigh(&mut self, count: usize, mut weight: impl FnMut(Option<f64>) -> f64) {
        let rows = self.rows;
        for i in 0..rows {
            let at = 2 * RESIDUAL * rows + i;
            let seen = self.unseen[i] == 0.0;
            let squared = self.values[at].powi(2) + self.values[at + rows].powi(2);
            let w = if i < count { weight(seen.then_some(squared)) } else { 0.0 };
            if !seen {
                self.values.iter_mut().skip(i).step_by(rows).for_each(|x| *x = 0.0);
            }
            self.unseen[i] = w;
        }
        let [of_optics, of_plane] = [2 * OF_OPTICS * rows, 2 * OF_PLANE * rows];
        if self.optics {
            weigh(&self.unseen, &mut self.values);
        } else {
            weigh(&self.unseen, &mut self.values[..of_optics]);
            weigh(&self.unseen, &mut self.values[of_plane..]);
        }
    }

    /// Products of some columns (in rising order) with each other, `out[place_j * stride + place_i]` for i ≤ j.
    pub fn products(&self, which: &[usize], places: &[usize], stride: usize, out: &mut [f64]) {
        products(&self.values, 2 * self.rows, which, places, stride, out);
    }
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn weigh(weights: &[f64], values: &mut [f64]) {
    for column in values.chunks_exact_mut(weights.len().max(1)) {
        column.iter_mut().zip(weights).for_each(|(x, w)| *x *= w);
    }
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn products(
    values: &[f64],
    length: usize,
    which: &[usize],
    places: &[usize],
    stride: usize,
    out: &mut [f64],
) {
    for (j, &own) in which.iter().enumerate() {
        let a = list(values, length, own);
        // Four at a time: each number of `a` is read once for them.
        for i in (0..=j).step_by(4) {
            let b = list(values, length, which[i]);
            let c = list(values, length, which[(i + 1).min(j)]);
            let d = list(values, length, which[(i + 2).min(j)]);
            let e = list(values, length, which[(i + 3).min(j)]);
            let mut sums = [[0.0; LANES]; 4];
            for ((((a, b), c), d), e) in a.iter().zip(b).zip(c).zip(d).zip(e) {
                for l in 0..LANES {
                    sums[0][l] += a[l] * b[l];
                    sums[1][l] += a[l] * c[l];
                    sums[2][l] += a[l] * d[l];
                    sums[3][l] += a[l] * e[l];
                }
            }
            for (n, s) in sums.iter().enumerate().take(j + 1 - i) {
                let sum = ((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7]));
                out[places[j] * stride + places[i + n]] = sum;
            }
        }
    }
}

#[inline(always)]
fn list(values: &[f64], length: usize, k: usize) -> &[[f64; LANES]] {
    values[k * length..(k + 1) * length].as_chunks::<LANES>().0
}
