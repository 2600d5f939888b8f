//! How far causes move the observations: the size of an effect in the unit of the measurement.

use crate::diagnose::likelihood::normal_equations::chunks;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::frame::{FrameWork, Task};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::error::Result;
use rayon::prelude::*;

/// Mean square shift of each marker's observations between two deformations, in units of the noise.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn marker_shift(
    problem: &Problem,
    from: &Deformation,
    to: &Deformation,
    noise: Noise,
) -> Result<Vec<f64>> {
    let (eye_from, eye_to) = (problem.eye(from)?, problem.eye(to)?);
    let markers = problem.marker_sites.len();
    let task = |deformation, eye, other: &Deformation| {
        let alone = Task::of_markers(problem, deformation, eye, noise);
        Task { with_board: alone.with_board || problem.needs_fresh_board(other), ..alone }
    };
    let (a, b) = (task(from, eye_from.as_ref(), to), task(to, eye_to.as_ref(), from));
    let parts: Vec<Vec<(f64, f64)>> = chunks(problem.frames.len())
        .into_par_iter()
        .map_init(
            || FrameWork::new(problem),
            |work, frames| {
                let mut sums = vec![(0.0, 0.0); markers];
                let mut before = Vec::new();
                for frame in frames {
                    before.clear();
                    if !work.evaluate(problem, &a, frame) {
                        continue;
                    }
                    work.raw_residuals(|marker, measured, r| before.push((marker, measured, r)));
                    if !work.evaluate(problem, &b, frame) {
                        continue;
                    }
                    let mut at = 0;
                    work.raw_residuals(|marker, measured, r| {
                        if let (Some(m), Some((other, _, old))) = (marker, before.get(at))
                            && *other == Some(m)
                        {
                            let std = if measured { noise.point_m } else { noise.marker_px };
                            sums[m].0 += (r - old).norm_squared() / (std * std);
                            sums[m].1 += 1.0;
                        }
                        at += 1;
                    });
                }
                sums
            },
        )
        .collect();
    let mut total = vec![(0.0, 0.0); markers];
    for part in parts {
        for (sum, (value, count)) in total.iter_mut().zip(part) {
            sum.0 += value;
            sum.1 += count;
        }
    }
    Ok(total.iter().map(|(sum, count)| if *count > 0.0 { sum / count } else { 0.0 }).collect())
}
