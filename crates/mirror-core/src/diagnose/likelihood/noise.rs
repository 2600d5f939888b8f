//! The measurement's noise, estimated from the data: the part that no model of the body or of the optics could
//! explain.

use crate::diagnose::effects::hypothesis::nuisances;
use crate::diagnose::likelihood::normal_equations::{chunks, counts};
use crate::diagnose::likelihood::saturated::free_markers;
use crate::diagnose::model::camera_and_mirror::FootPoints;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::false_corners::{extent, homography_rows};
use crate::diagnose::model::frame::{FrameWork, PROJECTED, Task};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::model::robust::OUTLIER_FRACTION;
use crate::diagnose::model::solver::{NEGLIGIBLE, SOLVER};
use crate::diagnose::principles::{FAR_DEVIATIONS, FEWEST_REDUNDANT_ROWS, Guard, NEARLY_ALL, Prior};
use crate::error::Result;
use nalgebra::{SMatrix, SVector, Vector2};
use rayon::prelude::*;

/// Lower bound of the noise (px): tables are rounded at 1e-4 px, and noise-free sessions must not divide by 0.
const LEAST_PIXEL_STD_PX: Guard = 0.005;
/// Rows of a posture with fewer degrees of freedom left by its free markers give no estimate of the noise.
const LEAST_LEFT: Guard = 1.5;
/// Corners beyond the mirror's three parameters that a board must have to estimate the optics' residual.
const LEAST_OF_A_BOARD: Guard = 1.0;
/// A stated noise is a rule of thumb, one figure for corners and blobs, which differ by two commonly: relative, one
/// standard deviation.
pub(crate) const STATED_LOG_STD: Prior = 0.3;
/// A noise that fell by no more than this factor counts as unchanged.
pub(crate) const SETTLED: Guard = 0.9;

/// Estimates the noise of corners and markers.
///
/// * Corners: residuals of each board at its best plane, minus a smooth picture of any wrong optics (the eight
///   columns of a homography), pooled by the median over frames.
/// * Markers: the disagreement of the views of one posture with every marker free, pooled by the median over
///   postures; where postures have one view only, what the session states.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn estimate(problem: &Problem, deformation: &Deformation, stated: Noise) -> Result<Noise> {
    let mut noise = stated;
    if let Some(corner) = corner_noise(problem)? {
        noise.corner_px = corner.max(LEAST_PIXEL_STD_PX);
    }
    if problem.camera.is_some() {
        // The markers' share of the rows' variance depends on the planes', which the corners' noise sets: iterate.
        for _ in 0..SOLVER.rounds {
            let postures = free_markers(problem, deformation, noise, true, None)?;
            let redundant: f64 = postures.iter().map(|p| p.freedom_left).sum();
            let ratios = postures
                .iter()
                .filter(|p| p.freedom_left > LEAST_LEFT)
                .map(|p| (p.chi2_free, p.freedom_left));
            if redundant < FEWEST_REDUNDANT_ROWS {
                break;
            }
            let Some(scale) = median_variance(ratios.collect()) else { break };
            noise.marker_px = (noise.marker_px * scale.sqrt()).max(LEAST_PIXEL_STD_PX);
            if is_settled(scale) {
                break;
            }
        }
    }
    if problem.camera.is_none() {
        // The noise cannot exceed the total of the residuals.
        let least = Noise { point_m: NEGLIGIBLE, ..noise };
        let left = effective(problem, deformation, least, None)?.point_m;
        // A stated noise is too large if the residuals are smaller than chance and the fitted parameters allow: of few
        // points an unknown frame and unknown mounts leave hardly anything.
        let rows = 3 * problem.frames.iter().map(|frame| frame.others.len()).sum::<usize>();
        let redundant = rows as f64 - nuisances(problem).len() as f64;
        let left = left * (rows as f64 / redundant.max(1.0)).sqrt();
        if redundant >= FEWEST_REDUNDANT_ROWS && left < NEARLY_ALL * noise.point_m {
            noise.point_m = left;
        }
    }
    noise.point_m = noise.point_m.max(NEGLIGIBLE);
    Ok(noise)
}

/// Whether a noise whose variance was multiplied by this need not be estimated again: the planes' share of the rows'
/// variance, by which the estimate depends on it, is a small one, so that it would change by a small part of this.
pub(crate) fn is_settled(scale: f64) -> bool {
    (scale - 1.0).abs() < SOLVER.noise_settled
}

/// The variance ratio whose χ² medians match the data's: the median of `χ²/ν` over the median of a χ² of that many
/// degrees of freedom (Wilson and Hilferty), with equal weights of all groups.
fn median_variance(mut groups: Vec<(f64, f64)>) -> Option<f64> {
    if groups.is_empty() {
        return None;
    }
    let ratio = |(chi2, freedom): &(f64, f64)| {
        let median = freedom * (1.0 - 2.0 / (9.0 * freedom)).powi(3);
        chi2 / median
    };
    groups.sort_by(|a, b| ratio(a).total_cmp(&ratio(b)));
    Some(ratio(&groups[groups.len() / 2]))
}

fn corner_noise(problem: &Problem) -> Result<Option<f64>> {
    let nominal = problem.nominal();
    let Some(eye) = problem.eye(&nominal)? else { return Ok(None) };
    let mut work = FrameWork::new(problem);
    let groups = (0..problem.frames.len())
        .filter_map(|frame| {
            let residuals = work.board_residuals(problem, &nominal, &eye, frame);
            smooth_part_removed(&residuals)
        })
        .collect();
    Ok(median_variance(groups).map(f64::sqrt))
}

/// Sum of squares of a residual field after the eight columns of a homography are fitted to it, and its degrees of
/// freedom.
fn smooth_part_removed(residuals: &[(Vector2<f64>, Vector2<f64>)]) -> Option<(f64, f64)> {
    let count = residuals.len();
    if count < 8 {
        return None;
    }
    let (center, size) = extent(residuals.iter().map(|r| r.0));
    let mut h = SMatrix::<f64, 8, 8>::zeros();
    let mut g = SVector::<f64, 8>::zeros();
    let mut total = 0.0;
    for (at, r) in residuals {
        let [u, v] = homography_rows((at - center) / size);
        h += u * u.transpose() + v * v.transpose();
        g += u * r.x + v * r.y;
        total += r.norm_squared();
    }
    let solution = h.cholesky()?.solve(&g);
    Some(((total - solution.dot(&g)).max(0.0), (2 * count - 8) as f64))
}

/// The noise at which a model's residuals would be as large as they are: never below the measurement's own.
///
/// While causes are missing, the residuals are far above the measurement's noise, and good observations must not
/// look false for that reason. The scale is a root mean square without the largest 2 %.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn effective(
    problem: &Problem,
    deformation: &Deformation,
    noise: Noise,
    mask: Option<&[bool]>,
) -> Result<Noise> {
    effective_from(problem, deformation, noise, None, mask)
}

/// As [`effective`], the mirrors starting from where they nearly are.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn effective_from(
    problem: &Problem,
    deformation: &Deformation,
    noise: Noise,
    planes: Option<&FootPoints>,
    mask: Option<&[bool]>,
) -> Result<Noise> {
    let eye = problem.eye(deformation)?;
    let planes = planes.map(Vec::as_slice);
    let task = Task { planes, ..Task::of_markers(problem, deformation, eye.as_ref(), noise) };
    let parts: Vec<(Vec<f64>, Vec<f64>, Vec<f64>)> = chunks(problem.frames.len())
        .into_par_iter()
        .map_init(
            || FrameWork::new(problem),
            |work, frames| {
                let (mut pixels, mut points, mut boards) = (Vec::new(), Vec::new(), Vec::new());
                for frame in frames.filter(|&f| counts(mask, f)) {
                    if work.evaluate(problem, &task, frame) {
                        work.raw_residuals(|_, measured, r| {
                            if measured {
                                points.push(r.norm_squared())
                            } else {
                                pixels.push(r.norm_squared())
                            }
                        });
                        let (square, corners) = work.board_square;
                        if 2 * corners > PROJECTED {
                            boards.push(square / (2 * corners - PROJECTED) as f64);
                        }
                    }
                }
                (pixels, points, boards)
            },
        )
        .collect();
    let (mut pixels, mut points, mut boards): (Vec<f64>, Vec<f64>, Vec<f64>) =
        (Vec::new(), Vec::new(), Vec::new());
    for (a, b, c) in parts {
        pixels.extend(a);
        points.extend(b);
        boards.extend(c);
    }
    // Corners that all lie this far away have no weight at all: they would not tell where they belong.
    let of_corners = trimmed_std(&mut boards, 1.0).filter(|scale| *scale > FAR_DEVIATIONS).unwrap_or(1.0);
    Ok(Noise {
        corner_px: of_corners * noise.corner_px,
        marker_px: trimmed_std(&mut pixels, 2.0).map_or(noise.marker_px, |s| s.max(noise.marker_px)),
        point_m: trimmed_std(&mut points, 3.0).map_or(noise.point_m, |s| s.max(noise.point_m)),
    })
}

/// Share of the largest residuals that is left out of an estimate of scale: twice the share of false observations
/// in most sessions. A larger share is reported, and examined again.
pub(crate) fn trimmed_share() -> f64 {
    2.0 * OUTLIER_FRACTION
}

fn trimmed_std(squares: &mut [f64], dimensions: f64) -> Option<f64> {
    if squares.is_empty() {
        return None;
    }
    squares.sort_by(f64::total_cmp);
    let kept = ((squares.len() as f64 * (1.0 - trimmed_share())).ceil() as usize).clamp(1, squares.len());
    Some((squares[..kept].iter().sum::<f64>() / kept as f64 / dimensions).sqrt())
}

/// Variance of the board corners' residuals at their own best planes over the noise's, minus 1: the share of the
/// optics.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn corner_excess(problem: &Problem, deformation: &Deformation, noise: Noise) -> Result<f64> {
    let Some(eye) = problem.eye(deformation)? else { return Ok(0.0) };
    let fresh = problem.needs_fresh_board(deformation);
    let groups: Vec<(f64, f64)> = (0..problem.frames.len())
        .into_par_iter()
        .map_init(
            || FrameWork::new(problem),
            |work, frame| {
                let nominal = problem.boards.get(frame).copied().flatten()?;
                let varies = Some(&eye).filter(|_| deformation.eye_varies());
                let own = varies.and_then(|eye| eye.in_frame(deformation, frame).ok());
                let fit = if fresh {
                    let eye = own.as_ref().unwrap_or(&eye);
                    work.fit_board(problem, deformation, Some(eye), frame, Some(nominal.foot))?
                } else {
                    nominal
                };
                Some((fit.chi2_px2, 2.0 * fit.corners as f64 - 3.0))
            },
        )
        .flatten()
        .filter(|(_, freedom)| *freedom > LEAST_OF_A_BOARD)
        .collect();
    Ok(median_variance(groups).map_or(0.0, |v| v / noise.corner_px.powi(2) - 1.0))
}
