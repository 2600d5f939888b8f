//! Change points: the row from which on a marker, the board or the camera has another pose (a slip), or a
//! joint another zero.
//!
//! At the fit with all small errors ([`super::verify`]) each place gets a constant displacement a and another one,
//! b, from row k on. With `H_f = XᵀX` and `g_f = Xᵀr` frame by frame, and sums over all frames (H, g) and from k on
//! (H_b, g_b), the gain of b is `eᵀ S⁻¹ e`, `e = g_b − H_b H⁻¹ g`, `S = H_b − H_b H⁻¹ H_b`: all k in one pass. The
//! best place and row is fitted again with all small errors, and kept if its marginal likelihood is far above that
//! without it. The same holds for a place that slipped, and some rows later again ([`super::there_and_back`]). A place that
//! wanders over the session looks like one that slipped ([`super::wandering`]): the evidence must be for the step.
//!
//! A lost zero moves what the joint carries like a slip along the joint's circle. It has one parameter, a slip three or
//! six: the evidence decides. Of a joint that rests elsewhere in each posture there is less evidence than the rows say
//! ([`super::posture_scatter`]). A lost zero is also compared with play or sticking at one joint ([`super::hysteresis`]), which
//! looks like a change where the joint turns back.

use super::by_frame::{Constant, Gain, Place, Sums, What, markers, moved, zeros};
use super::hysteresis::{self, OfJoint};
use super::mistake::{Changes, Mistake};
use super::posture_scatter;
use super::there_and_back::best_run;
use super::verify::{Tolerant, smaller};
use super::wandering::Wandering;
use crate::diagnose::likelihood::noise::{effective, estimate};
use crate::diagnose::likelihood::saturated::FREE_STD;
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::elementary::{Atom, Column, Weight};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::model::slips::{Slip, Slipped, following};
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::{
    A_GAP, ABOVE_SCATTER, BEYOND_DOUBT, FEWEST_FRAMES, Guard, LEAST_LOG_ODDS, MAJORITY, Prior, Size,
    Threshold,
};
use crate::error::Result;
use core::ops::Range;
use nalgebra::{DMatrix, DVector, Vector6};

/// Displacement and small errors are estimated alternately until the change is within chance (in χ²).
pub(super) const WITHIN_CHANCE: Threshold = 4.0;
/// Slips that are fitted, largest gain first; in addition the best zero of a joint.
const SLIPS_TRIED: Size = 3;
/// Prior standard deviation of a change of a joint's zero, rad or m.
pub(super) const ZERO_STD: Prior = 0.2;
/// What wanders is fitted where it gains at least this share of what a step gains.
const LEAST_OF_STEP: Guard = MAJORITY * MAJORITY;
/// The only entry of a motion that a joint has.
pub(super) const LAST: Size = 5;
/// The last entries of a motion are those that its place has.
#[derive(Clone)]
pub(super) struct Best {
    pub what: What,
    pub rows: Range<usize>,
    pub motion: Vector6<f64>,
    std: Vector6<f64>,
    /// The place's displacement behind the rows, and its standard deviations, where these do not go to the end.
    behind: Option<(Vector6<f64>, Vector6<f64>)>,
    pub gain: f64,
}

impl Best {
    /// A step of a place, or a run of rows that ends before the last.
    fn of(place: &Place, rows: Range<usize>, found: &Gain) -> Self {
        let (motion, std) = found.motion();
        let behind = (rows.end < place.frames.len()).then(|| (Vector6::zeros(), std));
        Self { what: place.what, rows, motion, std, behind, gain: found.gain }
    }

    fn is_of_zero(&self) -> bool {
        matches!(self.what, What::Zero(_))
    }

    pub fn mistakes(&self, problem: &Problem) -> Vec<Mistake> {
        let what = match self.what {
            What::Slips(what) => what,
            What::Zero(node) => {
                let (joint, multiplier, _) = problem.scene.body.nodes[node].command;
                let offset = self.motion[LAST] / multiplier;
                return vec![Mistake::ZeroLost { joint, first: self.rows.start, offset }];
            }
        };
        let slip = |first, motion, std| Mistake::Slip { slip: Slip { what, first, motion }, std };
        let there = slip(self.rows.start, self.motion, self.std);
        let Some((behind, its_std)) = &self.behind else { return vec![there] };
        let std = self.std.zip_map(its_std, f64::hypot);
        vec![there, slip(self.rows.end, following(&self.motion, behind), std)]
    }
}

/// The slip, or with `zeros` the change of a joint's zero, that is clear, if there is one; or a slip and the way back.
///
/// # Errors
/// Invalid parameters of camera or mirror.
pub(super) fn find(problem: &Problem, frames: &[usize], least: Noise, zeros: bool) -> Result<Changes> {
    if !problem.scene.ordered || problem.frames.len() < 2 * FEWEST_FRAMES {
        return Ok(None);
    }
    let size = |noise: Noise| problem.of_observations(noise);
    let leaves_a_gap = |deformation: &Deformation| -> Result<bool> {
        Ok(size(effective(problem, deformation, least, None)?) >= A_GAP * size(least))
    };
    if !leaves_a_gap(&problem.nominal())? {
        return Ok(None);
    }
    let mut without = Tolerant::fitted(problem, frames, least)?;
    if !leaves_a_gap(&without.deformation())? {
        return Ok(None);
    }
    let of_joints = of_zeros(problem, &without.deformation(), without.noise)?;
    let (mut bests, wandering) = best_changes(&without, problem, &of_joints, zeros)?;
    bests.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let Some(largest) = bests.first().map(|b| b.gain) else { return Ok(None) };
    let hysteresis = hysteresis::likeliest(problem, &without, &sums_of(&of_joints));
    let mut play = None;
    if let Some(hysteresis) = hysteresis.as_ref().filter(|h| h.gain > largest) {
        let with = hysteresis.fitted(problem, &without, least)?;
        // Where play or sticking leaves nothing, there is nothing for a change to explain.
        if !leaves_a_gap(&with.deformation())? {
            return Ok(None);
        }
        play = Some(with);
    }
    // To first order zeros of several joints imitate a slip of the board or the camera: they must not replace it.
    let (of_zeros, mut slips): (Vec<Best>, Vec<Best>) = bests.into_iter().partition(Best::is_of_zero);
    slips.truncate(SLIPS_TRIED);
    let bests = slips.into_iter().chain(of_zeros.into_iter().take(1));
    let mut tried = Vec::new();
    for best in bests {
        problem.cancel.check()?;
        tried.push(together(problem, frames, least, &best)?);
    }
    // If the model with the slip is still far from the noise, something else is wrong, and a step absorbs part of it.
    let mut close = Vec::new();
    for (best, fit) in tried {
        let is_near = |noise: Noise| size(fit.noise) <= ABOVE_SCATTER * size(noise);
        if is_near(least) || is_near(estimate(fit.problem(), &fit.deformation(), least)?) {
            close.push((best, fit));
        }
    }
    if close.is_empty() {
        return Ok(None);
    }
    let noise = close.iter().map(|t| t.1.noise).fold(without.noise, smaller);
    let alone = without.log_evidence(noise)?;
    let mut found: Option<(f64, Best, Tolerant)> = None;
    for (best, mut fit) in close {
        let odds = fit.log_evidence(noise)? - alone;
        if odds > found.as_ref().map_or(BEYOND_DOUBT, |f| f.0) {
            found = Some((odds, best, fit));
        }
    }
    let Some((mut odds, best, mut fit)) = found else { return Ok(None) };
    if let (None, Some(hysteresis)) = (&play, &hysteresis) {
        play = Some(hysteresis.fitted(problem, &without, least)?);
    }
    if let Some(mut play) = play {
        let noise = smaller(noise, play.noise);
        odds = odds.min(fit.log_evidence(noise)? - play.log_evidence(noise)?);
    }
    if odds <= BEYOND_DOUBT {
        return Ok(None);
    }
    if let What::Zero(node) = best.what
        && !posture_scatter::is_beyond(&fit, node, (best.rows.start, best.motion[LAST]))?
    {
        return Ok(None);
    }
    // Where it is, and where what is smooth in time gains most.
    let own = wandering.iter().find(|w| w.what == best.what);
    let most = wandering.iter().filter(|w| w.what != best.what).max_by(|a, b| a.gain.total_cmp(&b.gain));
    for other in own.into_iter().chain(most).filter(|w| w.gain > LEAST_OF_STEP * best.gain) {
        let columns = other.columns(&atoms_of(other.what).1, problem.frames.len());
        let mut smooth = Tolerant::fitted_with(problem, frames, least, columns)?;
        let noise = smaller(noise, smooth.noise);
        let against = fit.log_evidence(noise)? - smooth.log_evidence(noise)?;
        if against < LEAST_LOG_ODDS {
            return Ok(None);
        }
        odds = odds.min(against);
    }
    Ok(Some((best.mistakes(problem), odds)))
}

/// The products of each joint's column in each frame.
fn sums_of(of_joints: &[Place]) -> Vec<OfJoint> {
    let sums = |place: &Place| place.frames.iter().map(|(h, g)| (h[(0, 0)], g[0])).collect();
    let of = |place: &Place| match place.what {
        What::Zero(node) => Some((node, sums(place))),
        What::Slips(_) => None,
    };
    of_joints.iter().filter_map(of).collect()
}

/// The offset of a joint's zero from a row on, with everything else as in the model, from a start near it: beside all
/// small errors a drift that cancels a part of the step would bias it.
///
/// # Errors
/// Invalid parameters of camera or mirror.
pub(super) fn settle_zero(problem: &Problem, node: NodeId, first: usize, offset: f64) -> Result<f64> {
    let mut model = problem.nominal();
    let add = |model: &mut Deformation, by: f64| {
        (first..problem.frames.len()).for_each(|f| model.add_joint_delta(f, node, by));
    };
    add(&mut model, offset);
    let mut offset = offset;
    for _ in 0..SOLVER.final_steps {
        let noise = effective(problem, &model, problem.noise, None)?;
        let places = zeros(problem, &model, noise, &[node])?;
        let Some(more) = places.first().and_then(|place| scan(place, first..first + 1)) else { break };
        if more.gain < WITHIN_CHANCE {
            break;
        }
        add(&mut model, more.motion[LAST]);
        offset += more.motion[LAST];
    }
    Ok(offset)
}

/// The motion's numbers of a place: the first one's index, and what each does.
fn atoms_of(what: What) -> (usize, Vec<Atom>) {
    match what {
        What::Slips(Slipped::Marker(m)) => (3, (0..3).map(|k| Atom::MarkerShift(m, k)).collect()),
        What::Slips(Slipped::Camera) => (0, (0..6).map(Atom::CameraMount).collect()),
        What::Slips(Slipped::Board) => (0, (0..6).map(Atom::BoardSlip).collect()),
        What::Zero(node) => (LAST, vec![Atom::Joint(node)]),
    }
}

/// 1 over some of the rows, 0 in the others.
pub(super) fn over(rows: &Range<usize>, count: usize) -> Weight {
    Weight::Frames((0..count).map(|f| f64::from(u8::from(rows.contains(&f)))).collect())
}

/// A change with columns of its own, estimated together with all small errors: over its rows, and behind them.
fn together(problem: &Problem, frames: &[usize], least: Noise, best: &Best) -> Result<(Best, Tolerant)> {
    let (from, atoms) = atoms_of(best.what);
    let std = if from == LAST { ZERO_STD } else { FREE_STD };
    let count = problem.frames.len();
    // From the linear estimate: from 0 everything that slipped would look false.
    let columns_over = |rows: Range<usize>, motion: Vector6<f64>| {
        let column = move |(k, atom): (usize, &Atom)| {
            (Column { atom: *atom, weight: over(&rows, count) }, std, motion[from + k])
        };
        atoms.iter().enumerate().map(column).collect::<Vec<_>>()
    };
    let mut columns = columns_over(best.rows.clone(), best.motion);
    if let Some((behind, _)) = best.behind {
        columns.extend(columns_over(best.rows.end..count, behind));
    }
    let fit = Tolerant::fitted_with(problem, frames, least, columns)?;
    let fitted = |further: &[(f64, f64)]| {
        let (mut motion, mut std) = (Vector6::zeros(), Vector6::zeros());
        for (k, (value, its_std)) in further.iter().enumerate() {
            (motion[from + k], std[from + k]) = (*value, *its_std);
        }
        (motion, std)
    };
    let further = fit.further();
    let (over, behind) = further.split_at(atoms.len());
    let (motion, std) = fitted(over);
    let behind = best.behind.map(|_| fitted(behind));
    Ok((Best { motion, std, behind, ..best.clone() }, fit))
}

/// The best row of each place that may slip, and with `zeros` of each joint's zero; and how each place may wander.
fn best_changes(
    fit: &Tolerant,
    problem: &Problem,
    all_joints: &[Place],
    zeros: bool,
) -> Result<(Vec<Best>, Vec<Wandering>)> {
    let deformation = fit.deformation();
    let markers = markers(problem, &deformation, fit.noise)?;
    let mut mounts = Vec::new();
    if problem.board.is_some() {
        mounts.push(moved(problem, &deformation, fit.noise, Slipped::Board)?);
    }
    if problem.camera_site.is_some() {
        mounts.push(moved(problem, &deformation, fit.noise, Slipped::Camera)?);
    }
    let may_change = || markers.iter().chain(if zeros { all_joints } else { &[] }).chain(&mounts);
    let steps: Vec<Best> = may_change().filter_map(|place| scan(place, 0..problem.frames.len())).collect();
    let runs = markers.iter().chain(&mounts).filter_map(|place| {
        let (rows, found) = best_run(place)?;
        // Two ends where a step has one.
        let of_step = steps.iter().find(|s| s.what == place.what).map_or(0.0, |s| s.gain);
        (found.gain > of_step + 2.0 * BEYOND_DOUBT).then(|| Best::of(place, rows, &found))
    });
    let runs: Vec<Best> = runs.collect();
    // In χ², of so many rows and places that are tried.
    let clear = steps.into_iter().chain(runs).filter(|best| best.gain > 2.0 * BEYOND_DOUBT);
    Ok((clear.collect(), may_change().filter_map(Wandering::of).collect()))
}

/// Zeros of all joints that move what is seen.
pub(super) fn of_zeros(problem: &Problem, deformation: &Deformation, noise: Noise) -> Result<Vec<Place>> {
    let scene = &problem.scene;
    let joints: Vec<NodeId> = (0..scene.nodes()).filter(|&n| scene.relevant[n] && scene.moves(n)).collect();
    zeros(problem, deformation, noise, &joints)
}

/// The best of some rows from which on the place may be displaced.
pub(super) fn scan(place: &Place, rows: Range<usize>) -> Option<Best> {
    let count = place.frames.first()?.0.nrows();
    let zero = || (DMatrix::zeros(count, count), DVector::zeros(count));
    let add = |(h, g): Sums, f: &Sums| (h + &f.0, g + &f.1);
    let constant = Constant::of(&place.frames.iter().fold(zero(), add))?;
    let mut behind = zero();
    let mut best: Option<(usize, Gain)> = None;
    for k in (FEWEST_FRAMES..place.frames.len()).rev() {
        behind = add(behind, &place.frames[k]);
        if place.frames.len() - k < FEWEST_FRAMES || !rows.contains(&k) {
            continue;
        }
        let Some(found) = constant.gain(&behind) else { continue };
        // The earliest of rows without anything seen between: a board seen there may have been left out because it slipped.
        if best.as_ref().is_none_or(|(_, x)| found.gain >= x.gain) {
            best = Some((k, found));
        }
    }
    best.map(|(k, found)| Best::of(place, k..place.frames.len(), &found))
}
