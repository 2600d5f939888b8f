//! The unknown frame of measured points, and markers on unknown mounts, from points whose joints are known.

use crate::diagnose::model::pose::Pose;
use crate::diagnose::model::solver::SOLVER;
use crate::geometry::rotation::nearest;
use nalgebra::{Matrix3, Vector3};

/// A measured point of a frame, and where on its mount the model has the marker.
pub(super) struct PointSeen {
    pub frame: usize,
    pub marker: usize,
    pub position: Vector3<f64>,
    /// The mount in the robot's root.
    pub mount: Pose,
    pub local: Vector3<f64>,
}

/// The robot's root in the unknown frame of measured points, and the shifts of markers on unknown mounts.
#[derive(Clone)]
pub(super) struct Placed {
    pub pose: Pose,
    pub shifts: Vec<Vector3<f64>>,
}

impl Placed {
    /// A robust estimate: weights `1 / (1 + (r/s)²)` with s the size of usual errors, m. `known`: whether a marker's mount
    /// is known.
    pub fn by(points: &[PointSeen], known: &[bool], usual_m: f64) -> Self {
        let mut weights = vec![1.0; points.len()];
        let mut placed = Self { pose: Pose::identity(), shifts: vec![Vector3::zeros(); known.len()] };
        for _ in 0..SOLVER.rounds {
            let pairs = points.iter().zip(&weights).map(|(p, weight)| (p.position, placed.in_root(p), *weight));
            let pose = rigid(pairs);
            for (m, shift) in placed.shifts.iter_mut().enumerate().filter(|(m, _)| !known[*m]) {
                let (mut sum, mut total) = (Vector3::zeros(), 1e-12);
                for (p, weight) in points.iter().zip(&weights).filter(|(p, _)| p.marker == m) {
                    sum += (p.mount.inverse_point(&pose.inverse_point(&p.position)) - p.local) * *weight;
                    total += weight;
                }
                *shift = sum / total;
            }
            placed.pose = pose;
            for (p, weight) in points.iter().zip(&mut weights) {
                *weight = 1.0 / (1.0 + (placed.distance(p) / usual_m).powi(2));
            }
        }
        placed
    }

    /// Where the marker of a point is in the robot's root.
    pub fn in_root(&self, p: &PointSeen) -> Vector3<f64> {
        p.mount.point(&(p.local + self.shifts[p.marker]))
    }

    /// A point as measured, less where it is predicted.
    pub fn residual(&self, p: &PointSeen) -> Vector3<f64> {
        p.position - self.pose.point(&self.in_root(p))
    }

    pub fn distance(&self, p: &PointSeen) -> f64 {
        self.residual(p).norm()
    }
}

/// The weighted rigid transform that takes the second points to the first (Umeyama 1991, without scale).
fn rigid(pairs: impl Iterator<Item = (Vector3<f64>, Vector3<f64>, f64)> + Clone) -> Pose {
    let (mut a, mut b, mut total) = (Vector3::zeros(), Vector3::zeros(), 1e-12);
    for (to, from, weight) in pairs.clone() {
        a += to * weight;
        b += from * weight;
        total += weight;
    }
    a /= total;
    b /= total;
    let mut covariance = Matrix3::zeros();
    for (to, from, weight) in pairs {
        covariance += (to - a) * (from - b).transpose() * weight;
    }
    let r = nearest(&covariance).unwrap_or_else(Matrix3::identity);
    Pose { r, t: a - r * b }
}
