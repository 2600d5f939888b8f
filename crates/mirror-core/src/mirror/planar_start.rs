//! Closed-form pose of a plane from its picture: homography, then both poses that share its first-order behaviour.

use super::board::SeenCorner;
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::geometry::rotation::hat;
use nalgebra::{Isometry3, Matrix2, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};

/// Below this share of its own scale, the 2×2 system of the homography's perspective row is singular.
const PERSPECTIVE_RATIO: f64 = 1e-12;

/// A homography's value and Jacobian at the centroid of the board's points, in undistorted normalised coordinates.
struct AtCentroid {
    centroid: Vector2<f64>,
    value: Vector2<f64>,
    jacobian: Matrix2<f64>,
}

/// Sums of one image coordinate u against the board's points x: what the closed form needs.
#[derive(Default, Clone, Copy)]
struct Moments {
    u: f64,
    ux: Vector2<f64>,
    uu: f64,
    uux: Vector2<f64>,
    uxx: Matrix2<f64>,
    uuxx: Matrix2<f64>,
}

impl Moments {
    #[inline]
    fn add(&mut self, u: f64, x: &Vector2<f64>, xx: &Matrix2<f64>) {
        self.u += u;
        self.uu += u * u;
        self.ux += x * u;
        self.uux += x * (u * u);
        self.uxx += xx * u;
        self.uuxx += xx * (u * u);
    }
}

/// The homography `u = (A x + a) / (1 + g·x)` by linear least squares.
///
/// With the board's points centred the last row's constant is the depth of the centroid, which is never zero: the
/// denominator can be scaled to 1 there. `A` and `a` are eliminated, which leaves a 2×2 system for g. Both sides
/// are centred and scaled (Hartley 1997).
fn homography(camera: &Camera, corners: &[SeenCorner]) -> Result<AtCentroid> {
    let count = corners.len() as f64;
    let centroid = corners.iter().fold(Vector2::zeros(), |sum, c| sum + c.point_in_board.coords) / count;
    let mut spread = Matrix2::zeros();
    for corner in corners {
        let x = corner.point_in_board.coords - centroid;
        spread += x * x.transpose();
    }
    let board_scale = (2.0 * count / spread.trace()).sqrt();
    let spread = spread * (board_scale * board_scale);
    let undetermined = Error::Undetermined { what: "homography of the board" };
    let spread_inverse = spread.try_inverse().ok_or(undetermined.clone())?;

    // Coordinates relative to the first corner keep the sums well conditioned in a single pass.
    let ray = camera.unproject(&corners[0].pixel)?;
    let reference = Vector2::new(ray.x / ray.z, ray.y / ray.z);
    let mut moments = [Moments::default(); 2];
    for corner in corners {
        let ray = camera.unproject(&corner.pixel)?;
        let u = Vector2::new(ray.x / ray.z, ray.y / ray.z) - reference;
        let x = (corner.point_in_board.coords - centroid) * board_scale;
        let xx = x * x.transpose();
        moments[0].add(u.x, &x, &xx);
        moments[1].add(u.y, &x, &xx);
    }
    // Centring the image, u → u − ū, in the sums: the points' first moment is zero.
    let mut system = Matrix2::zeros();
    let mut right = Vector2::zeros();
    let mut centred = [(0.0, Moments::default()); 2];
    for (out, m) in centred.iter_mut().zip(&moments) {
        let mean = m.u / count;
        let c = Moments {
            u: 0.0,
            ux: m.ux,
            uu: m.uu - count * mean * mean,
            uux: m.uux - m.ux * (2.0 * mean),
            uxx: m.uxx - spread * mean,
            uuxx: m.uuxx - m.uxx * (2.0 * mean) + spread * (mean * mean),
        };
        system += c.uuxx - c.uxx * spread_inverse * c.uxx - c.ux * c.ux.transpose() / count;
        right -= c.uux - c.uxx * (spread_inverse * c.ux);
        *out = (mean, c);
    }
    let scale = centred[0].1.uu + centred[1].1.uu;
    if !(system.determinant() > (PERSPECTIVE_RATIO * scale).powi(2)) {
        return Err(undetermined);
    }
    let g = system.try_inverse().ok_or(undetermined)? * right;
    let row = |i: usize| {
        let (mean, m) = &centred[i];
        let linear = spread_inverse * (m.ux + m.uxx * g);
        let constant = m.ux.dot(&g) / count;
        (mean + constant, linear - g * constant)
    };
    let ((u, du), (v, dv)) = (row(0), row(1));
    Ok(AtCentroid {
        centroid,
        value: reference + Vector2::new(u, v),
        jacobian: Matrix2::new(du.x, du.y, dv.x, dv.y) * board_scale,
    })
}

/// The two poses of a plane whose picture has a given value v and Jacobian J at its centroid
/// (infinitesimal plane-based pose estimation, Collins and Bartoli 2014).
///
/// With `R_v` the rotation that turns the optical axis onto the ray of v, `[I | −v] R_v = [B | 0]` and
/// `B⁻¹ J = (1/t_z) R̃₂₂`, the leading block of a rotation, whose larger singular value is 1. The two signs of the
/// third row's leading part are the two poses. Exactly face-on that part is zero and the poses coincide.
pub(crate) fn closed_form_poses(camera: &Camera, corners: &[SeenCorner]) -> Result<[Isometry3<f64>; 2]> {
    let at = homography(camera, corners)?;
    let v = at.value;
    let undetermined = Error::Undetermined { what: "pose of the board" };
    let towards = Vector3::new(v.x, v.y, 1.0);
    let unit = towards.normalize();
    let k = hat(&Vector3::z().cross(&unit));
    let turn = Matrix3::identity() + k + k * k / (1.0 + unit.z);
    let b = Matrix2::new(
        turn[(0, 0)] - v.x * turn[(2, 0)],
        turn[(0, 1)] - v.x * turn[(2, 1)],
        turn[(1, 0)] - v.y * turn[(2, 0)],
        turn[(1, 1)] - v.y * turn[(2, 1)],
    );
    let a = b.try_inverse().ok_or(undetermined.clone())? * at.jacobian;
    let gram = a.transpose() * a;
    let half_trace = gram.trace() / 2.0;
    // Larger eigenvalue of AᵀA: the squared larger singular value of A.
    let discriminant = ((gram[(0, 0)] - gram[(1, 1)]) / 2.0).hypot(gram[(0, 1)]);
    let inverse_depth = (half_trace + discriminant).sqrt();
    if !(inverse_depth.is_finite() && inverse_depth > 0.0) {
        return Err(undetermined);
    }
    let block = a / inverse_depth;
    let rest = Matrix2::identity() - block.transpose() * block;
    // rest = c cᵀ, up to rounding: the squares may come out below zero face-on.
    let (x, y) = (rest[(0, 0)].max(0.0).sqrt(), rest[(1, 1)].max(0.0).sqrt());
    let third = Vector2::new(x, if rest[(0, 1)] < 0.0 { -y } else { y });
    let translation = towards / inverse_depth;
    Ok([1.0, -1.0].map(|sign| {
        let first = Vector3::new(block[(0, 0)], block[(1, 0)], sign * third.x);
        let second = Vector3::new(block[(0, 1)], block[(1, 1)], sign * third.y);
        // Orthonormal but for noise: Gram–Schmidt in a symmetric way.
        let sum = (first.normalize() + second.normalize()).normalize();
        let difference = (first.normalize() - second.normalize()).normalize();
        let first = (sum + difference) * std::f64::consts::FRAC_1_SQRT_2;
        let second = (sum - difference) * std::f64::consts::FRAC_1_SQRT_2;
        let tilted = Matrix3::from_columns(&[first, second, first.cross(&second)]);
        let rotation = Rotation3::from_matrix_unchecked(turn * tilted);
        let centre = Vector3::new(at.centroid.x, at.centroid.y, 0.0);
        let shift = Translation3::from(translation - rotation * centre);
        Isometry3::from_parts(shift, UnitQuaternion::from_rotation_matrix(&rotation))
    }))
}
