//! The state of one correction: readings of the markers in, a decision out.

use super::bounds::DistanceBounds;
use super::bounds::deviate_of_look;
use super::damping::Damping;
use super::jacobian::{JacobianSource, broyden_update, marker_jacobian};
use super::judge::{Errors, grew, rms, stalled};
use super::options::CorrectOptions;
use super::plausible::{Expected, Implausible, surprise};
use super::response::{JointResponse, Move, responses};
use super::step::{StepOptions, StepProblem, StepWorkspace, correction_step};
use super::stop::*;
use super::target::Target;
use crate::error::{Error, Result};
use nalgebra::{DMatrix, Matrix3, Vector3};
use serde::Serialize;

/// A marker as it was measured at one look.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Position in the board's frame, m.
    pub point_in_frame_m: Vector3<f64>,
    /// Its covariance, m².
    pub covariance_m2: Matrix3<f64>,
    /// Sum of squared normalised residuals of its rays.
    pub chi_squared: f64,
    /// Degrees of freedom of that; 0 where it is not known.
    pub degrees_of_freedom: usize,
}

/// What is to be done next.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "do", rename_all = "snake_case")]
pub enum Decision {
    /// Command these positions, then look.
    Step {
        /// The new command, N positions, rad (m).
        command: Vec<f64>,
        /// What it changes, rad (m).
        change: Vec<f64>,
        /// Names of the joints that a limit stopped.
        at_limit: Vec<String>,
        /// The damping, m/rad.
        mu_m_per_rad: f64,
        /// 1, or the factor that shortened the step.
        scale: f64,
    },
    /// Look once more at the same posture.
    LookAgain {
        /// Whether the earlier views of this posture are to be left out.
        fresh: bool,
        /// Why: `not_seen`, `not_believed`, `uncertain`, `surprising`.
        why: &'static str,
    },
    /// Stop.
    Stop {
        /// Why.
        stop: Stop,
    },
}

/// A marker's error at one look.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MarkerError {
    /// Its name.
    pub marker: String,
    /// Target minus measured in the board's frame, m; none where it was not measured.
    pub error_m: Option<[f64; 3]>,
    /// Standard deviations of the three, m.
    pub std_m: Option<[f64; 3]>,
    /// The true distance is below this, m.
    pub below_m: Option<f64>,
    /// Why it was not believed.
    pub implausible: Option<Implausible>,
}

/// What one look saw and what followed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LookRecord {
    /// From 1.
    pub look: usize,
    /// Steps commanded before it.
    pub steps: usize,
    /// The command at which it was taken, rad (m).
    pub command: Vec<f64>,
    /// One for each marker.
    pub markers: Vec<MarkerError>,
    /// Root mean square distance, m; none where the look was not believed.
    pub rms_m: Option<f64>,
    /// What was decided.
    pub decision: Decision,
}

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

/// The last look that was believed.
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

/// What the model says can be reached from here.
struct Reach {
    left: Vec<Vector3<f64>>,
    change: Vec<f64>,
    at_limit: Vec<bool>,
}

impl Corrector {
    /// A correction towards a target; `start` is the first command (the target's posture where there is none, as in the paper).
    ///
    /// # Errors
    /// Options that make no sense; a start of the wrong length, or outside the limits (by the joint's name).
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
            if target.free[j] && !(command[j] >= least && command[j] <= most) {
                return Err(Error::OutOfRange {
                    what: format!("first command, joint {name:?}"),
                    got: command[j],
                    needed: format!("{least:.4} to {most:.4}, its limits"),
                });
            }
            // Where a feed-forward starts elsewhere, the range reaches around both.
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
    /// An index that is no position, a range that the present command is not in.
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

    /// The command at which the error was smallest so far; none before a look was believed.
    pub fn best_command(&self) -> Option<&[f64]> {
        self.best.as_ref().map(|b| b.command.as_slice())
    }

    /// All looks so far.
    pub fn records(&self) -> &[LookRecord] {
        &self.records
    }

    /// How far each joint did what it was told so far.
    pub fn responses(&self) -> Vec<JointResponse> {
        let names: Vec<&str> = self.target.robot.position_names().collect();
        responses(&self.moves, &self.jacobian, &names)
    }

    /// Takes the readings of one look at [`Self::command`] (one for each marker, none where it was not measured) and decides.
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
        for reading in readings.iter().flatten() {
            for value in reading.point_in_frame_m.iter().chain(reading.covariance_m2.iter()) {
                crate::error::finite("reading of a marker", *value)?;
            }
        }
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
        let decision = self.within_budget(decision, look, &markers);
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

    /// What is wrong with each reading.
    fn doubts(&self, readings: &[Option<Reading>]) -> Vec<Option<Implausible>> {
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

    fn expected(&self, marker: usize) -> Expected {
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

    fn marker_errors(
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

    /// A look that cannot be used: once more, or the end.
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

    /// Decides on a look that was believed.
    fn judge(&mut self, errors: Errors, readings: &[Option<Reading>]) -> Result<Decision> {
        self.failures = 0;
        let judge = self.options.judge;
        let surprising = self.surprising(readings);
        let moved = self.learn(readings);
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
        // More looks at one posture are no attempts to get closer.
        if moved || self.history_m.is_empty() {
            self.history_m.push(error);
        } else if let Some(last) = self.history_m.last_mut() {
            *last = error;
        }
        if let Some(best) = &self.best {
            self.growths =
                if grew(&errors, best.error_m, &judge) { self.growths + usize::from(moved) } else { 0 };
            if self.growths >= 2 {
                // Where a joint stands still, what the others do in its place is no divergence of the loop.
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
        if errors.indistinct() {
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
            let cause = if self.stuck() { StallCause::NotFollowing } else { StallCause::NoProgress };
            return Ok(Decision::Stop { stop: self.stall(cause, &errors, Some(&reach)) });
        }
        self.step(&errors)
    }

    /// Whether the markers are elsewhere than the last step should have put them, by more than half of it and the tolerance.
    ///
    /// A first look surprises always: nothing before it says where the markers should be but the model that is in doubt.
    fn surprising(&self, readings: &[Option<Reading>]) -> bool {
        readings.iter().enumerate().any(|(m, reading)| {
            let (Some(reading), Some(_)) = (reading, &self.last) else { return true };
            let expected = self.expected(m);
            let off = (reading.point_in_frame_m - expected.point_m).norm();
            off > 0.5 * expected.commanded_m + self.options.judge.tolerance_m
        })
    }

    /// Remembers the look, what the last step did, and corrects J by it; whether there was a step.
    fn learn(&mut self, readings: &[Option<Reading>]) -> bool {
        let now: Vec<Reading> = readings.iter().flatten().copied().collect();
        let mut moved = false;
        if let Some(last) = &self.last {
            let change: Vec<f64> = self.command.iter().zip(&last.command).map(|(a, b)| a - b).collect();
            moved = change.iter().any(|x| *x != 0.0);
            if moved {
                let one = Move {
                    change,
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
        moved
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

    /// What the joints could do from here by the model, in one step of any size, within the limits or without.
    fn reach(&self, errors: &Errors, limited: bool) -> Result<Reach> {
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

    /// Whether, twice in a row, the model sees next to nothing to gain and surely too much left.
    fn beyond_reach(&mut self, errors: &Errors, reach: &Reach) -> Result<Option<Stop>> {
        let judge = self.options.judge;
        let z = -deviate_of_look(judge.wrong_converged, errors.look, errors.error_m.len());
        let surely_left = reach
            .left
            .iter()
            .zip(&errors.covariance_m2)
            .any(|(left, covariance)| DistanceBounds::new(left, covariance).at(z) > judge.tolerance_m);
        let little = rms(&reach.left) > (1.0 - judge.least_progress) * errors.rms_m();
        self.unreachable = if surely_left && little { self.unreachable + 1 } else { 0 };
        if self.unreachable < 2 {
            return Ok(None);
        }
        let free = self.reach(errors, false)?;
        if rms(&free.left) > (1.0 - judge.least_progress) * rms(&reach.left) {
            return Ok(Some(self.stall(StallCause::OutOfReach, errors, Some(reach))));
        }
        let names: Vec<&str> = self.target.robot.position_names().collect();
        let hit = |j: usize| {
            let at = self.command[j] + reach.change[j];
            let upper = free.change[j] > 0.0;
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
        Ok(Some(Stop::LimitReached(LimitReached {
            joints: (0..names.len()).filter(|&j| reach.at_limit[j]).map(hit).collect(),
            distance_m: errors.distances_m(),
            left_m: reach.left.iter().map(Vector3::norm).collect(),
            left_without_limits_m: free.left.iter().map(Vector3::norm).collect(),
            tolerance_m: judge.tolerance_m,
        })))
    }

    /// Whether a joint surely does not do what it is told.
    fn stuck(&self) -> bool {
        self.responses().iter().any(|r| r.stuck)
    }

    fn stall(&self, cause: StallCause, errors: &Errors, reach: Option<&Reach>) -> Stop {
        Stop::Stalled(Stalled {
            cause,
            distance_m: errors.distances_m(),
            below_m: errors.bounds_m(self.options.judge.wrong_converged, 1.0),
            history_m: self.history_m.clone(),
            left_m: reach.map_or_else(Vec::new, |r| r.left.iter().map(Vector3::norm).collect()),
            responses: self.responses(),
        })
    }

    fn diverging(&self, errors: &Errors) -> Stop {
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

    /// The decision, or the end where it would take one look too many.
    fn within_budget(&self, decision: Decision, look: usize, markers: &[MarkerError]) -> Decision {
        if look < self.options.judge.looks || matches!(decision, Decision::Stop { .. }) {
            return decision;
        }
        let distance = |m: &MarkerError| m.error_m.map(|e| Vector3::from(e).norm());
        Decision::Stop {
            stop: Stop::BudgetSpent(BudgetSpent {
                looks: look,
                distance_m: markers.iter().filter_map(distance).collect(),
                history_m: self.history_m.clone(),
            }),
        }
    }
}
