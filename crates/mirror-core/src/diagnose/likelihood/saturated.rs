//! The saturated model, without any model of the body: each posture's markers are free.
//!
//! In the frames of one posture every marker may be anywhere: three free parameters a marker, shared by the
//! posture's views. Its estimate minus the model's prediction is the gap there; what the views then still disagree
//! on is the measurement's noise (and the optics). So noise and gap are separated without knowing any cause.

use crate::diagnose::likelihood::constant_columns::ConstantColumns;
use crate::diagnose::likelihood::factor::{cholesky, inverse};
use crate::diagnose::likelihood::normal_equations::counts;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::elementary::Atom;
use crate::diagnose::model::frame::{FrameWork, Task};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::principles::{Guard, Prior};
use crate::error::Result;
use nalgebra::{DMatrix, DVector, Vector3};
use rayon::prelude::*;

/// Prior standard deviation of a free pose from its prediction, m and rad: for a free marker, whose depth it keeps
/// finite where only one view shows it; for a part that slipped.
pub(crate) const FREE_STD: Prior = 0.05;

/// A marker of which the views determine less than this many coordinates is not measured: they have no mirror with which they
/// agree, as in pictures that are flipped.
const LEAST_DETERMINED: Guard = 0.5;

/// A marker of one posture, measured.
#[derive(Debug, Clone)]
pub(crate) struct FreeMarker {
    /// Its index.
    pub marker: usize,
    /// Measured less predicted position, in the frame of the marker's mount, m.
    pub displacement: Vector3<f64>,
    /// Expected square of the displacement if only noise were left, m².
    pub noise_m2: f64,
}

/// One posture.
#[derive(Debug, Clone)]
pub(crate) struct FreePosture {
    pub frames: Vec<usize>,
    pub markers: Vec<FreeMarker>,
    /// χ² of the markers' rows with the markers at their prediction, and set free.
    pub chi2_predicted: f64,
    pub chi2_free: f64,
    /// Rows minus what the free markers explain.
    pub freedom_left: f64,
    /// What the free markers explain.
    pub freedom_taken: f64,
    /// RMS pixel residual of the markers (none without image points), sum of squares and count.
    pub pixel_square_sum: f64,
    pub pixel_count: usize,
}

/// Groups of frames that share a posture.
pub(crate) fn postures(problem: &Problem) -> Vec<Vec<usize>> {
    let mut order: Vec<i64> = Vec::new();
    let mut groups: std::collections::HashMap<i64, Vec<usize>> = std::collections::HashMap::new();
    for (frame, posture) in problem.posture.iter().enumerate() {
        let group = groups.entry(*posture).or_default();
        if group.is_empty() {
            order.push(*posture);
        }
        group.push(frame);
    }
    order.iter().filter_map(|p| groups.remove(p)).collect()
}

/// Sets the markers of every posture free, at a deformation.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn free_markers(
    problem: &Problem,
    deformation: &Deformation,
    noise: Noise,
    gaussian: bool,
    mask: Option<&[bool]>,
) -> Result<Vec<FreePosture>> {
    let eye = problem.eye(deformation)?;
    let task = Task { gaussian, ..Task::of_markers(problem, deformation, eye.as_ref(), noise) };
    Ok(postures(problem)
        .into_par_iter()
        .map_init(
            || (FrameWork::new(problem), ConstantColumns::of(shifts(problem))),
            |(work, sums), frames| {
                let frames: Vec<usize> = frames.into_iter().filter(|&f| counts(mask, f)).collect();
                free_posture(problem, &task, frames, (work, sums))
            },
        )
        .filter(|p| !p.markers.is_empty())
        .collect())
}

/// Displacements of all markers.
fn shifts(problem: &Problem) -> impl Iterator<Item = Atom> {
    (0..problem.marker_sites.len()).flat_map(|m| (0..3).map(move |k| Atom::MarkerShift(m, k)))
}

fn free_posture(
    problem: &Problem,
    task: &Task<'_>,
    frames: Vec<usize>,
    (work, sums): (&mut FrameWork, &mut ConstantColumns),
) -> FreePosture {
    let markers = problem.marker_sites.len();
    let (mut chi2, mut rows) = (0.0, 0);
    let (mut pixel_square_sum, mut pixel_count) = (0.0, 0);
    sums.clear();
    for &frame in &frames {
        if !work.evaluate(problem, task, frame) {
            continue;
        }
        sums.add(work, problem, task.deformation);
        rows += work.other_rows;
        let first = work.row_count - work.other_rows;
        let projected = &work.residual[work.row_count..];
        chi2 += work.residual[first..work.row_count].iter().map(|r| r * r).sum::<f64>()
            - projected.iter().map(|r| r * r).sum::<f64>()
            + work.board_excess;
        work.raw_residuals(|_, measured, r| {
            if !measured {
                pixel_square_sum += r.norm_squared();
                pixel_count += 1;
            }
        });
    }
    let (h, g) = (sums.information(), sums.gradient());
    let mut out = FreePosture {
        frames,
        markers: Vec::new(),
        chi2_predicted: chi2,
        chi2_free: chi2,
        freedom_left: rows as f64,
        freedom_taken: 0.0,
        pixel_square_sum,
        pixel_count,
    };
    let seen: Vec<usize> = (0..markers).filter(|&m| (3 * m..3 * m + 3).any(|i| h[(i, i)] > 0.0)).collect();
    let index: Vec<usize> = seen.iter().flat_map(|m| [3 * m, 3 * m + 1, 3 * m + 2]).collect();
    let n = index.len();
    let prior = FREE_STD.powi(-2);
    let data = DMatrix::from_fn(n, n, |i, j| h[(index[i], index[j])]);
    let gradient = DVector::from_fn(n, |i, _| g[index[i]]);
    let Some(factor) = cholesky(&data + DMatrix::identity(n, n) * prior) else { return out };
    let solution = factor.solve(&gradient);
    let covariance = inverse(&factor);
    // The hat matrix `C H` of the data's information `H = C⁻¹ − λ I` is `I − λ C`; its trace is the effective number
    // of parameters.
    let hat = |i: usize| 1.0 - prior * covariance[(i, i)];
    let taken = (0..n).map(hat).sum::<f64>();
    // The estimate's variance under noise alone: of `C H C = C − λ C²`, smaller than C where the prior limits it.
    let scatter = |i: usize| covariance[(i, i)] - prior * covariance.column(i).norm_squared();
    out.freedom_taken = taken;
    out.freedom_left = rows as f64 - taken;
    out.chi2_free = chi2 - 2.0 * solution.dot(&gradient) + solution.dot(&(&data * &solution));
    let determined = |at: usize| (3 * at..3 * at + 3).map(hat).sum::<f64>() > LEAST_DETERMINED;
    for at in (0..seen.len()).filter(|&at| determined(at)) {
        out.markers.push(FreeMarker {
            marker: seen[at],
            displacement: solution.fixed_rows::<3>(3 * at).into_owned(),
            noise_m2: (3 * at..3 * at + 3).map(scatter).sum(),
        });
    }
    out
}
