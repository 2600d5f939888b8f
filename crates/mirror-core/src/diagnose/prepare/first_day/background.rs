//! A marker that is seen at one and the same pixel while the model moves it about: something in the background, a lamp, a sticker on the mirror.
//!
//! A detector that does not find a marker may find another thing of its colour, in every picture the same. Of a marker's pixels `z_i` those within
//! [`RADIUS_PX`] of one of them are of such a thing where they are of many postures and the model's pixels `h_i` there lie far apart:
//! `rms(h_i − h̄) > 6 radii` while `|z_i − z_k| ≤ radius`. With the same pixel that is the spread of the residuals `z_i − h_i`, so that no
//! offset of the model counts. A marker that really stands still is predicted to.

use super::outlying::{False, target};
use crate::diagnose::data::diagnosis::LeftOut;
use crate::diagnose::model::frame::{FrameWork, Task};
use crate::diagnose::model::problem::{Noise, Observation, Problem, Seen};
use crate::diagnose::principles::{FAR_DEVIATIONS, FEWEST_OBSERVATIONS, Prior};
use crate::error::Result;
use nalgebra::Vector2;
use std::collections::{BTreeMap, BTreeSet};

/// How far apart two pictures' pixels of one thing are that does not move: a detector's noise, px.
const RADIUS_PX: Prior = 1.0;
/// A noise wider by this factor leaves every observation some weight.
const WIDE: Prior = 1000.0;

/// An observation of a marker: where, at which pixel, and how far from the model.
struct Sight {
    frame: usize,
    index: usize,
    pixel: Vector2<f64>,
    residual: Vector2<f64>,
}

/// Observations of things that stand still in the picture.
///
/// # Errors
/// Invalid parameters of camera or mirror.
pub(super) fn find(problem: &Problem) -> Result<Vec<False>> {
    let mut found: BTreeMap<usize, False> = BTreeMap::new();
    for sights in sights(problem)? {
        let Some((same, apart_px)) = standing_still(problem, &sights) else { continue };
        let postures = postures_of(problem, &same).len();
        for sight in same {
            let frame = sight.frame;
            let out = found.entry(frame).or_insert(False { frame, indices: Vec::new(), told: Vec::new() });
            out.indices.push(sight.index);
            out.told.push(LeftOut {
                frame: problem.frame_numbers[frame],
                target: target(problem, &problem.frames[frame].others[sight.index]),
                deviations: None,
                why: format!(
                    "{}, {:.0}, {:.0}, in {postures} postures between which the model moves it by {apart_px:.0} px: something in the background, \
                     or on the mirror",
                    LeftOut::AT_ONE_PIXEL,
                    sight.pixel.x,
                    sight.pixel.y
                ),
            });
        }
    }
    Ok(found.into_values().collect())
}

/// The largest group of a marker's sights at one pixel, and how far apart the model has them, px; none where these are few or lie together.
fn standing_still<'s>(problem: &Problem, sights: &'s [Sight]) -> Option<(Vec<&'s Sight>, f64)> {
    let at = |pixel: Vector2<f64>| {
        sights.iter().filter(|s| (s.pixel - pixel).norm() <= RADIUS_PX).collect::<Vec<&Sight>>()
    };
    let same = sights.iter().map(|s| at(s.pixel)).max_by_key(Vec::len)?;
    if postures_of(problem, &same).len() < FEWEST_OBSERVATIONS {
        return None;
    }
    let count = same.len() as f64;
    let mean = same.iter().map(|s| s.residual).sum::<Vector2<f64>>() / count;
    let apart = (same.iter().map(|s| (s.residual - mean).norm_squared()).sum::<f64>() / count).sqrt();
    (apart > FAR_DEVIATIONS * RADIUS_PX).then_some((same, apart))
}

fn postures_of(problem: &Problem, sights: &[&Sight]) -> BTreeSet<i64> {
    sights.iter().map(|s| problem.posture[s.frame]).collect()
}

/// What was seen of each marker in pictures of which the nominal model predicts something.
fn sights(problem: &Problem) -> Result<Vec<Vec<Sight>>> {
    let mut out: Vec<Vec<Sight>> = Vec::new();
    out.resize_with(problem.marker_sites.len(), Vec::new);
    let nominal = problem.nominal();
    let eye = problem.eye(&nominal)?;
    let noise = Noise { marker_px: WIDE * problem.noise.marker_px, ..problem.noise };
    let task = Task { gaussian: false, ..Task::of_residuals(problem, &nominal, eye.as_ref(), noise) };
    let mut work = FrameWork::new(problem);
    let mut residuals = Vec::new();
    for (frame, data) in problem.frames.iter().enumerate() {
        if !work.evaluate(problem, &task, frame) {
            continue;
        }
        residuals.clear();
        work.raw_residuals(|marker, _, r| residuals.push((marker, r.xy())));
        let mut predicted = residuals.iter().peekable();
        for (index, observation) in data.others.iter().enumerate() {
            let marker = match observation {
                Observation::Pixel { seen: Seen::Marker(m), .. } | Observation::Point { marker: m, .. } => *m,
                Observation::Pixel { .. } => continue,
            };
            let Some((_, residual)) = predicted.next_if(|(m, _)| *m == Some(marker)) else { continue };
            if let Observation::Pixel { pixel, .. } = observation {
                out[marker].push(Sight { frame, index, pixel: *pixel, residual: *residual });
            }
        }
    }
    problem.cancel.check()?;
    Ok(out)
}
