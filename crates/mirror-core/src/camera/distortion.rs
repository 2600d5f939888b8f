//! Lens distortion: ROS's `plumb_bob`, `rational_polynomial` and `equidistant`, in OpenCV's order of coefficients.

use super::distorted::{COEFFICIENTS, Distorted};
use super::equidistant;
use crate::error::{Result, finite};
use nalgebra::{Matrix2, SMatrix, Vector2};

/// The lens models. Coefficients are unitless, on normalised image coordinates `(X/Z, Y/Z)`.
///
/// With `ρ² = x² + y²` and the radial factor
/// `c = (1 + k1 ρ² + k2 ρ⁴ + k3 ρ⁶) / (1 + k4 ρ² + k5 ρ⁴ + k6 ρ⁶)`:
///
/// `x_d = x c + 2 p1 x y + p2 (ρ² + 2 x²)`, `y_d = y c + p1 (ρ² + 2 y²) + 2 p2 x y`.
///
/// Source: Brown, "Decentering distortion of lenses" (1966); the form is OpenCV's and ROS `camera_info`'s.
///
/// Fisheye lenses: `θ = atan ρ`, `(x_d, y_d) = (x, y) θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸) / ρ`. Source: Kannala and Brandt, "A generic camera
/// model and calibration method" (2006); the form is OpenCV's `fisheye` and ROS's and Kalibr's `equidistant`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Distortion {
    /// An ideal pinhole.
    None,
    /// `k1 k2 p1 p2 k3`.
    PlumbBob([f64; 5]),
    /// `k1 k2 p1 p2 k3 k4 k5 k6`.
    RationalPolynomial([f64; 8]),
    /// Fisheye: `k1 k2 k3 k4`, for points before the camera.
    Equidistant([f64; 4]),
}

impl Distortion {
    /// The coefficients in their model's order (`k1 k2 p1 p2 k3 k4 k5 k6`, of a fisheye `k1 k2 k3 k4`), zeros where the model has none.
    pub fn coefficients(&self) -> [f64; COEFFICIENTS] {
        match self {
            Self::None => [0.0; COEFFICIENTS],
            Self::PlumbBob(c) => [c[0], c[1], c[2], c[3], c[4], 0.0, 0.0, 0.0],
            Self::RationalPolynomial(c) => *c,
            Self::Equidistant(c) => [c[0], c[1], c[2], c[3], 0.0, 0.0, 0.0, 0.0],
        }
    }

    /// The same lens with its first radial coefficient changed.
    pub(crate) fn with_k1_changed(&self, by: f64) -> Self {
        let mut k = self.coefficients();
        k[0] += by;
        match self {
            Self::None | Self::PlumbBob(_) => Self::PlumbBob([k[0], k[1], k[2], k[3], k[4]]),
            Self::RationalPolynomial(_) => Self::RationalPolynomial(k),
            Self::Equidistant(_) => Self::Equidistant([k[0], k[1], k[2], k[3]]),
        }
    }

    pub(crate) fn validated(self) -> Result<Self> {
        let names: &[&str] = match self {
            Self::Equidistant(_) => &["k1", "k2", "k3", "k4"],
            _ => &["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"],
        };
        for (name, value) in names.iter().zip(self.coefficients()) {
            finite(&format!("distortion coefficient {name}"), value)?;
        }
        Ok(self)
    }
}

/// A lens in the form of the inner loops.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Lens {
    k: [f64; COEFFICIENTS],
    fisheye: bool,
    /// The square of the largest `ρ` at which points are projected: beyond it two rays share a pixel.
    pub one_to_one_limit: f64,
}

impl Lens {
    pub fn new(distortion: &Distortion) -> Self {
        let k = distortion.coefficients();
        let fisheye = matches!(distortion, Distortion::Equidistant(_));
        let one_to_one_limit = if fisheye { equidistant::one_to_one_limit(&k) } else { one_to_one_limit(&k) };
        Self { k, fisheye, one_to_one_limit }
    }

    /// The distorted point alone.
    #[inline]
    pub fn distort(&self, p: &Vector2<f64>) -> Vector2<f64> {
        if self.fisheye { equidistant::distort(&self.k, p) } else { distort(&self.k, p) }
    }

    /// The distorted point with `∂/∂(x, y)`.
    #[inline]
    pub fn distort_with_point_jacobian(&self, p: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        if self.fisheye {
            equidistant::distort_with_point_jacobian(&self.k, p)
        } else {
            distort_with_point_jacobian(&self.k, p)
        }
    }

    /// The distorted point with all its derivatives.
    pub fn distort_with_jacobians(&self, p: &Vector2<f64>) -> Distorted {
        if self.fisheye {
            equidistant::distort_with_jacobians(&self.k, p)
        } else {
            distort_with_jacobians(&self.k, p)
        }
    }

    /// A start for the inverse that saves a step: the target divided by the radial factor there; of a fisheye nearly the inverse itself.
    #[inline]
    pub fn near_undistorted(&self, target: &Vector2<f64>) -> Vector2<f64> {
        if self.fisheye {
            return equidistant::undistorted(&self.k, target, self.one_to_one_limit);
        }
        let k = &self.k;
        let s = target.norm_squared();
        let divided = target
            * ((1.0 + s * (k[5] + s * (k[6] + s * k[7]))) / (1.0 + s * (k[0] + s * (k[1] + s * k[4]))));
        let inside = divided.norm_squared() <= self.one_to_one_limit && divided.dot(target) > 0.0;
        if inside {
            return divided;
        }
        // Newton's steps begin inside the one-to-one region, since they stay there.
        if s <= self.one_to_one_limit { *target } else { target * (self.one_to_one_limit / s).sqrt() }
    }
}

/// The distorted point alone.
#[inline]
fn distort(k: &[f64; COEFFICIENTS], p: &Vector2<f64>) -> Vector2<f64> {
    let (x, y) = (p.x, p.y);
    let s = x * x + y * y;
    let c = (1.0 + s * (k[0] + s * (k[1] + s * k[4]))) / (1.0 + s * (k[5] + s * (k[6] + s * k[7])));
    let xy2 = 2.0 * x * y;
    Vector2::new(x * c + k[2] * xy2 + k[3] * (s + 2.0 * x * x), y * c + k[2] * (s + 2.0 * y * y) + k[3] * xy2)
}

/// The distorted point with `∂/∂(x, y)`: the inner loop of the inverse.
#[inline]
fn distort_with_point_jacobian(k: &[f64; COEFFICIENTS], p: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
    let (x, y) = (p.x, p.y);
    let s = x * x + y * y;
    let numerator = 1.0 + s * (k[0] + s * (k[1] + s * k[4]));
    let denominator = 1.0 + s * (k[5] + s * (k[6] + s * k[7]));
    let c = numerator / denominator;
    // dc/ds, s = ρ².
    let dc = ((k[0] + s * (2.0 * k[1] + s * 3.0 * k[4])) - c * (k[5] + s * (2.0 * k[6] + s * 3.0 * k[7])))
        / denominator;
    let (p1, p2) = (k[2], k[3]);
    let point = Vector2::new(
        x * c + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x),
        y * c + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y,
    );
    let cross = 2.0 * x * y * dc + 2.0 * p1 * x + 2.0 * p2 * y;
    let by_point = Matrix2::new(
        c + 2.0 * x * x * dc + 2.0 * p1 * y + 6.0 * p2 * x,
        cross,
        cross,
        c + 2.0 * y * y * dc + 6.0 * p1 * y + 2.0 * p2 * x,
    );
    (point, by_point)
}

/// The distorted point with all its derivatives.
fn distort_with_jacobians(k: &[f64; COEFFICIENTS], p: &Vector2<f64>) -> Distorted {
    let (point, by_point) = distort_with_point_jacobian(k, p);
    let (x, y) = (p.x, p.y);
    let s = x * x + y * y;
    let numerator = 1.0 + s * (k[0] + s * (k[1] + s * k[4]));
    let denominator = 1.0 + s * (k[5] + s * (k[6] + s * k[7]));
    let up = 1.0 / denominator;
    let down = -numerator / (denominator * denominator);
    let factors = [s * up, s * s * up, 0.0, 0.0, s * s * s * up, s * down, s * s * down, s * s * s * down];
    let mut by_coefficients = SMatrix::<f64, 2, COEFFICIENTS>::zeros();
    for (column, factor) in factors.iter().enumerate() {
        by_coefficients[(0, column)] = x * factor;
        by_coefficients[(1, column)] = y * factor;
    }
    by_coefficients[(0, 2)] = 2.0 * x * y;
    by_coefficients[(1, 2)] = s + 2.0 * y * y;
    by_coefficients[(0, 3)] = s + 2.0 * x * x;
    by_coefficients[(1, 3)] = 2.0 * x * y;
    Distorted { point, by_point, by_coefficients }
}

/// How far out (tangent of the angle off axis) the search for a fold goes: 80° off axis.
const WIDEST_TANGENT: f64 = 5.67;
/// Steps of that search.
const FOLD_STEPS: usize = 1134;

/// The least determinant of the Jacobian at a distance ρ from the axis, over all directions.
///
/// In the directions along and across the radius the radial part is `diag(a, c)`, `a = d(ρ c)/dρ`, and the tangential part, with
/// `m = ρ |(p1, p2)|` and ψ the angle between the radius and `(p2, p1)`, is `m [[6 cos ψ, 2 sin ψ], [2 sin ψ, 2 cos ψ]]`. Hence
/// `det = 16 m² cos²ψ + 2 m (a + 3 c) cos ψ + a c − 4 m²`, least at `cos ψ = −(a + 3 c) / 16 m`, or at −1 where that lies below.
fn least_determinant(a: f64, c: f64, m: f64) -> f64 {
    let slope = a + 3.0 * c;
    if slope >= 16.0 * m { (a - 6.0 * m) * (c - 2.0 * m) } else { a * c - 4.0 * m * m - slope * slope / 16.0 }
}

/// The square of the largest `ρ` up to which the lens is one-to-one: beyond it two rays share a pixel.
///
/// The Jacobian is symmetric, so the distortion is a gradient; on a disc, which is convex, in which its determinant stays above 0 it is
/// positive definite, and no two points have the same image. Without tangential terms that is where the radial part `ρ c(ρ²)` ceases to rise.
fn one_to_one_limit(k: &[f64; COEFFICIENTS]) -> f64 {
    let tangential = k[2].hypot(k[3]);
    let step = WIDEST_TANGENT / FOLD_STEPS as f64;
    for i in 1..=FOLD_STEPS {
        let rho = i as f64 * step;
        let s = rho * rho;
        let numerator = 1.0 + s * (k[0] + s * (k[1] + s * k[4]));
        let denominator = 1.0 + s * (k[5] + s * (k[6] + s * k[7]));
        let dn = k[0] + s * (2.0 * k[1] + s * 3.0 * k[4]);
        let dd = k[5] + s * (2.0 * k[6] + s * 3.0 * k[7]);
        // d(ρ c)/dρ = c + 2 s dc/ds
        let rising = numerator * denominator + 2.0 * s * (dn * denominator - numerator * dd);
        let least = least_determinant(
            rising / (denominator * denominator),
            numerator / denominator,
            rho * tangential,
        );
        if denominator <= 0.0 || rising <= 0.0 || least <= 0.0 {
            let inside = rho - step;
            return inside * inside;
        }
    }
    // Farther out nothing is known, except of a lens without distortion.
    if k.iter().all(|k| *k == 0.0) { f64::INFINITY } else { WIDEST_TANGENT * WIDEST_TANGENT }
}
