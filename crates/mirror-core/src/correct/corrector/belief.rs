//! Which readings a correction accepts, and what it learns from them.

use super::super::bounds::{DistanceBounds, deviate_of_look};
use super::super::jacobian::{JacobianSource, broyden_update, marker_jacobian};
use super::super::plausible::{Expected, Implausible, surprise};
use super::super::response::Move;
use super::{Corrector, Last, MarkerError, Reading};
use crate::error::Result;
use nalgebra::Matrix3;

impl Corrector {
    /// What is wrong with each reading.
    pub(super) fn doubts(&self, readings: &[Option<Reading>]) -> Vec<Option<Implausible>> {
        let one = |(m, reading): (usize, &Option<Reading>)| {
            let reading = reading.as_ref()?;
            let expected = self.expected(m);
            let surprise = surprise(
                &reading.point_in_frame_m,
                &reading.covariance_m2,
                reading.chi_squared,
                reading.degrees_of_freedom,
                &expected,
                &self.options.judge,
            )?;
            Some(Implausible { marker: self.target.marker_names[m].clone(), surprise })
        };
        readings.iter().enumerate().map(one).collect()
    }

    pub(super) fn expected(&self, marker: usize) -> Expected {
        let Some(last) = &self.last else {
            return Expected {
                point_m: self.target.point_in_frame_m[marker],
                covariance_m2: None,
                commanded_m: 0.0,
            };
        };
        let (mut point_m, mut commanded_m) = (last.point_m[marker], 0.0);
        for j in 0..self.command.len() {
            let way = self.jacobian.fixed_view::<3, 1>(3 * marker, j) * (self.command[j] - last.command[j]);
            point_m += way;
            commanded_m += way.norm();
        }
        Expected { point_m, covariance_m2: Some(last.covariance_m2[marker]), commanded_m }
    }

    pub(super) fn marker_errors(
        &self,
        readings: &[Option<Reading>],
        doubts: &[Option<Implausible>],
        look: usize,
    ) -> Vec<MarkerError> {
        let z = deviate_of_look(self.options.judge.wrong_converged, look, readings.len());
        let one = |m: usize| {
            let error =
                readings[m].map(|r| (self.target.point_in_frame_m[m] - r.point_in_frame_m, r.covariance_m2));
            MarkerError {
                marker: self.target.marker_names[m].clone(),
                error_m: error.map(|(e, _)| e.into()),
                std_m: error.map(|(_, c)| [0, 1, 2].map(|i| c[(i, i)].max(0.0).sqrt())),
                below_m: error.map(|(e, c)| DistanceBounds::new(&e, &c).at(z)),
                implausible: doubts[m].clone(),
            }
        };
        (0..readings.len()).map(one).collect()
    }

    /// Whether the markers are not where the last step should have put them: the difference exceeds half of the
    /// step plus the tolerance.
    ///
    /// A first look always counts as unexpected, because only the model predicts it, and the model is in doubt.
    pub(super) fn surprising(&self, readings: &[Option<Reading>]) -> bool {
        readings.iter().enumerate().any(|(m, reading)| {
            let (Some(reading), Some(_)) = (reading, &self.last) else { return true };
            let expected = self.expected(m);
            let off = (reading.point_in_frame_m - expected.point_m).norm();
            off > 0.5 * expected.commanded_m + self.options.judge.tolerance_m
        })
    }

    /// Stores the look and the effect of the last step, and updates J by it; returns whether there was a step.
    pub(super) fn learn(&mut self, readings: &[Option<Reading>]) -> Result<bool> {
        let now: Vec<Reading> = readings.iter().flatten().copied().collect();
        let mut moved = false;
        if let Some(last) = &self.last {
            let change: Vec<f64> = self.command.iter().zip(&last.command).map(|(a, b)| a - b).collect();
            moved = change.iter().any(|x| *x != 0.0);
            if moved {
                // At the middle of the way: over a long one, or near a stretched limb, the reference J is not what acted.
                let middle: Vec<f64> =
                    self.command.iter().zip(&last.command).map(|(a, b)| 0.5 * (a + b)).collect();
                let (t, mut jacobian) = (&self.target, self.jacobian.clone());
                marker_jacobian(&t.robot, &middle, t.frame_link, &t.marker_links, &mut jacobian)?;
                let one = Move {
                    change,
                    jacobian,
                    moved_m: now.iter().zip(&last.point_m).map(|(r, p)| r.point_in_frame_m - p).collect(),
                    covariance_m2: now
                        .iter()
                        .zip(&last.covariance_m2)
                        .map(|(r, c)| r.covariance_m2 + c)
                        .collect(),
                };
                if self.options.jacobian == JacobianSource::Broyden {
                    let flat: Vec<f64> = one.moved_m.iter().flatten().copied().collect();
                    let trace: f64 = one.covariance_m2.iter().map(Matrix3::trace).sum();
                    let noise_m = (trace / flat.len().max(1) as f64).sqrt();
                    broyden_update(&mut self.jacobian, &one.change, &flat, noise_m);
                }
                self.moves.push(one);
            }
        }
        self.last = Some(Last {
            point_m: now.iter().map(|r| r.point_in_frame_m).collect(),
            covariance_m2: now.iter().map(|r| r.covariance_m2).collect(),
            command: self.command.clone(),
        });
        Ok(moved)
    }
}
