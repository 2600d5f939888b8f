//! Objects in the background: a detection under a marker's name that stays at one pixel while the model moves the
//! marker (a lamp, a sticker on the mirror).
//!
//! A detector that does not find a marker may find another object of its colour, the same in every picture. Of a
//! marker's pixels `z_i`, those within [`RADIUS_PX`] of one of them are such an object if they are of many postures
//! and the model's pixels `h_i` there lie far apart: `rms(h_i − h̄) > 6 radii` while `|z_i − z_k| ≤ radius`. Since
//! the pixel is the same, that is the spread of the residuals `z_i − h_i`, so that a constant error of the model
//! does not matter. A marker that really stands still is predicted to. A marker that a single joint moves stands
//! still if that joint does not move; it is not tested here.

use super::outlying::{False, target};
use crate::diagnose::data::left_out::{LeftOut, Reason};
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::elementary::{Atom, moves_against};
use crate::diagnose::model::frame::{FrameWork, Task};
use crate::diagnose::model::problem::{Noise, Observation, Problem, Seen};
use crate::diagnose::principles::{FAR_DEVIATIONS, FEWEST_OBSERVATIONS, Prior};
use crate::error::Result;
use nalgebra::Vector2;
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// How far apart two pictures' pixels of one thing are that does not move: a detector's noise, px.
const RADIUS_PX: Prior = 1.0;
/// A noise increased by this factor leaves every observation some weight.
const WIDE: Prior = 1000.0;

/// An observation of a marker: its frame, its pixel, and its distance from the model.
struct Sight {
    frame: usize,
    index: usize,
    pixel: Vector2<f64>,
    residual: Vector2<f64>,
}

/// Observations of objects that stand still in the picture.
///
/// # Errors
/// Invalid parameters of camera or mirror.
pub(super) fn find(problem: &Problem) -> Result<Vec<False>> {
    let mut found: BTreeMap<usize, False> = BTreeMap::new();
    for (marker, sights) in sights(problem)?.into_iter().enumerate() {
        if joints_that_move(problem, marker) < 2 {
            continue;
        }
        let Some((same, apart_px)) = standing_still(problem, &sights) else { continue };
        let postures = postures_of(problem, &same).len();
        let pixel = same.iter().map(|s| s.pixel).sum::<Vector2<f64>>() / same.len() as f64;
        for sight in same {
            let frame = sight.frame;
            let out = found.entry(frame).or_insert(False { frame, indices: Vec::new(), told: Vec::new() });
            out.indices.push(sight.index);
            out.told.push(LeftOut {
                frame: problem.frame_numbers[frame],
                target: target(problem, &problem.frames[frame].others[sight.index]),
                deviations: None,
                why: Reason::AtOnePixel { pixel_px: [pixel.x, pixel.y], postures, moved_px: apart_px },
            });
        }
    }
    Ok(found.into_values().collect())
}

/// The largest group of a marker's sights at one pixel, and how far apart the model has them, px; none where these are few or lie together.
fn standing_still<'s>(problem: &Problem, sights: &'s [Sight]) -> Option<(Vec<&'s Sight>, f64)> {
    let same = most_within(sights)?;
    if postures_of(problem, &same).len() < FEWEST_OBSERVATIONS {
        return None;
    }
    let count = same.len() as f64;
    let mean = same.iter().map(|s| s.residual).sum::<Vector2<f64>>() / count;
    let apart = (same.iter().map(|s| (s.residual - mean).norm_squared()).sum::<f64>() / count).sqrt();
    (apart > FAR_DEVIATIONS * RADIUS_PX).then_some((same, apart))
}

/// The observations within a radius of the one with the most neighbours. One is examined if its cell and the
/// adjacent ones, which contain all of them, have more than the best so far.
fn most_within(sights: &[Sight]) -> Option<Vec<&Sight>> {
    let cell = |s: &Sight| s.pixel.map(|x| (x / RADIUS_PX).floor() as i64);
    let mut cells: HashMap<Vector2<i64>, Vec<&Sight>> = HashMap::new();
    sights.iter().for_each(|s| cells.entry(cell(s)).or_default().push(s));
    let mut best: Vec<&Sight> = Vec::new();
    for sight in sights {
        let own = cell(sight);
        let around = (-1..=1).flat_map(|u| (-1..=1).map(move |v| own + Vector2::new(u, v)));
        let near: Vec<&Vec<&Sight>> = around.filter_map(|at| cells.get(&at)).collect();
        if near.iter().map(|c| c.len()).sum::<usize>() > best.len() {
            let within = |s: &&&Sight| (s.pixel - sight.pixel).norm() <= RADIUS_PX;
            let same: Vec<&Sight> = near.into_iter().flatten().filter(within).copied().collect();
            if same.len() > best.len() {
                best = same;
            }
        }
    }
    (!best.is_empty()).then_some(best)
}

/// How many joints that were commanded to move do so with a marker relative to the camera: a single one may itself
/// stand still.
fn joints_that_move(problem: &Problem, marker: usize) -> usize {
    let scene = &problem.scene;
    let (carrier, camera) = (problem.marker_sites[marker].node, problem.camera_site.and_then(|s| s.node));
    let between = |n: &NodeId| moves_against(Atom::Joint(*n), scene, carrier, camera);
    (0..scene.nodes()).filter(|&n| scene.moves(n)).filter(between).count()
}

fn postures_of(problem: &Problem, sights: &[&Sight]) -> BTreeSet<i64> {
    sights.iter().map(|s| problem.posture[s.frame]).collect()
}

/// The observations of each marker in pictures of which the nominal model predicts something.
fn sights(problem: &Problem) -> Result<Vec<Vec<Sight>>> {
    let mut out: Vec<Vec<Sight>> = Vec::new();
    out.resize_with(problem.marker_sites.len(), Vec::new);
    let nominal = problem.nominal();
    let eye = problem.eye(&nominal)?;
    let noise = Noise { marker_px: WIDE * problem.noise.marker_px, ..problem.noise };
    let task = Task { gaussian: false, ..Task::of_residuals(problem, &nominal, eye.as_ref(), noise) };
    let mut work = FrameWork::new(problem);
    for (frame, data) in problem.frames.iter().enumerate() {
        if !work.evaluate(problem, &task, frame) {
            continue;
        }
        let residuals = work.residuals_of(&data.others);
        for (index, (observation, residual)) in data.others.iter().zip(residuals).enumerate() {
            if let (Observation::Pixel { seen: Seen::Marker(m), pixel, .. }, Some(residual)) =
                (observation, residual)
            {
                out[*m].push(Sight { frame, index, pixel: *pixel, residual: residual.xy() });
            }
        }
    }
    problem.cancel.check()?;
    Ok(out)
}
