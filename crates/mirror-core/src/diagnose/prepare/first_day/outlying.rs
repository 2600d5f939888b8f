//! Observations that no small error explains: a typed digit, another marker's place, a row whose joints were
//! elsewhere.
//!
//! At the fit with all small errors ([`super::verify`]), whose scale is the median's and so tolerates that half of
//! the data are false, outliers are left out before causes are searched, and listed. Where a whole frame is off,
//! each joint is tested alone: whether another position would correct the frame (a sign, a digit).

use super::misfit::Misfit;
use super::other_position::OtherPositions;
use super::variant::Variant;
use super::verify::Tolerant;
use crate::diagnose::data::left_out::{LeftOut, Reason};
use crate::diagnose::data::recording::{Frame, Recording, Target, Via};
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::frame::{FrameWork, Task};
use crate::diagnose::model::problem::{Noise, Observation, Problem, Seen};
use crate::diagnose::principles::{FAR_DEVIATIONS, MAJORITY, NEARLY_ALL, Prior, Threshold};
use crate::error::Result;
use nalgebra::Vector3;
use std::collections::{BTreeMap, BTreeSet};

/// If more than this share of a marker's observations is off, single observations are not the reason.
const MOST_OF_ONE: Threshold = 0.15;
/// A noise increased by this factor leaves every observation some weight.
const WIDE: Prior = 300.0;

/// False observations of a frame: by index among its arranged ones, and as they are listed.
#[derive(Clone)]
pub(super) struct False {
    pub frame: usize,
    pub indices: Vec<usize>,
    pub told: Vec<LeftOut>,
}

/// Observations that are false, by frame and observation of the arranged problem.
///
/// # Errors
/// Invalid parameters of camera or mirror.
pub(super) fn find(
    problem: &Problem,
    recording: &Recording,
    joint_names: &[String],
    least: Noise,
) -> Result<Vec<False>> {
    let misfit = Misfit::new(problem)?;
    let all: Vec<usize> = (0..problem.frames.len()).collect();
    let recorded = Variant::of(recording, problem);
    let distances = misfit.distances(&recorded, &all);
    let mut sizes: Vec<f64> = distances.iter().map(|d| d.size_m).collect();
    sizes.sort_by(f64::total_cmp);
    let Some(median) = sizes.get(sizes.len() / 2).copied() else { return Ok(Vec::new()) };
    // Observations are examined if they exceed the nominal model's median by this much, and exceed usual errors.
    let far = sizes.iter().filter(|s| **s > (FAR_DEVIATIONS * median).max(misfit.usual_m)).count();
    if far == 0 || far as f64 > MAJORITY * sizes.len() as f64 {
        return Ok(Vec::new());
    }
    let fit = Tolerant::fitted(problem, &all, least)?;
    let deformation = fit.deformation();
    let mut work = FrameWork::new(problem);
    let by_frame = all
        .iter()
        .map(|&frame| deviations(problem, &deformation, fit.noise, &mut work, frame))
        .collect::<Result<Vec<_>>>()?;
    let contradicted = Contradicted::of(problem, &by_frame);
    let (mut out, mut positions) = (Vec::new(), None);
    for &frame in &all {
        let deviations = &by_frame[frame];
        let markers: Vec<usize> = (0..deviations.len()).filter(|&i| deviations[i].is_some()).collect();
        let is_false = |i: &usize| deviations[*i].is_some_and(|d| d > FAR_DEVIATIONS);
        let mut chosen: Vec<usize> = markers.iter().copied().filter(is_false).collect();
        if chosen.is_empty() {
            continue;
        }
        let whole = markers.len() > 1 && chosen.len() as f64 >= NEARLY_ALL * markers.len() as f64;
        let positions = match &mut positions {
            Some(positions) => positions,
            none => none.insert(OtherPositions::new(problem, &deformation, fit.noise, recorded.clone())?),
        };
        let mut corrected = |beyond| positions.correcting(&mut work, frame, beyond, joint_names);
        let why = if whole {
            chosen.clone_from(&markers);
            Reason::WholeRow(corrected(None))
        } else {
            Reason::FarFromAll(if chosen.len() < 2 { None } else { corrected(Some(&chosen)) })
        };
        let told = chosen
            .iter()
            .map(|&i| LeftOut {
                frame: problem.frame_numbers[frame],
                target: target(problem, &problem.frames[frame].others[i]),
                deviations: deviations[i].filter(|d| d.is_finite()),
                why: why.clone(),
            })
            .collect();
        out.push(False { frame, indices: chosen, told });
    }
    let of = |frame: usize, i: usize| target(problem, &problem.frames[frame].others[i]);
    let is_sure = |frame: usize, i: usize| contradicted.has(frame, i);
    let many = off_in_many(problem, &out, &contradicted);
    for found in &mut out {
        let frame = found.frame;
        let stays = |i: usize| is_sure(frame, i) || !many.contains(&of(frame, i));
        let kept: Vec<bool> = found.indices.iter().map(|&i| stays(i)).collect();
        let mut at = kept.iter();
        found.told.retain(|_| at.next().copied().unwrap_or(false));
        found.indices.retain(|&i| stays(i));
    }
    out.retain(|o| !o.indices.is_empty());
    let count: usize = out.iter().map(|o| o.indices.len()).sum();
    // Where so much is false no single observation is to blame.
    Ok(if count as f64 > MAJORITY * sizes.len() as f64 { Vec::new() } else { out })
}

/// The markers that are off in many frames, in all views of each posture: a cause's, or slipped; no single observation is to
/// blame. Where views contradict each other so often that false observations are common, some postures have no other.
fn off_in_many(problem: &Problem, found: &[False], contradicted: &Contradicted) -> Vec<String> {
    #[derive(Default)]
    struct Count {
        seen: f64,
        sure: f64,
        open: f64,
    }
    let mut counts: BTreeMap<String, Count> = BTreeMap::new();
    for observation in problem.frames.iter().flat_map(|f| &f.others) {
        counts.entry(target(problem, observation)).or_default().seen += 1.0;
    }
    for False { frame, indices, .. } in found {
        for &i in indices {
            let count = counts.entry(target(problem, &problem.frames[*frame].others[i])).or_default();
            *(if contradicted.has(*frame, i) { &mut count.sure } else { &mut count.open }) += 1.0;
        }
    }
    let is_many = |c: &Count| {
        let false_share = (c.sure + c.open) / c.seen;
        // Of two views both are false p / (1 − p) times as often as one alone; of more, less often.
        let by_chance = c.sure * false_share / (1.0 - false_share).max(f64::EPSILON);
        c.open > MOST_OF_ONE * (c.seen - c.sure) + by_chance
    };
    counts.into_iter().filter(|(_, count)| is_many(count)).map(|(name, _)| name).collect()
}

/// Observations that another view of their marker in the same posture contradicts: one is far from the model, the other is
/// not. No error of the body does that, because all views of a posture show the same body.
struct Contradicted {
    by_frame: Vec<Vec<bool>>,
}

impl Contradicted {
    fn of(problem: &Problem, deviations: &[Vec<Option<f64>>]) -> Self {
        let markers = |frame: usize| problem.frames[frame].others.iter().map(Observation::marker);
        let mut fits: BTreeSet<(i64, usize)> = BTreeSet::new();
        for (frame, of_frame) in deviations.iter().enumerate() {
            let near = markers(frame).zip(of_frame).filter(|(_, d)| d.is_some_and(|d| d <= FAR_DEVIATIONS));
            fits.extend(near.filter_map(|(marker, _)| Some((problem.posture[frame], marker?))));
        }
        let is_off = |frame: usize, marker: Option<usize>, deviation: &Option<f64>| {
            let far = deviation.is_some_and(|d| d > FAR_DEVIATIONS);
            far && marker.is_some_and(|m| fits.contains(&(problem.posture[frame], m)))
        };
        let of = |(frame, of_frame): (usize, &Vec<Option<f64>>)| {
            markers(frame).zip(of_frame).map(|(marker, d)| is_off(frame, marker, d)).collect()
        };
        Self { by_frame: deviations.iter().enumerate().map(of).collect() }
    }

    fn has(&self, frame: usize, observation: usize) -> bool {
        self.by_frame[frame][observation]
    }
}

pub(super) fn target(problem: &Problem, observation: &Observation) -> String {
    match observation {
        Observation::Pixel { seen: Seen::Marker(m), .. } | Observation::Point { marker: m, .. } => {
            problem.scene.marker_names[*m].clone()
        }
        Observation::Pixel { .. } => "board".to_owned(),
    }
}

/// Deviations of each observation of a frame; none for one that is not a marker's or was not predicted.
fn deviations(
    problem: &Problem,
    deformation: &Deformation,
    noise: Noise,
    work: &mut FrameWork,
    frame: usize,
) -> Result<Vec<Option<f64>>> {
    let eye = problem.eye(deformation)?;
    let task = Task { gaussian: false, ..Task::of_residuals(problem, deformation, eye.as_ref(), noise) };
    let others = &problem.frames[frame].others;
    if !work.evaluate(problem, &task, frame) {
        return Ok(vec![None; others.len()]);
    }
    let mut residuals = work.residuals_of(others);
    if others.iter().zip(&residuals).any(|(o, r)| o.marker().is_some() && r.is_none()) {
        // So far off that they have no weight at all: examined again with a noise at which they have.
        let wide = Noise {
            marker_px: WIDE * noise.marker_px,
            point_m: WIDE * noise.point_m,
            corner_px: noise.corner_px,
        };
        if work.evaluate(problem, &Task { noise: wide, ..task }, frame) {
            residuals = work.residuals_of(others);
        }
    }
    // So far off that it has no weight at all: as far as possible.
    let of = |(observation, residual): (&Observation, Option<Vector3<f64>>)| {
        observation.marker()?;
        Some(residual.map_or(f64::INFINITY, |r| r.norm() / observation.marker_std(noise)))
    };
    Ok(others.iter().zip(residuals).map(of).collect())
}

/// Removes observations of a frame, given by their index among its arranged ones.
pub(super) fn remove(frame: &mut Frame, indices: &[usize]) {
    // The arranged observations are the sightings but mirrored corners, then the points.
    let mut at = 0;
    frame.sightings.retain(|s| {
        if matches!((s.target, s.via), (Target::Corner(_), Via::Mirror)) {
            return true;
        }
        at += 1;
        !indices.contains(&(at - 1))
    });
    frame.points.retain(|_| {
        at += 1;
        !indices.contains(&(at - 1))
    });
}
