//! What the joints can do about an error according to the model, and the stop reasons that follow where it is too
//! little.

use super::super::bounds::{DistanceBounds, deviate_of_look};
use super::super::damping::Damping;
use super::super::judge::{Errors, rms};
use super::super::step::{StepOptions, correction_step};
use super::super::stop::{Diverging, LimitHit, LimitReached, StallCause, Stalled, Stop};
use super::Corrector;
use crate::error::Result;
use nalgebra::Vector3;

/// What can be reached from here according to the model.
pub(super) struct Reach {
    left: Vec<Vector3<f64>>,
    change: Vec<f64>,
    at_limit: Vec<bool>,
}

impl Corrector {
    /// What the joints could do from here by the model, in one step of any size, within the limits or without.
    pub(super) fn reach(&self, errors: &Errors, limited: bool) -> Result<Reach> {
        let joints = self.command.len();
        let (low, high) = (vec![f64::NEG_INFINITY; joints], vec![f64::INFINITY; joints]);
        let (lower, upper) = if limited { (&self.lower, &self.upper) } else { (&low, &high) };
        // Damping is for steps under noise; what can be reached at all is another question.
        let damping = Damping::Fixed { mu_m_per_rad: 0.0 };
        let options = StepOptions { gain: 1.0, largest_step_rad: f64::MAX, damping };
        let mut workspace = self.workspace.clone();
        let step = correction_step(&self.problem(errors, lower, upper), &options, &mut workspace)?;
        let left = errors.error_m.iter().enumerate().map(|(m, e)| {
            (0..joints).fold(*e, |left, j| left - self.jacobian.fixed_view::<3, 1>(3 * m, j) * step.change[j])
        });
        Ok(Reach { left: left.collect(), change: step.change.to_vec(), at_limit: step.at_limit.to_vec() })
    }

    /// Whether almost nothing can be gained according to the model.
    pub(super) fn little_to_gain(&self, errors: &Errors, reach: &Reach) -> bool {
        rms(&reach.left) > (1.0 - self.options.judge.least_progress) * errors.rms_m()
    }

    /// The end if, twice in a row, almost nothing can be gained according to the model and significantly too much
    /// is left.
    pub(super) fn beyond_reach(&mut self, errors: &Errors, reach: &Reach) -> Result<Option<Stop>> {
        let judge = self.options.judge;
        let z = -deviate_of_look(judge.wrong_converged, errors.look, errors.error_m.len());
        let surely_left = reach
            .left
            .iter()
            .zip(&errors.covariance_m2)
            .any(|(left, covariance)| DistanceBounds::new(left, covariance).at(z) > judge.tolerance_m);
        let beyond = surely_left && self.little_to_gain(errors, reach);
        self.unreachable = if beyond { self.unreachable + 1 } else { 0 };
        if self.unreachable < 2 { Ok(None) } else { self.out_of_reach(errors, reach).map(Some) }
    }

    /// What keeps the joints from the target: limits, or that no posture of theirs does it.
    pub(super) fn out_of_reach(&self, errors: &Errors, reach: &Reach) -> Result<Stop> {
        let free = self.reach(errors, false)?;
        if rms(&free.left) > (1.0 - self.options.judge.least_progress) * rms(&reach.left) {
            return Ok(self.stall(StallCause::OutOfReach, errors, Some(reach)));
        }
        let names: Vec<&str> = self.target.robot.position_names().collect();
        let hit = |j: usize| {
            let at = self.command[j] + reach.change[j];
            // The end at which it rests; the unlimited step may lead away from it, since the other joints are then elsewhere.
            let (to_lower, to_upper) = ((at - self.lower[j]).abs(), (self.upper[j] - at).abs());
            let upper = if to_lower == to_upper { free.change[j] > 0.0 } else { to_upper < to_lower };
            let (limit_rad, model) = if upper {
                (self.upper[j], self.target.limits[j].1)
            } else {
                (self.lower[j], self.target.limits[j].0)
            };
            LimitHit {
                joint: names[j].to_owned(),
                position_rad: at,
                limit_rad,
                of_model: limit_rad == model,
                wanted_rad: self.command[j] + free.change[j],
            }
        };
        Ok(Stop::LimitReached(LimitReached {
            joints: (0..names.len()).filter(|&j| reach.at_limit[j]).map(hit).collect(),
            distance_m: errors.distances_m(),
            left_m: reach.left.iter().map(Vector3::norm).collect(),
            left_without_limits_m: free.left.iter().map(Vector3::norm).collect(),
            tolerance_m: self.options.judge.tolerance_m,
        }))
    }

    /// Whether a joint significantly does not follow its commands.
    pub(super) fn stuck(&self) -> bool {
        self.responses().iter().any(|r| r.stuck)
    }

    pub(super) fn stall(&self, cause: StallCause, errors: &Errors, reach: Option<&Reach>) -> Stop {
        Stop::Stalled(Stalled {
            cause,
            distance_m: errors.distances_m(),
            below_m: errors.bounds_m(self.options.judge.wrong_converged, 1.0),
            history_m: self.history_m.clone(),
            left_m: reach.map_or_else(Vec::new, |r| r.left.iter().map(Vector3::norm).collect()),
            responses: self.responses(),
        })
    }

    pub(super) fn diverging(&self, errors: &Errors) -> Stop {
        let (best_error_m, best_look) =
            self.best.as_ref().map_or((f64::INFINITY, 0), |b| (b.error_m, b.look));
        Stop::Diverging(Diverging {
            error_m: errors.rms_m(),
            error_std_m: errors.rms_std_m(),
            best_error_m,
            best_look,
            history_m: self.history_m.clone(),
            responses: self.responses(),
        })
    }
}
