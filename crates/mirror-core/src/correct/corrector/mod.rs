//! The state of one correction: readings of the markers in, a decision out.

mod belief;
mod reach;
mod record;

pub use record::{Decision, LookRecord, MarkerError, Reading};

use super::jacobian::{JacobianSource, marker_jacobian};
use super::judge::{Errors, grew, stalled};
use super::options::CorrectOptions;
use super::plausible::Implausible;
use super::response::{JointResponse, Move, responses};
use super::step::{StepProblem, StepWorkspace, correction_step};
use super::stop::{BudgetSpent, Converged, Inconsistent, MarkerLost, StallCause, Stop};
use super::target::Target;
use crate::error::{Error, Result};
use nalgebra::{DMatrix, Matrix3, Vector3};

/// One correction: Algorithm 1 with its judgement.
#[derive(Debug, Clone)]
pub struct Corrector {
    target: Target,
    options: CorrectOptions,
    jacobian: DMatrix<f64>,
    command: Vec<f64>,
    lower: Vec<f64>,
    upper: Vec<f64>,
    workspace: StepWorkspace,
    steps: usize,
    failures: usize,
    growths: usize,
    unreachable: usize,
    uncertain: usize,
    confirmed: bool,
    last: Option<Last>,
    moves: Vec<Move>,
    history_m: Vec<f64>,
    best: Option<Best>,
    records: Vec<LookRecord>,
    stopped: bool,
}

/// The last look that was accepted.
#[derive(Debug, Clone)]
struct Last {
    point_m: Vec<Vector3<f64>>,
    covariance_m2: Vec<Matrix3<f64>>,
    command: Vec<f64>,
}

#[derive(Debug, Clone)]
struct Best {
    error_m: f64,
    look: usize,
    command: Vec<f64>,
}

impl Corrector {
    /// A correction towards a target; `start` is the first command (the target's posture where there is none, as in
    /// the paper).
    ///
    /// # Errors
    /// Invalid options; a start of the wrong length, or outside the limits (by the joint's name).
    pub fn new(target: Target, options: CorrectOptions, start: Option<&[f64]>) -> Result<Self> {
        options.check()?;
        let joints = target.robot.position_count();
        let command = start.map_or_else(|| target.posture.clone(), <[f64]>::to_vec);
        if command.len() != joints {
            return Err(Error::LengthMismatch {
                what: "first command".to_owned(),
                got: command.len(),
                needed: joints,
            });
        }
        let range = options.judge.largest_correction_rad;
        let (mut lower, mut upper) = (Vec::with_capacity(joints), Vec::with_capacity(joints));
        for (j, name) in target.robot.position_names().enumerate() {
            let (least, most) = target.limits[j];
            crate::error::finite(&format!("first command, joint {name:?}"), command[j])?;
            if target.free[j] && !(command[j] >= least && command[j] <= most) {
                return Err(Error::OutOfRange {
                    what: format!("first command, joint {name:?}"),
                    got: command[j],
                    needed: format!("{least:.4} to {most:.4}, its limits"),
                });
            }
            // If a feed-forward starts elsewhere, the range includes both.
            lower.push(least.max(target.posture[j].min(command[j]) - range));
            upper.push(most.min(target.posture[j].max(command[j]) + range));
        }
        let markers = target.marker_links.len();
        let mut jacobian = DMatrix::zeros(3 * markers, joints);
        marker_jacobian(
            &target.robot,
            &target.posture,
            target.frame_link,
            &target.marker_links,
            &mut jacobian,
        )?;
        Ok(Self {
            workspace: StepWorkspace::new(markers, joints),
            target,
            options,
            jacobian,
            command,
            lower,
            upper,
            steps: 0,
            failures: 0,
            growths: 0,
            unreachable: 0,
            uncertain: 0,
            confirmed: false,
            last: None,
            moves: Vec::new(),
            history_m: Vec::new(),
            best: None,
            records: Vec::new(),
            stopped: false,
        })
    }

    /// The target.
    pub fn target(&self) -> &Target {
        &self.target
    }

    /// Narrows the range of a position (rad, m) to what the robot itself allows; the model's limits stay in force.
    ///
    /// # Errors
    /// An invalid index, or a range that does not contain the present command.
    pub fn narrow(&mut self, position: usize, lower: f64, upper: f64) -> Result<()> {
        let Some(&command) = self.command.get(position) else {
            return Err(Error::OutOfRange {
                what: "position to be narrowed".to_owned(),
                got: position as f64,
                needed: format!("an index below {}", self.command.len()),
            });
        };
        if !(command >= lower && command <= upper) {
            let name = self.target.robot.position_names().nth(position).unwrap_or_default().to_owned();
            return Err(Error::OutOfRange {
                what: format!("first command, joint {name:?}"),
                got: command,
                needed: format!("{lower:.4} to {upper:.4}, which the robot allows"),
            });
        }
        let own = &mut self.target.limits[position];
        *own = (own.0.max(lower), own.1.min(upper));
        self.lower[position] = self.lower[position].max(lower);
        self.upper[position] = self.upper[position].min(upper);
        Ok(())
    }

    /// The command at which the next look is to be taken, rad (m).
    pub fn command(&self) -> &[f64] {
        &self.command
    }

    /// The command at which the error was smallest so far; none before a look was accepted.
    pub fn best_command(&self) -> Option<&[f64]> {
        self.best.as_ref().map(|b| b.command.as_slice())
    }

    /// All looks so far.
    pub fn records(&self) -> &[LookRecord] {
        &self.records
    }

    /// How far each joint followed its commands so far.
    pub fn responses(&self) -> Vec<JointResponse> {
        let names: Vec<&str> = self.target.robot.position_names().collect();
        responses(&self.moves, &names)
    }

    /// Takes the readings of one look at [`Self::command`] (one for each marker, none where it was not measured)
    /// and decides.
    ///
    /// # Errors
    /// Another number of readings than of markers, numbers that are not finite, a correction that has stopped.
    pub fn observe(&mut self, readings: &[Option<Reading>]) -> Result<Decision> {
        if readings.len() != self.target.marker_links.len() {
            return Err(Error::LengthMismatch {
                what: "readings of one look".to_owned(),
                got: readings.len(),
                needed: self.target.marker_links.len(),
            });
        }
        if self.stopped {
            return Err(Error::OutOfRange {
                what: "looks after the stop".to_owned(),
                got: 1.0,
                needed: "none: make a new correction".to_owned(),
            });
        }
        readings.iter().flatten().try_for_each(Reading::check)?;
        let look = self.records.len() + 1;
        let doubts = self.doubts(readings);
        let markers = self.marker_errors(readings, &doubts, look);
        let believed = readings.iter().all(Option::is_some) && doubts.iter().all(Option::is_none);
        let command = self.command.clone();
        let steps = self.steps;
        let mut rms_m = None;
        let decision = if believed {
            let errors = self.errors(readings, look);
            rms_m = Some(errors.rms_m());
            self.judge(errors, readings)?
        } else {
            self.fail(readings, doubts)
        };
        let decision = self.within_budget(decision, look);
        match &decision {
            Decision::Step { command, .. } => {
                self.command.clone_from(command);
                self.steps += 1;
                self.confirmed = false;
            }
            Decision::LookAgain { .. } => {}
            Decision::Stop { .. } => self.stopped = true,
        }
        self.records.push(LookRecord { look, steps, command, markers, rms_m, decision: decision.clone() });
        Ok(decision)
    }

    fn errors(&self, readings: &[Option<Reading>], look: usize) -> Errors {
        let (mut error_m, mut covariance_m2) = (Vec::new(), Vec::new());
        for (reading, target) in readings.iter().zip(&self.target.point_in_frame_m) {
            if let Some(reading) = reading {
                error_m.push(target - reading.point_in_frame_m);
                covariance_m2.push(reading.covariance_m2);
            }
        }
        Errors { error_m, covariance_m2, look }
    }

    /// A look that cannot be used: it is repeated, or the correction ends.
    fn fail(&mut self, readings: &[Option<Reading>], doubts: Vec<Option<Implausible>>) -> Decision {
        self.failures += 1;
        let doubts: Vec<Implausible> = doubts.into_iter().flatten().collect();
        if self.failures <= self.options.judge.retries {
            let why = if doubts.is_empty() { "not_seen" } else { "not_believed" };
            return Decision::LookAgain { fresh: !doubts.is_empty(), why };
        }
        let looks = self.failures;
        let stop = if doubts.is_empty() {
            let missing = readings.iter().zip(&self.target.marker_names).filter(|(r, _)| r.is_none());
            Stop::MarkerLost(MarkerLost { markers: missing.map(|(_, name)| name.clone()).collect(), looks })
        } else {
            Stop::Inconsistent(Inconsistent { readings: doubts, looks })
        };
        Decision::Stop { stop }
    }

    /// Decides on a look that was accepted.
    fn judge(&mut self, errors: Errors, readings: &[Option<Reading>]) -> Result<Decision> {
        self.failures = 0;
        let judge = self.options.judge;
        let surprising = self.surprising(readings);
        let moved = self.learn(readings)?;
        let below = errors.bounds_m(judge.wrong_converged, 1.0);
        if below.iter().all(|&bound| bound < judge.tolerance_m) {
            if surprising && !self.confirmed {
                self.confirmed = true;
                return Ok(Decision::LookAgain { fresh: true, why: "surprising" });
            }
            let stop = Stop::Converged(Converged {
                distance_m: errors.distances_m(),
                below_m: below,
                tolerance_m: judge.tolerance_m,
                wrong_converged: judge.wrong_converged,
            });
            return Ok(Decision::Stop { stop });
        }
        let error = errors.rms_m();
        // Repeated looks at one posture are no attempts to get closer.
        if moved || self.history_m.is_empty() {
            self.history_m.push(error);
        } else if let Some(last) = self.history_m.last_mut() {
            *last = error;
        }
        if let Some(best) = &self.best {
            self.growths =
                if grew(&errors, best.error_m, &judge) { self.growths + usize::from(moved) } else { 0 };
            if self.growths >= 2 {
                // If a joint stands still, the motion of the others in its place is no divergence of the loop.
                let stop = if self.stuck() {
                    self.stall(StallCause::NotFollowing, &errors, None)
                } else {
                    self.diverging(&errors)
                };
                return Ok(Decision::Stop { stop });
            }
        }
        if self.best.as_ref().is_none_or(|best| error < best.error_m) {
            self.best = Some(Best { error_m: error, look: errors.look, command: self.command.clone() });
        }
        // An error within the noise: more views, where even an error of 0 could not be called converged; else a small step may do.
        if errors.indistinct()
            && errors.bounds_at_zero_m(judge.wrong_converged).iter().any(|b| *b > judge.tolerance_m)
        {
            self.uncertain += 1;
            if self.uncertain <= judge.retries {
                return Ok(Decision::LookAgain { fresh: false, why: "uncertain" });
            }
            return Ok(Decision::Stop { stop: self.stall(StallCause::TooUncertain, &errors, None) });
        }
        self.uncertain = 0;
        let reach = self.reach(&errors, true)?;
        if let Some(stop) = self.beyond_reach(&errors, &reach)? {
            return Ok(Decision::Stop { stop });
        }
        if stalled(&self.history_m, &judge) {
            let stop = if self.stuck() {
                self.stall(StallCause::NotFollowing, &errors, Some(&reach))
            } else if self.little_to_gain(&errors, &reach) {
                self.out_of_reach(&errors, &reach)?
            } else {
                self.stall(StallCause::NoProgress, &errors, Some(&reach))
            };
            return Ok(Decision::Stop { stop });
        }
        self.step(&errors)
    }

    fn problem<'a>(&'a self, errors: &'a Errors, lower: &'a [f64], upper: &'a [f64]) -> StepProblem<'a> {
        StepProblem {
            jacobian: &self.jacobian,
            error_m: &errors.error_m,
            covariance_m2: &errors.covariance_m2,
            positions: &self.command,
            lower,
            upper,
            free: &self.target.free,
        }
    }

    fn step(&mut self, errors: &Errors) -> Result<Decision> {
        if self.options.jacobian == JacobianSource::Current {
            let t = &self.target;
            marker_jacobian(&t.robot, &self.command, t.frame_link, &t.marker_links, &mut self.jacobian)?;
        }
        let mut workspace = core::mem::take(&mut self.workspace);
        let problem = self.problem(errors, &self.lower, &self.upper);
        let step = correction_step(&problem, &self.options.step, &mut workspace)?;
        let names: Vec<&str> = self.target.robot.position_names().collect();
        let command = (0..names.len()).map(|j| {
            if self.target.free[j] {
                (self.command[j] + step.change[j]).clamp(self.lower[j], self.upper[j])
            } else {
                self.command[j]
            }
        });
        let decision = Decision::Step {
            command: command.collect(),
            change: step.change.to_vec(),
            at_limit: (0..names.len()).filter(|&j| step.at_limit[j]).map(|j| names[j].to_owned()).collect(),
            mu_m_per_rad: step.mu_m_per_rad,
            scale: step.scale,
        };
        self.workspace = workspace;
        Ok(decision)
    }

    /// The decision, or the end if it would need more looks than allowed.
    fn within_budget(&self, decision: Decision, look: usize) -> Decision {
        if look < self.options.judge.looks || matches!(decision, Decision::Stop { .. }) {
            return decision;
        }
        // A look that was rejected tells nothing of where the markers are.
        let points = self.last.iter().flat_map(|last| &last.point_m);
        let distances = points.zip(&self.target.point_in_frame_m).map(|(at, target)| (target - at).norm());
        Decision::Stop {
            stop: Stop::BudgetSpent(BudgetSpent {
                looks: look,
                distance_m: distances.collect(),
                history_m: self.history_m.clone(),
            }),
        }
    }
}
