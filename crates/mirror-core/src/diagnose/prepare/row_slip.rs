//! Slipped rows: a run of rows that contains the picture or the measurement of another row.
//!
//! For every shift s the frames are also predicted with the commanded posture of s rows away. A run is slipped if
//! that fits far better than the frame's own posture, and far better than the scatter of the rest would by chance.

use crate::diagnose::likelihood::noise::effective;
use crate::diagnose::likelihood::normal_equations::chunks;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::frame::{FrameWork, Task};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::principles::{BEYOND_DOUBT, FEWEST_POSTURES, MAJORITY, NEARLY_ALL, Prior};
use crate::error::Result;
use crate::statistics::median;
use core::ops::Range;
use rayon::prelude::*;

/// Rows that a measurement may have slipped.
pub(crate) const LARGEST_SHIFT: i64 = 6;

/// A run of slipped rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Slip {
    /// Indices of frames, inclusive.
    pub first: usize,
    pub last: usize,
    /// The measurement of row i belongs to row i + shift.
    pub shift: i64,
    /// Gain in −2 log likelihood.
    pub gain: f64,
}

/// Standard deviation of a whole number, of frames or px, that is clear.
pub(crate) const WHOLE_STD: Prior = 0.5;

impl Slip {
    /// Standard deviations of its first and its last frame: a frame whose measurement belongs to another one of the
    /// same posture shows no slip, so a run may begin anywhere among such frames at its edge.
    pub fn edge_stds(&self, posture: &[i64]) -> [f64; 2] {
        let silent = |frame: i64| {
            let of = |f: i64| usize::try_from(f).ok().and_then(|f| posture.get(f));
            of(frame).is_some() && of(frame) == of(frame + self.shift)
        };
        let run = |from: usize, step: i64| {
            (1..).map(|k| from as i64 + step * k).take_while(|&f| silent(f)).count() as f64
        };
        // From one end of n + 1 equally likely places the root mean square distance is about n / √3.
        let std = |outside: f64, inside: f64| WHOLE_STD.hypot(outside.max(inside) / 3f64.sqrt());
        let inward = |at: usize, step: i64| if silent(at as i64) { 1.0 + run(at, step) } else { 0.0 };
        [std(run(self.first, -1), inward(self.first, 1)), std(run(self.last, 1), inward(self.last, -1))]
    }
}

/// Looks for the best run of slipped rows at the nominal model's own scatter.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn find(problem: &Problem, noise: Noise) -> Result<Option<Slip>> {
    let frames = problem.frames.len();
    let shifts: Vec<i64> = (-LARGEST_SHIFT..=LARGEST_SHIFT).filter(|s| *s != 0).collect();
    let own = costs(problem, Problem::nominal, noise, 0)?;
    let mut best: Option<Slip> = None;
    for shift in shifts {
        let other = costs(problem, Problem::nominal, noise, shift)?;
        // The run with the largest sum of gains (Kadane). Frames whose posture is the same both ways gain nothing.
        let (mut start, mut sum) = (0, 0.0);
        for f in 0..frames {
            let gain = gain_of(own[f], other[f]);
            if sum <= 0.0 {
                (start, sum) = (f, 0.0);
            }
            sum += gain;
            // In −2 log likelihood: beyond doubt, and as much again for the number of runs and shifts that are
            // tried.
            if sum > best.map_or(4.0 * BEYOND_DOUBT, |b| b.gain) && f + 1 - start >= FEWEST_POSTURES {
                best = Some(Slip { first: start, last: f, shift, gain: sum });
            }
        }
    }
    // If it is nearly all rows, the log is late, or the measurements are: found as a gross mistake, or not known.
    let nearly_all = |b: &Slip| (b.last + 1 - b.first) as f64 >= NEARLY_ALL * frames as f64;
    Ok(best.filter(|b| !nearly_all(b)))
}

/// How far rows are from their own postures, at the scatter of some of them.
struct Usual {
    scatter: Noise,
    /// Of each row, where it shows something.
    own: Vec<Option<f64>>,
    /// The median of the rows that make the scatter.
    cost: f64,
}

impl Usual {
    fn of(problem: &Problem, outside: &[bool]) -> Result<Self> {
        let scatter = effective(problem, &problem.nominal(), problem.noise, Some(outside))?;
        let own = costs(problem, Problem::nominal, scatter, 0)?;
        let cost =
            median(own.iter().zip(outside).filter(|(_, out)| **out).filter_map(|(cost, _)| *cost).collect());
        Ok(Self { scatter, own, cost })
    }
}

/// A run with the rows beside it whose positions are in no row. Where a run of the log contains the positions of k rows
/// later, the measurement of row i fits row i − k, and the positions of the run's own first k rows are overwritten; where
/// it contains those of k rows before, its last k rows'. They count as slipped where they are far from their own posture
/// at the scatter of the rows outside.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn with_overwritten_rows(problem: &Problem, mut slip: Slip) -> Result<Slip> {
    let (frames, reach) = (problem.frames.len(), slip.shift.unsigned_abs() as usize);
    let before = slip.shift < 0;
    let beside = if before {
        slip.first.saturating_sub(reach)..slip.first
    } else {
        slip.last + 1..(slip.last + 1 + reach).min(frames)
    };
    let in_run = slip.first..=slip.last;
    let outside: Vec<bool> = (0..frames).map(|f| !in_run.contains(&f) && !beside.contains(&f)).collect();
    let Usual { own, cost: usual, .. } = Usual::of(problem, &outside)?;
    let is_far = |f: &usize| own[*f].is_some_and(|cost| cost > usual + 2.0 * BEYOND_DOUBT);
    if before {
        slip.first -= beside.rev().take_while(is_far).count();
    } else {
        slip.last += beside.take_while(is_far).count();
    }
    Ok(slip)
}

/// Whether slipped rows account for what is wrong over a run of rows: most of it is among them, and with the postures of the other rows
/// they agree with the model as the rows outside do.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn accounts_for(problem: &Problem, run: Range<usize>) -> Result<bool> {
    let scatter = effective(problem, &problem.nominal(), problem.noise, None)?;
    let Some(slip) = find(problem, scatter)? else { return Ok(false) };
    let slipped = slip.first..slip.last + 1;
    let shared = slipped.end.min(run.end).saturating_sub(slipped.start.max(run.start));
    if (shared as f64) < MAJORITY * run.len() as f64 {
        return Ok(false);
    }
    let outside: Vec<bool> =
        (0..problem.frames.len()).map(|f| !run.contains(&f) && !slipped.contains(&f)).collect();
    let usual = Usual::of(problem, &outside)?;
    let other = costs(problem, Problem::nominal, usual.scatter, slip.shift)?;
    let there = median(other[slipped].iter().flatten().copied().collect());
    Ok(there < usual.cost + 2.0 * BEYOND_DOUBT)
}

/// Whether a run of slipped rows is still slipped given the causes found: with a wrong scale the neighbours of a
/// row look like its own, and once the scale is known the row's own posture fits. `problem` is one with these rows,
/// `deformation` the result as a problem's deformation.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn is_slipped(
    problem: &Problem,
    deformation: impl Fn(&Problem) -> Deformation,
    noise: Noise,
    slip: &Slip,
) -> Result<bool> {
    let own = costs(problem, &deformation, noise, 0)?;
    let other = costs(problem, &deformation, noise, slip.shift)?;
    let gain: f64 = (slip.first..=slip.last).map(|f| gain_of(own[f], other[f])).sum();
    Ok(gain > 2.0 * BEYOND_DOUBT)
}

/// What a frame gains by another row's posture, in −2 log likelihood; no single frame decides.
fn gain_of(own: Option<f64>, other: Option<f64>) -> f64 {
    match (own, other) {
        (Some(a), Some(b)) => (a - b).clamp(-2.0 * BEYOND_DOUBT, 2.0 * BEYOND_DOUBT),
        // What shows nothing neither ends a run nor is counted for it.
        (None, _) => 0.0,
        (Some(_), None) => -2.0 * BEYOND_DOUBT,
    }
}

/// Cost of each frame under the commanded posture of `shift` rows away; none where there is no such row or observation.
fn costs(
    problem: &Problem,
    deformation: impl Fn(&Problem) -> Deformation,
    noise: Noise,
    shift: i64,
) -> Result<Vec<Option<f64>>> {
    let frames = problem.frames.len();
    let mut shifted = problem.clone();
    for f in 0..frames {
        let from = (f as i64 + shift).clamp(0, frames as i64 - 1) as usize;
        shifted.scene.command_as(f, &problem.scene, from);
    }
    let deformation = deformation(&shifted);
    let eye = shifted.eye(&deformation)?;
    let task = Task::of_residuals(&shifted, &deformation, eye.as_ref(), noise);
    let parts: Vec<Vec<Option<f64>>> = chunks(frames)
        .into_par_iter()
        .map_init(
            || FrameWork::new(&shifted),
            |work, range| {
                range
                    .map(|f| {
                        let from = f as i64 + shift;
                        let there = from >= 0 && from < frames as i64;
                        (there && work.evaluate(&shifted, &task, f)).then_some(work.cost)
                    })
                    .collect()
            },
        )
        .collect();
    Ok(parts.concat())
}
