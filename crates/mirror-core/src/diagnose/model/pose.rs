//! A rigid transform as matrix and vector: an inexpensive form for the inner loops of the diagnosis.

use nalgebra::{Isometry3, Matrix3, Vector3};

/// `a_from_b` as `x ↦ R x + t`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pose {
    pub r: Matrix3<f64>,
    pub t: Vector3<f64>,
}

impl Pose {
    pub fn identity() -> Self {
        Self { r: Matrix3::identity(), t: Vector3::zeros() }
    }

    #[inline]
    pub fn then(&self, b_from_c: &Self) -> Self {
        Self { r: self.r * b_from_c.r, t: self.r * b_from_c.t + self.t }
    }

    #[inline]
    pub fn point(&self, p: &Vector3<f64>) -> Vector3<f64> {
        self.r * p + self.t
    }

    #[inline]
    pub fn inverse_point(&self, p: &Vector3<f64>) -> Vector3<f64> {
        self.r.tr_mul(&(p - self.t))
    }

    pub fn inverse(&self) -> Self {
        let r = self.r.transpose();
        Self { r, t: -(r * self.t) }
    }
}

impl From<&Isometry3<f64>> for Pose {
    fn from(pose: &Isometry3<f64>) -> Self {
        Self { r: pose.rotation.to_rotation_matrix().into_inner(), t: pose.translation.vector }
    }
}

/// Rotation by `angle` (rad) about a unit axis (Rodrigues).
#[inline]
pub(crate) fn rotation_about(axis: &Vector3<f64>, angle: f64) -> Matrix3<f64> {
    let (s, c) = angle.sin_cos();
    let v = 1.0 - c;
    let (x, y, z) = (axis.x, axis.y, axis.z);
    Matrix3::new(
        c + x * x * v,
        x * y * v - z * s,
        x * z * v + y * s,
        y * x * v + z * s,
        c + y * y * v,
        y * z * v - x * s,
        z * x * v - y * s,
        z * y * v + x * s,
        c + z * z * v,
    )
}

/// The rotation vector w (rad) with `exp(r + h d) = exp(r) exp(h w)` to first order in h:
/// `w = d − (1 − cos φ)/φ² r × d + (φ − sin φ)/φ³ r × (r × d)`, `φ = |r|`.
pub(crate) fn after_turn(r: &Vector3<f64>, d: &Vector3<f64>) -> Vector3<f64> {
    let angle = r.norm();
    let once = r.cross(d);
    if angle < 1e-4 {
        // The next term is below 1e-8 here.
        return d - once * 0.5;
    }
    let (s, c) = angle.sin_cos();
    d - once * ((1.0 - c) / angle.powi(2)) + r.cross(&once) * ((angle - s) / angle.powi(3))
}

/// `Exp` of a rotation vector (rad).
#[inline]
pub(crate) fn exp(omega: &Vector3<f64>) -> Matrix3<f64> {
    let angle = omega.norm();
    if angle < 1e-12 {
        // First order is exact to 1e-24 here.
        return Matrix3::identity() + omega.cross_matrix();
    }
    rotation_about(&(omega / angle), angle)
}
