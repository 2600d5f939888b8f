//! Whether a place's displacement wanders over the session rather than changes from one row to the next: a motor that warms
//! up, a lens whose focus moves, a base that settles. A step absorbs most of that, there or at another place that sees it.
//!
//! With smooth functions of time φ_0 = 1, φ_1, …, φ_m and a displacement `Σ φ_k(t) b_k`, the normal equations are
//! `A = Σ_f φ φᵀ ⊗ H_f`, `c = Σ_f φ ⊗ g_f`, with `H_f = XᵀX` and `g_f = Xᵀr` of each frame. What the φ_k gain over a constant
//! is `cᵀ A⁻¹ c − gᵀ H⁻¹ g`. Four cosines come within a tenth of a step; they follow a ramp or a wave better than a step does.
//! The best one is fitted beside all small errors, as a step is, and the marginal likelihoods are compared.

use super::by_frame::{Place, What};
use crate::diagnose::model::elementary::{Atom, Column, Weight};
use crate::diagnose::principles::{Guard, Size};
use nalgebra::{DMatrix, DVector};

/// Cosines of half a period in the session, one, and so on.
const WAVES: Size = 4;
/// Decays from the first row on, as of a motor that warms up: by this share of the session each.
const DECAYS: [f64; 2] = [0.05, 0.2];
const COUNT: Size = 1 + WAVES + DECAYS.len();
/// A scale of 0 has no prior.
const LEAST_STD: Guard = 1e-6;

fn functions(row: usize, rows: usize) -> [f64; COUNT] {
    let t = (row as f64 + 0.5) / rows as f64;
    let wave = |k: usize| (core::f64::consts::PI * k as f64 * t).cos();
    core::array::from_fn(|k| if k <= WAVES { wave(k) } else { (-t / DECAYS[k - 1 - WAVES]).exp() })
}

/// A smooth displacement of a place.
pub(super) struct Wandering {
    pub what: What,
    /// What it gains over a constant one, in χ².
    pub gain: f64,
    /// By function, then by number of the place.
    by_function: Vec<f64>,
}

impl Wandering {
    /// The best one, to first order; none where rows say nothing of the place.
    pub fn of(place: &Place) -> Option<Self> {
        let (rows, own) = (place.frames.len(), place.frames.first()?.1.len());
        let mut a = DMatrix::<f64>::zeros(COUNT * own, COUNT * own);
        let mut c = DVector::<f64>::zeros(COUNT * own);
        for (row, (h, g)) in place.frames.iter().enumerate() {
            let phi = functions(row, rows);
            for i in 0..COUNT {
                c.rows_mut(i * own, own).axpy(phi[i], g, 1.0);
                for j in 0..=i {
                    let mut block = a.view_mut((i * own, j * own), (own, own));
                    block.zip_apply(h, |to, from| *to += phi[i] * phi[j] * from);
                }
            }
        }
        let ridge = 1e-9 * a.trace().max(1e-12);
        (0..a.nrows()).for_each(|i| a[(i, i)] += ridge);
        // The first own rows and columns are those of the constant; the factor needs the lower triangle only.
        let solved = |count: usize| {
            let factor = a.view((0, 0), (count, count)).into_owned().cholesky()?;
            let right = c.rows(0, count).into_owned();
            let solution = factor.solve(&right);
            Some((right.dot(&solution), solution))
        };
        let ((all, solution), (constant, _)) = (solved(COUNT * own)?, solved(own)?);
        let by_function = solution.as_slice()[own..].to_vec();
        Some(Self { what: place.what, gain: all - constant, by_function })
    }

    /// Columns, their priors' standard deviations and starts: all functions of an atom have one scale, that of the start.
    pub fn columns(&self, atoms: &[Atom], rows: usize) -> Vec<(Column, f64, f64)> {
        let own = atoms.len();
        let value = |k: usize, i: usize| self.by_function[(k - 1) * own + i];
        let functions_of = |(i, atom): (usize, &Atom)| {
            let square = (1..COUNT).map(|k| value(k, i).powi(2)).sum::<f64>() / (COUNT - 1) as f64;
            let std = square.sqrt().max(LEAST_STD);
            let column = move |k: usize| {
                let weight = Weight::Frames((0..rows).map(|row| functions(row, rows)[k]).collect());
                (Column { atom: *atom, weight }, std, value(k, i))
            };
            (1..COUNT).map(column).collect::<Vec<_>>()
        };
        atoms.iter().enumerate().flat_map(functions_of).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::model::slips::Slipped;
    use crate::diagnose::prepare::first_day::by_frame::{Constant, Sums};

    /// A place with this displacement in each row, and its best step's gain.
    fn gains(displacement: impl Fn(f64) -> f64) -> (f64, f64) {
        const ROWS: usize = 200;
        let frame = |row: usize| {
            let t = (row as f64 + 0.5) / ROWS as f64;
            let g = DVector::from_fn(3, |i, _| {
                displacement(t) * [0.3, 1.0, -0.5][i] + 0.7 * ((9 * row + i) as f64).sin()
            });
            (DMatrix::identity(3, 3), g)
        };
        let place = Place { what: What::Slips(Slipped::Marker(0)), frames: (0..ROWS).map(frame).collect() };
        let sum = |frames: &[Sums]| {
            let zero = (DMatrix::zeros(3, 3), DVector::zeros(3));
            frames.iter().fold(zero, |(h, g), f| (h + &f.0, g + &f.1))
        };
        let constant = Constant::of(&sum(&place.frames));
        let steps = (10..190).filter_map(|k| constant.as_ref()?.gain(&sum(&place.frames[k..])));
        (steps.map(|s| s.gain).fold(0.0, f64::max), Wandering::of(&place).map_or(0.0, |w| w.gain))
    }

    #[test]
    fn a_step_gains_more_than_what_is_smooth_wherever_it_is() {
        for at in [0.1, 0.3, 0.5, 0.8] {
            for size in [4.0, 30.0] {
                let (step, smooth) = gains(|t| if t < at { 0.0 } else { size });
                assert!(step > smooth, "a step of {size} at {at}: {step:.0}, smooth {smooth:.0}");
            }
        }
    }

    #[test]
    fn a_ramp_a_wave_and_a_motor_that_warms_up_gain_more_than_a_step() {
        let ramp: fn(f64) -> f64 = |t| 4.0 * t;
        let wave = |t: f64| 3.0 * (5.0 * t + 1.0).sin();
        let warm = |t: f64| 5.0 * (1.0 - (-t / 0.12).exp());
        for (step, smooth) in [gains(ramp), gains(wave), gains(warm)] {
            assert!(smooth > step, "{smooth:.0}, a step {step:.0}");
        }
    }
}
