//! Rotation vectors: exponential, logarithm and their derivatives, safe at zero; and the project's pose tangent.
//!
//! # The pose tangent
//! A pose `a_from_b` is moved by a tangent `δ = (ω, v)` (rotation first, rad and m) as
//! `a_from_b ∘ (Exp ω, v)`: first in b's own frame rotate by the rotation vector ω and shift by v. Rotation and
//! translation are not coupled (it is SO(3)×ℝ³, not the screw of SE(3)): this is the convention of
//! `camera_mount` in the vocabulary of causes. Covariances of poses are 6×6 in this tangent.

use nalgebra::{Isometry3, Matrix3, Translation3, UnitQuaternion, Vector3, Vector6};

/// Below this angle (rad) series replace the closed forms; their error there is below 1e-16.
const SMALL_ANGLE: f64 = 1e-4;

/// The matrix of the cross product: `hat(a) b = a × b`.
pub fn hat(a: &Vector3<f64>) -> Matrix3<f64> {
    a.cross_matrix()
}

/// `Exp`: the rotation by |ω| (rad) about ω/|ω|.
pub fn exp(omega: &Vector3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_scaled_axis(*omega)
}

/// `Log`: the rotation vector (rad) of a rotation, |ω| ≤ π.
pub fn log(rotation: &UnitQuaternion<f64>) -> Vector3<f64> {
    rotation.scaled_axis()
}

/// The rotation nearest to a matrix M (in the sum of squares), which maximises `tr(Rᵀ M)`: `M = U S Vᵀ`, `R = U diag(1, 1, det U det V) Vᵀ`.
///
/// Of `M = Σ b aᵀ` it is the rotation that brings the vectors a closest to b. None where M has no singular values (it is not finite).
///
/// # Source
/// G. Wahba, "A least squares estimate of satellite attitude", SIAM Review 7, 1965; S. Umeyama, IEEE PAMI 13, 1991.
pub fn nearest(matrix: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let svd = matrix.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let sign = (u * v_t).determinant().signum();
    Some(u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t)
}

/// The right Jacobian of SO(3): `Exp(ω + δ) ≈ Exp(ω) Exp(J_r(ω) δ)`,
/// `J_r = I − (1 − cos θ)/θ² ω̂ + (θ − sin θ)/θ³ ω̂²`.
pub fn right_jacobian(omega: &Vector3<f64>) -> Matrix3<f64> {
    let theta2 = omega.norm_squared();
    let theta = theta2.sqrt();
    let (a, b) = if theta < SMALL_ANGLE {
        (0.5 - theta2 / 24.0, 1.0 / 6.0 - theta2 / 120.0)
    } else {
        ((1.0 - theta.cos()) / theta2, (theta - theta.sin()) / (theta2 * theta))
    };
    let hat = hat(omega);
    Matrix3::identity() - hat * a + hat * hat * b
}

/// The inverse of [`right_jacobian`]: `I + ω̂/2 + (1/θ² − (1 + cos θ)/(2 θ sin θ)) ω̂²`, |ω| < π.
pub fn right_jacobian_inverse(omega: &Vector3<f64>) -> Matrix3<f64> {
    let theta2 = omega.norm_squared();
    let theta = theta2.sqrt();
    let b = if theta < SMALL_ANGLE {
        1.0 / 12.0 + theta2 / 720.0
    } else {
        1.0 / theta2 - (1.0 + theta.cos()) / (2.0 * theta * theta.sin())
    };
    let hat = hat(omega);
    Matrix3::identity() + hat * 0.5 + hat * hat * b
}

/// Moves a pose by a tangent `(ω, v)` (rad, m): `a_from_b ∘ (Exp ω, v)`.
pub fn moved(a_from_b: &Isometry3<f64>, tangent: &Vector6<f64>) -> Isometry3<f64> {
    let omega = tangent.fixed_rows::<3>(0).into_owned();
    let v = tangent.fixed_rows::<3>(3).into_owned();
    a_from_b * Isometry3::from_parts(Translation3::from(v), exp(&omega))
}

/// The tangent `(ω, v)` that moves one pose onto another: the inverse of [`moved`].
pub fn difference(to: &Isometry3<f64>, from: &Isometry3<f64>) -> Vector6<f64> {
    let step = from.inverse() * to;
    let omega = log(&step.rotation);
    let v = step.translation.vector;
    Vector6::new(omega.x, omega.y, omega.z, v.x, v.y, v.z)
}
