//! The scatter of edges around one outline.

use super::circle::Indices;
use super::ray_edge::{MIN_EDGE_POINTS, NORMAL_SPREAD};
use super::rays::Rays;
use crate::statistics::median;
use nalgebra::{Matrix3, Vector3};

/// Random triples of edges that are tried to begin with, and how far apart their directions must be (determinant).
const MEDIAN_TRIALS: usize = 60;
const LEAST_SPREAD: f64 = 0.05;

/// The noise that a codec adds to values, summed along a ray: the standard deviation, times px, that explains how
/// edges with their contrasts scatter around a shifted and scaled outline, by the median; it does not follow the
/// outline.
pub(super) fn noise_of(rays: &Rays<'_>, edges: impl Iterator<Item = (f64, f64, bool)>) -> f64 {
    let rows: Vec<(Vector3<f64>, f64, f64)> = edges
        .enumerate()
        .filter(|(_, (_, contrast, valid))| *valid && *contrast > 0.0)
        .map(|(ray, (offset, contrast, _))| {
            (Vector3::new(1.0, rays.direction[ray].x, rays.direction[ray].y), offset, contrast)
        })
        .collect();
    if rows.len() < MIN_EDGE_POINTS {
        return 1.0;
    }
    // Least median of squares (Rousseeuw 1984) to begin with: objects that touch the ball may hide a third of the
    // outline.
    let mut random = Indices::new(rows.len() as u64);
    let sizes_of = |copy: &Vector3<f64>| -> Vec<f64> {
        rows.iter().map(|(row, value, contrast)| (value - row.dot(copy)).abs() * contrast).collect()
    };
    let mut sizes = Vec::new();
    let mut least = f64::INFINITY;
    // More than half of the sizes must be below the least median so far: that is counted faster than a median is found.
    let half = rows.len() / 2;
    for _ in 0..MEDIAN_TRIALS {
        let [a, b, c] = core::array::from_fn(|_| &rows[random.next(rows.len())]);
        let matrix = Matrix3::from_rows(&[a.0.transpose(), b.0.transpose(), c.0.transpose()]);
        if !(matrix.determinant().abs() > LEAST_SPREAD) {
            continue;
        }
        let Some(inverse) = matrix.try_inverse() else { continue };
        let tried = sizes_of(&(inverse * Vector3::new(a.1, b.1, c.1)));
        if tried.iter().filter(|size| **size < least).count() <= half {
            continue;
        }
        let middle = median(tried.clone());
        if middle < least {
            (least, sizes) = (middle, tried);
        }
    }
    if sizes.is_empty() {
        return 1.0;
    }
    for _ in 0..3 {
        let scale = (3.0 * median(sizes.clone())).max(1e-3);
        let (mut normal, mut right) = (Matrix3::identity() * 1e-9, Vector3::zeros());
        for ((row, value, contrast), size) in rows.iter().zip(&sizes) {
            let weight = (contrast / (1.0 + (size / scale).powi(2))).powi(2);
            normal += row * row.transpose() * weight;
            right += row * (weight * value);
        }
        let Some(factor) = normal.cholesky() else { return 1.0 };
        sizes = sizes_of(&factor.solve(&right));
    }
    NORMAL_SPREAD * median(sizes)
}
