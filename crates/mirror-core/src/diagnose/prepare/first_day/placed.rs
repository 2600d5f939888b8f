//! The unknown frame of measured points, and markers on unknown mounts, from points whose joints are known.

use crate::diagnose::model::pose::{Pose, rotation_about};
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::Guard;
use crate::geometry::rotation::nearest;
use nalgebra::{Matrix3, Matrix3x6, Matrix6, Matrix6x3, Vector3, Vector6};

/// Damping of the pose, as a share of its normal matrix: some motions of pose and shift are the same.
const SHARED: Guard = 1e-6;

/// A measured point of a frame, and where on its mount the model has the marker.
#[derive(Clone)]
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
            let pairs =
                points.iter().zip(&weights).map(|(p, weight)| (p.position, placed.in_root(p), *weight));
            placed.pose = rigid(pairs);
            if known.iter().any(|known| !known)
                && let Some(next) = placed.with_shifts(points, &weights, known)
            {
                placed = next;
            }
            for (p, weight) in points.iter().zip(&mut weights) {
                *weight = 1.0 / (1.0 + (placed.distance(p) / usual_m).powi(2));
            }
        }
        placed
    }

    /// A Gauss–Newton step of pose and shifts together: in turn they would converge slowly, since a turn moves a marker as
    /// a shift does. The shifts are eliminated, as each observation has one, whose normal matrix is `Σ w` times the identity.
    fn with_shifts(&self, points: &[PointSeen], weights: &[f64], known: &[bool]) -> Option<Self> {
        let center = self.center(points.iter());
        let mut a = Matrix6::zeros();
        let mut b = Vector6::zeros();
        let mut of_markers = vec![(0.0, Vector3::zeros(), Matrix6x3::zeros()); known.len()];
        for (p, weight) in points.iter().zip(weights) {
            let r = self.residual(p);
            let (by_pose, by_shift) = self.jacobians(p, &center);
            a += by_pose.tr_mul(&by_pose) * *weight;
            b += by_pose.tr_mul(&r) * *weight;
            let (sum, of_shift, across) = &mut of_markers[p.marker];
            *sum += weight;
            *of_shift += by_shift.tr_mul(&r) * *weight;
            *across += by_pose.tr_mul(&by_shift) * *weight;
        }
        let free = || of_markers.iter().zip(known).filter(|(m, known)| !**known && m.0 > 0.0).map(|(m, _)| m);
        for i in 0..6 {
            a[(i, i)] *= 1.0 + SHARED;
        }
        for (sum, of_shift, across) in free() {
            a -= across * across.transpose() / *sum;
            b -= across * of_shift / *sum;
        }
        let x = a.cholesky()?.solve(&b);
        let mut next = self.turned(&x, &center);
        for (shift, (sum, of_shift, across)) in next
            .shifts
            .iter_mut()
            .zip(&of_markers)
            .zip(known)
            .filter(|(m, known)| !**known && m.1.0 > 0.0)
            .map(|(m, _)| m)
        {
            *shift += (of_shift - across.tr_mul(&x)) / *sum;
        }
        Some(next)
    }

    /// The mean of where points are predicted.
    pub fn center<'a>(&self, points: impl Iterator<Item = &'a PointSeen>) -> Vector3<f64> {
        let (mut sum, mut count) = (Vector3::zeros(), 0.0);
        for p in points {
            sum += self.pose.point(&self.in_root(p));
            count += 1.0;
        }
        sum / f64::max(count, 1.0)
    }

    /// How a prediction moves with the pose (turned about a centre, then shifted) and with its marker's shift.
    pub fn jacobians(&self, p: &PointSeen, center: &Vector3<f64>) -> (Matrix3x6<f64>, Matrix3<f64>) {
        let arm = self.pose.point(&self.in_root(p)) - center;
        let mut by_pose = Matrix3x6::zeros();
        by_pose.fixed_columns_mut::<3>(0).copy_from(&-arm.cross_matrix());
        by_pose.fixed_columns_mut::<3>(3).fill_with_identity();
        (by_pose, self.pose.r * p.mount.r)
    }

    /// With the pose turned about a centre and shifted.
    pub fn turned(&self, x: &Vector6<f64>, center: &Vector3<f64>) -> Self {
        let turn = Vector3::new(x[0], x[1], x[2]);
        let angle = turn.norm();
        let mut next = self.clone();
        if angle > 0.0 {
            let r = rotation_about(&(turn / angle), angle);
            next.pose.r = r * self.pose.r;
            next.pose.t = r * (self.pose.t - center) + center;
        }
        next.pose.t += Vector3::new(x[3], x[4], x[5]);
        next
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
