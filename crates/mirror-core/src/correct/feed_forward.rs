//! Feed-forward: the command that reaches a wanted posture at the first attempt, from the known laws of the joints.
//!
//! Given θ, sought q with `θ = q + a + e q + s sin q + c (cos q − 1) + k τ(θ) + Σ κ_K q_K ± h`, h half the play or
//! the dead band. The torque is that of the wanted posture, which is known, so q follows joint by joint: each law
//! rises with its own command, so Newton's steps within a bracket solve it; the couplings are settled by rounds over all joints
//! (Gauss–Seidel), which contract where the shares are small. A play, and a servo with
//! stiction, leave a joint on the side from which it came: it is moved there over a way-point beyond the goal, on
//! the side on which its load holds it.

use super::limits::position_limits;
use crate::error::{Error, Result, finite, not_negative};
use crate::robot::{JointTerm, Robot};
use nalgebra::Vector3;
use std::sync::Arc;

/// Distance of a way-point beyond the goal, in multiples of the whole play: the joint then certainly arrives on the
/// right side.
const BEYOND: f64 = 2.0;
/// And this far at least, rad (m).
const LEAST_BEYOND_RAD: f64 = 0.02;
/// Upper limit of a share of its own or another's position: beyond it no command can mend the error.
const LARGEST_SHARE: f64 = 0.5;
/// Rounds over all joints. Laws without couplings need two; only couplings nearly as large as all motion need more than this.
const ROUNDS: usize = 1000;
/// Steps within one joint's law: each halves what is left or the bracket, so this is beyond a double's digits.
const STEPS: usize = 128;
/// rad (m): commands that change less from step to step are found.
const SETTLED_RAD: f64 = 1e-12;

/// One known term of a joint's law.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointError {
    /// Index of the joint's position.
    pub position: usize,
    /// Which term.
    pub term: JointTerm,
    /// Its size, in the unit of the term.
    pub value: f64,
    /// Of a coupling: index of the position of the other joint.
    pub driver: Option<usize>,
}

/// All known terms of one joint.
#[derive(Debug, Clone, Default, PartialEq)]
struct Law {
    position: usize,
    offset: f64,
    share: f64,
    sine: f64,
    cosine: f64,
    compliance: f64,
    half_play: f64,
    coupled: Vec<(usize, f64)>,
}

impl Law {
    /// The part of the error that does not depend on the joint's own command.
    fn rest(&self, command: &[f64], torque: f64, side: f64) -> f64 {
        let coupled: f64 = self.coupled.iter().map(|(k, share)| share * command[*k]).sum();
        self.offset + self.compliance * torque + coupled + side * self.half_play
    }

    /// Where the joint stands by its own terms alone, and how that rises with its command: by 1 less the shares at least.
    fn own(&self, q: f64) -> (f64, f64) {
        let (sine, cosine) = q.sin_cos();
        let at = q + self.share * q + self.sine * sine + self.cosine * (cosine - 1.0);
        (at, 1.0 + self.share + self.sine * cosine - self.cosine * sine)
    }

    /// The command at which the own terms give `target`.
    fn command(&self, target: f64) -> f64 {
        let bent = self.sine.abs() + 2.0 * self.cosine.abs();
        let (mut low, mut high) =
            ((target - bent) / (1.0 + self.share), (target + bent) / (1.0 + self.share));
        let (mut q, mut last) = (0.5 * (low + high), f64::INFINITY);
        for _ in 0..STEPS {
            let (at, rise) = self.own(q);
            let off = at - target;
            if off > 0.0 {
                high = q;
            } else {
                low = q;
            }
            let newton = q - off / rise;
            let trusted = newton >= low && newton <= high && off.abs() <= 0.5 * last;
            let next = if trusted { newton } else { 0.5 * (low + high) };
            last = off.abs();
            let step = (next - q).abs();
            q = next;
            if step <= settled(q) {
                break;
            }
        }
        q
    }

    /// By how much at most the error changes with the commands, per change of these.
    fn shares(&self) -> f64 {
        let coupled: f64 = self.coupled.iter().map(|(_, share)| share.abs()).sum();
        self.share.abs() + self.sine.abs() + self.cosine.abs() + coupled
    }

    fn add(&mut self, error: &JointError) -> Result<()> {
        match error.term {
            JointTerm::Offset => self.offset += error.value,
            JointTerm::Share => self.share += small(error)?,
            JointTerm::Sine => self.sine += small(error)?,
            JointTerm::CosineLessOne => self.cosine += small(error)?,
            JointTerm::Compliance => self.compliance += error.value,
            JointTerm::Play => self.half_play += not_negative(&of_joint(error), error.value)? / 2.0,
            JointTerm::DeadBand => self.half_play += not_negative(&of_joint(error), error.value)?,
            JointTerm::Coupling => {
                let driver = error.driver.ok_or_else(|| Error::UnknownName {
                    what: "driver of a coupled joint",
                    got: "none".into(),
                    valid: "the position of the joint that it moves along with".into(),
                })?;
                self.coupled.push((driver, small(error)?));
            }
            JointTerm::Rate => {
                return Err(Error::UnknownName {
                    what: "term that is fed forward",
                    got: error.term.name().into(),
                    valid: "all but `rate`, which grows with time".into(),
                });
            }
        }
        Ok(())
    }
}

/// From wanted postures to commands.
///
/// ```
/// use mirror_core::correct::{FeedForward, JointError};
/// use mirror_core::robot::{JointTerm, Robot};
/// let urdf = r#"<robot name="arm"><link name="base"/><link name="hand"/>
///   <joint name="elbow" type="revolute"><parent link="base"/><child link="hand"/><axis xyz="0 1 0"/>
///     <limit lower="-2" upper="2" effort="1" velocity="1"/></joint></robot>"#;
/// let robot = std::sync::Arc::new(Robot::from_urdf_str(urdf)?);
/// let zero = JointError { position: 0, term: JointTerm::Offset, value: 0.05, driver: None };
/// let ahead = FeedForward::new(robot, 0, [0.0, 0.0, -9.81].into(), &[zero])?;
/// let (mut way_point, mut command) = ([0.0], [0.0]);
/// ahead.commands(&[0.5], &mut way_point, &mut command)?;
/// assert!((command[0] - 0.45).abs() < 1e-12 && way_point == command);
/// # Ok::<(), mirror_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct FeedForward {
    robot: Arc<Robot>,
    held_link: usize,
    gravity_in_held_link_m_per_s2: Vector3<f64>,
    laws: Vec<Law>,
    limits: Vec<(f64, f64)>,
}

impl FeedForward {
    /// From the known errors of a robot's joints. `held_link` stands still, gravity is in its frame, m/s².
    ///
    /// # Errors
    /// A position or link that the robot does not have, a number that is not finite, a share of 0.5 and more or shares of 1 and more
    /// together, a negative width, a coupling without its driver, a term that grows with time.
    pub fn new(
        robot: Arc<Robot>,
        held_link: usize,
        gravity_in_held_link_m_per_s2: Vector3<f64>,
        errors: &[JointError],
    ) -> Result<Self> {
        let count = robot.position_count();
        let mut laws: Vec<Law> = Vec::new();
        for error in errors {
            for position in [Some(error.position), error.driver].into_iter().flatten() {
                if position >= count {
                    return Err(Error::OutOfRange {
                        what: "position of a joint's error".into(),
                        got: position as f64,
                        needed: format!("an index below {count}"),
                    });
                }
            }
            finite(&of_joint(error), error.value)?;
            let at = laws.iter().position(|law| law.position == error.position).unwrap_or_else(|| {
                laws.push(Law { position: error.position, ..Law::default() });
                laws.len() - 1
            });
            laws[at].add(error)?;
        }
        // Below 1 each law rises with its command, and the rounds contract, whatever the couplings' chain.
        if let Some(law) = laws.iter().find(|law| law.shares() >= 1.0) {
            return Err(Error::OutOfRange {
                what: format!(
                    "errors of the joint at position {} together, as a share of its motion",
                    law.position
                ),
                got: law.shares(),
                needed: "less than 1: what is larger is no small error that a command can mend".into(),
            });
        }
        let limits = position_limits(&robot);
        Ok(Self { robot, held_link, gravity_in_held_link_m_per_s2, laws, limits })
    }

    /// Whether some joint is brought to its place over a way-point.
    pub fn has_way_points(&self) -> bool {
        self.laws.iter().any(|law| law.half_play > 0.0)
    }

    /// Positions of the joints whose law is known.
    pub fn positions(&self) -> impl Iterator<Item = usize> + '_ {
        self.laws.iter().map(|law| law.position)
    }

    /// Commands (N, nq) that end in the wanted postures (N, nq), rad (m), and the way-points before them, which equal the commands at
    /// joints without play. All within the limits of the joints and of those that follow them (mimic).
    ///
    /// # Errors
    /// Arrays whose lengths differ or are no multiple of nq, positions that are not finite; [`Error::OutOfRange`] by the joint's name
    /// where couplings, with the joints' own errors nearly as large as all motion, do not settle in 1000 rounds.
    pub fn commands(&self, wanted: &[f64], way_points: &mut [f64], commands: &mut [f64]) -> Result<()> {
        let count = self.robot.position_count();
        for (what, got) in [("way-points", way_points.len()), ("commands", commands.len())] {
            if got != wanted.len() {
                return Err(Error::LengthMismatch { what: what.into(), got, needed: wanted.len() });
            }
        }
        let mut torques = vec![0.0; wanted.len()];
        let (held, gravity) = (self.held_link, &self.gravity_in_held_link_m_per_s2);
        self.robot.gravity_torques_batch(wanted, gravity, held, &mut torques)?;
        commands.copy_from_slice(wanted);
        way_points.copy_from_slice(wanted);
        if count == 0 {
            return Ok(());
        }
        let rows = commands.chunks_exact_mut(count).zip(way_points.chunks_exact_mut(count));
        for ((command, way_point), (wanted, torque)) in
            rows.zip(wanted.chunks_exact(count).zip(torques.chunks_exact(count)))
        {
            self.solve(wanted, torque, command)?;
            way_point.copy_from_slice(command);
            for law in self.laws.iter().filter(|law| law.half_play > 0.0) {
                let p = law.position;
                let margin = LEAST_BEYOND_RAD.max(BEYOND * 2.0 * law.half_play);
                way_point[p] = self.within(p, command[p] + side(torque[p]) * margin);
            }
        }
        Ok(())
    }

    fn solve(&self, wanted: &[f64], torque: &[f64], command: &mut [f64]) -> Result<()> {
        let mut moving: Option<(&Law, f64)> = None;
        for _ in 0..ROUNDS {
            moving = None;
            // Sequentially, so that a coupled joint sees its driver's command, not its wanted position.
            for law in &self.laws {
                let p = law.position;
                let target = wanted[p] - law.rest(command, torque[p], side(torque[p]));
                let next = self.within(p, law.command(target));
                let change = (next - command[p]).abs();
                if change > settled(next) && moving.is_none_or(|(_, most)| change > most) {
                    moving = Some((law, change));
                }
                command[p] = next;
            }
            if moving.is_none() {
                return Ok(());
            }
        }
        let Some((law, got)) = moving else { return Ok(()) };
        let name = self.robot.position_names().nth(law.position).unwrap_or_default();
        Err(Error::OutOfRange {
            what: format!("change of the command of joint {name:?} in round {ROUNDS} (rad or m)"),
            got,
            needed: format!(
                "at most {:e}: its errors and couplings are together {:.4} of its motion, which no command can mend; correct the \
                 model of this joint, or leave out its coupling",
                settled(command[law.position]),
                law.shares()
            ),
        })
    }

    fn within(&self, position: usize, value: f64) -> f64 {
        let (lower, upper) = self.limits[position];
        value.max(lower).min(upper)
    }
}

/// A command that changes by no more than this is found, rad (m): far out a double has fewer digits.
fn settled(command: f64) -> f64 {
    SETTLED_RAD.max(8.0 * f64::EPSILON * command.abs())
}

/// Side of its play on which the joint must rest: +1 if its load pushes it up; then it comes from above.
fn side(torque: f64) -> f64 {
    if torque > 0.0 { 1.0 } else { -1.0 }
}

/// What an error is called in messages.
fn of_joint(error: &JointError) -> String {
    format!("{} of a joint", error.term.name())
}

fn small(error: &JointError) -> Result<f64> {
    if error.value.abs() < LARGEST_SHARE {
        return Ok(error.value);
    }
    Err(Error::OutOfRange {
        what: of_joint(error),
        got: error.value,
        needed: format!(
            "less than {LARGEST_SHARE}: what is larger is no small error that a command can mend"
        ),
    })
}
