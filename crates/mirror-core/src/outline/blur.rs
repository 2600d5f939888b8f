//! The blur that a ball's edges show, in each direction: lens, focus, and motion while the shutter is open.

use super::ray_edge::{MIN_EDGE_POINTS, RayEdge};
use crate::statistics::median;
use nalgebra::{Matrix3, Vector3};

/// Range of a blur's variance, px².
const LEAST_VARIANCE_PX2: f64 = 0.1;
const MOST_VARIANCE_PX2: f64 = 25.0;
/// The variance may differ by direction from this share of its mean on: below, it is noise.
const TELLING_SHARE: f64 = 0.35;

/// Variance of a blur along a direction: `mean + even · (cos 2θ, sin 2θ)`, px².
#[derive(Debug, Clone, Copy)]
pub(super) struct Blur {
    mean: f64,
    even: [f64; 2],
}

impl Blur {
    /// The same in all directions.
    pub fn round(std_px: f64) -> Self {
        Self { mean: std_px * std_px, even: [0.0; 2] }
    }

    /// The same with its standard deviation times a share, at least `least_px`.
    pub fn scaled(&self, share: f64, least_px: f64) -> Self {
        let mean = (self.mean * share * share).max(least_px * least_px);
        Self { mean, even: self.even.map(|e| e * mean / self.mean) }
    }

    /// Standard deviation along a direction, px.
    pub fn along(&self, angle_rad: f64) -> f64 {
        let (sine, cosine) = (2.0 * angle_rad).sin_cos();
        (self.mean + self.even[0] * cosine + self.even[1] * sine)
            .clamp(LEAST_VARIANCE_PX2, MOST_VARIANCE_PX2)
            .sqrt()
    }

    /// Standard deviation in the direction where it is largest, px.
    pub fn widest_px(&self) -> f64 {
        (self.mean + self.even[0].hypot(self.even[1])).clamp(LEAST_VARIANCE_PX2, MOST_VARIANCE_PX2).sqrt()
    }

    /// Standard deviation in the direction where it is smallest, px.
    pub fn narrowest_px(&self) -> f64 {
        (self.mean - self.even[0].hypot(self.even[1])).clamp(LEAST_VARIANCE_PX2, MOST_VARIANCE_PX2).sqrt()
    }

    /// Standard deviation over all directions, px.
    pub fn mean_px(&self) -> f64 {
        self.mean.clamp(LEAST_VARIANCE_PX2, MOST_VARIANCE_PX2).sqrt()
    }
}

/// The blur that rays show together; the one before where too few do.
pub(super) fn blur_of_rays(edges: &[RayEdge], before: &Blur) -> Blur {
    let turn = core::f64::consts::TAU / edges.len() as f64;
    let rows: Vec<(Vector3<f64>, f64)> = edges
        .iter()
        .enumerate()
        .filter(|(_, edge)| edge.found && edge.moment.is_finite())
        .map(|(ray, edge)| {
            let (sine, cosine) = (2.0 * turn * ray as f64).sin_cos();
            (Vector3::new(1.0, cosine, sine), edge.moment)
        })
        .collect();
    if rows.len() < MIN_EDGE_POINTS {
        return *before;
    }
    let typical = median(rows.iter().map(|(_, m)| *m).collect());
    let round = Blur { mean: typical, even: [0.0; 2] };
    let mut weights = vec![1.0; rows.len()];
    let mut solution = Vector3::zeros();
    for _ in 0..6 {
        let (mut normal, mut right) = (Matrix3::identity() * 1e-6, Vector3::zeros());
        for ((row, value), weight) in rows.iter().zip(&weights) {
            normal += row * row.transpose() * *weight;
            right += row * (weight * value);
        }
        let Some(factor) = normal.cholesky() else { return round };
        solution = factor.solve(&right);
        // Least absolute deviations: what lies behind disturbs single rays.
        weights = rows.iter().map(|(row, value)| 1.0 / (value - solution.dot(row)).abs().max(0.05)).collect();
    }
    let swing = solution.y.hypot(solution.z);
    if !(swing > TELLING_SHARE * solution.x.max(LEAST_VARIANCE_PX2)) || rows.len() * 2 < edges.len() {
        return round;
    }
    Blur { mean: solution.x.max(swing), even: [solution.y, solution.z] }
}
