//! Correlation of the measurement's noise between neighbouring corners, and between successive frames.
//!
//! The fit treats observations as independent. Where they are correlated, a mean over many is less certain than the
//! fit says: by `√((1 + r)/(1 − r))` where successive errors correlate by r; over a board whose neighbours correlate
//! by r along rows and columns (`R_ij = r^(|Δx| + |Δy|)`) by `√(bᵀ R b / bᵀ b)` for a smooth change b of the
//! picture, such as a motion of the mirror.

use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::frame::{FrameWork, PROJECTED, Task};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::principles::{Guard, Size, Threshold};
use crate::error::Result;
use nalgebra::{DMatrix, DVector, Vector3};

/// Upper bound of a correlation: a slower error is not noise.
const MOST_CORRELATION: Guard = 0.6;
/// A correlation is accepted from this many of its standard deviations on.
const CLEAR_DEVIATIONS: Threshold = 2.0;
/// An error of the detector has faded after so many frames: by 0.6 each it is down to 0.017.
const SLOW: Size = 8;
/// Smooth functions of a corner's place that wrong optics may make, for each coordinate: 1, x, y, x², x y, y².
const SMOOTH: Size = 6;

/// The noise at which means over many observations are as uncertain as they are.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn of_means(problem: &Problem, deformation: &Deformation, noise: Noise) -> Result<Noise> {
    let successive = successive_correlation(problem, deformation, noise)?;
    let lingering = ((1.0 + successive) / (1.0 - successive)).sqrt();
    Ok(Noise {
        corner_px: noise.corner_px * corners_together(problem)?,
        marker_px: noise.marker_px * lingering,
        point_m: noise.point_m * lingering,
    })
}

/// By how much a smooth change of the board's picture is less certain than independent corners would make it; 1 where
/// neighbours do not correlate.
fn corners_together(problem: &Problem) -> Result<f64> {
    let nominal = problem.nominal();
    let (Some(eye), Some(grid)) = (problem.eye(&nominal)?, grid(&problem.corners)) else { return Ok(1.0) };
    let smooth = &grid.smooth;
    let mut work = FrameWork::new(problem);
    let (mut product, mut squares, mut frames) = (0.0, 0.0, 0.0);
    for (frame, data) in problem.frames.iter().enumerate() {
        let residuals = work.board_residuals(problem, &nominal, &eye, frame);
        if residuals.len() != problem.corners.len() || data.corners.len() != residuals.len() {
            continue;
        }
        frames += 1.0;
        for axis in 0..2 {
            let mut r = DVector::zeros(residuals.len());
            for ((index, _), (_, residual)) in data.corners.iter().zip(&residuals) {
                r[*index] = residual[axis];
            }
            let left = &r - smooth * (smooth.transpose() * &r);
            squares += left.norm_squared();
            product += grid.neighbours.iter().map(|&(i, j)| left[i] * left[j]).sum::<f64>();
        }
    }
    if squares <= 0.0 {
        return Ok(1.0);
    }
    let seen = product / squares;
    let scatter = (2.0 * frames * grid.neighbours.len() as f64).sqrt().recip()
        * (grid.neighbours.len() as f64 / problem.corners.len() as f64);
    // The smooth part that was removed contained more of the correlated noise than of white noise, so the observed
    // correlation is compared with what each true correlation would leave.
    let none = grid.left_of(0.0);
    if seen < none.ratio() + CLEAR_DEVIATIONS * scatter {
        return Ok(1.0);
    }
    // The ratio rises with the correlation: bisection until the interval is smaller than the scatter of the
    // observed value.
    let (mut low, mut high) = (0.0, MOST_CORRELATION);
    let (mut below, mut found) = (none.ratio(), grid.left_of(high));
    while found.ratio() > seen && found.ratio() - below > scatter {
        let middle = 0.5 * (low + high);
        let left = grid.left_of(middle);
        if left.ratio() < seen {
            (low, below) = (middle, left.ratio());
        } else {
            (high, found) = (middle, left);
        }
    }
    Ok((found.by_mirror / (found.squares / none.squares)).sqrt().max(1.0))
}

/// The board's corners as a grid.
struct Grid {
    steps: Vec<(f64, f64)>,
    neighbours: Vec<(usize, usize)>,
    /// Orthonormal columns, the mirror's first.
    smooth: DMatrix<f64>,
}

/// Expectations over a board of noise of variance 1, the smooth part taken away.
struct Left {
    product: f64,
    squares: f64,
    /// Variance of a smooth change by the mirror's motion, over that of white noise.
    by_mirror: f64,
}

impl Left {
    fn ratio(&self) -> f64 {
        self.product / self.squares
    }
}

fn grid(corners: &[Vector3<f64>]) -> Option<Grid> {
    // If smooth functions remove more than half of the degrees of freedom, too little is left to estimate a
    // correlation.
    if corners.len() < 2 * SMOOTH {
        return None;
    }
    let edge = corners.iter().skip(1).map(|c| (c - corners[0]).norm()).fold(f64::INFINITY, f64::min);
    let steps: Vec<(f64, f64)> = corners.iter().map(|c| (c.x / edge, c.y / edge)).collect();
    let apart = |i: usize, j: usize| (steps[i].0 - steps[j].0).abs() + (steps[i].1 - steps[j].1).abs();
    let count = steps.len();
    let neighbours = (0..count)
        .flat_map(|i| (i + 1..count).map(move |j| (i, j)))
        .filter(|&(i, j)| (apart(i, j) - 1.0).abs() < 0.1)
        .collect();
    let raw = DMatrix::from_fn(count, SMOOTH, |i, k| {
        let (x, y) = steps[i];
        [1.0, x, y, x * x, x * y, y * y][k]
    });
    let smooth = raw.qr().q();
    Some(Grid { steps, neighbours, smooth })
}

impl Grid {
    fn left_of(&self, correlation: f64) -> Left {
        let count = self.steps.len();
        let r = DMatrix::from_fn(count, count, |i, j| {
            let (a, b) = (self.steps[i], self.steps[j]);
            let apart = (a.0 - b.0).abs() + (a.1 - b.1).abs();
            if apart < 0.5 { 1.0 } else { correlation.powf(apart) }
        });
        let q = DMatrix::identity(count, count) - &self.smooth * self.smooth.transpose();
        let left = &q * &r * &q;
        // The first ones are the changes by the mirror's motion.
        let mirror = self.smooth.columns(0, PROJECTED);
        Left {
            product: self.neighbours.iter().map(|&(i, j)| left[(i, j)]).sum(),
            squares: left.trace(),
            by_mirror: (mirror.transpose() * &r * mirror).trace() / PROJECTED as f64,
        }
    }
}

/// Factor for the noise that the views of one posture show, so that the uncertainty of a posture is right: n
/// successive errors that correlate by r at a distance of one differ by `σ² (1 − r̄)` and have a mean of variance
/// `σ² (1 + (n − 1) r̄) / n`, r̄ the mean of `r^|i − j|` over their pairs. 1 where errors are uncorrelated, or
/// postures have one view.
///
/// Only correlation that decays within a few frames counts: an error that is the same [`SLOW`] frames later is one
/// of the body, or of the camera's mount.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn widening_of_views(problem: &Problem, deformation: &Deformation, noise: Noise) -> Result<f64> {
    let postures = 1 + problem.posture.windows(2).filter(|p| p[0] != p[1]).count();
    let views = problem.frames.len() as f64 / postures as f64;
    // Nothing is shared by one view.
    if problem.camera.is_none() || shared_by_views(MOST_CORRELATION, views) <= 0.0 {
        return Ok(1.0);
    }
    let successive = successive_correlation(problem, deformation, noise)?;
    if successive <= 0.0 {
        return Ok(1.0);
    }
    let slow = correlation_after(problem, deformation, noise, SLOW)?;
    let fading = ((successive - slow) / (1.0 - slow)).max(0.0);
    let shared = shared_by_views(fading, views);
    Ok(((1.0 + (views - 1.0).max(0.0) * shared) / (1.0 - shared)).sqrt())
}

/// Correlation of a marker's residuals in successive frames of different postures: of a detection error that
/// persists, not of an error of the body, which the next posture changes. 0 where it is not significant.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn successive_correlation(
    problem: &Problem,
    deformation: &Deformation,
    noise: Noise,
) -> Result<f64> {
    correlation_after(problem, deformation, noise, 1)
}

/// The same of frames that follow each other at a distance of `lag`.
fn correlation_after(problem: &Problem, deformation: &Deformation, noise: Noise, lag: usize) -> Result<f64> {
    let eye = problem.eye(deformation)?;
    let task = Task::of_residuals(problem, deformation, eye.as_ref(), noise);
    let mut work = FrameWork::new(problem);
    let markers = problem.marker_sites.len();
    let mut seen: Vec<Option<Vector3<f64>>> = vec![None; markers * lag];
    let (mut product, mut squares, mut count) = (0.0, 0.0, 0.0);
    for frame in 0..problem.frames.len() {
        let mut now = vec![None; markers];
        if work.evaluate(problem, &task, frame) {
            work.raw_residuals(|marker, _, r| {
                if let Some(m) = marker {
                    now[m] = Some(r);
                }
            });
        }
        // The row of the frame `lag` frames before is the one that this frame takes.
        let row = &mut seen[markers * (frame % lag)..][..markers];
        if frame >= lag && problem.posture[frame] != problem.posture[frame - lag] {
            for (a, b) in row.iter().zip(&now).filter_map(|(a, b)| a.zip(*b)) {
                product += a.dot(&b);
                squares += 0.5 * (a.norm_squared() + b.norm_squared());
                count += 2.0;
            }
        }
        row.clone_from_slice(&now);
    }
    let correlation = if squares > 0.0 { product / squares } else { 0.0 };
    let clear = correlation > CLEAR_DEVIATIONS / f64::max(count, 1.0).sqrt();
    Ok(if clear { correlation.min(MOST_CORRELATION) } else { 0.0 })
}

/// Mean correlation between two of n successive errors whose neighbours correlate by r: r^|i − j|.
pub(crate) fn shared_by_views(correlation: f64, views: f64) -> f64 {
    let n = views.round().max(1.0) as i32;
    let pairs: f64 = (1..n).map(|lag| f64::from(n - lag)).sum();
    let sum: f64 = (1..n).map(|lag| f64::from(n - lag) * correlation.powi(lag)).sum();
    if pairs > 0.0 { sum / pairs } else { 0.0 }
}
