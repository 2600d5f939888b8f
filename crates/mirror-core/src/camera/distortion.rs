//! Lens distortion: ROS's `plumb_bob` and `rational_polynomial`, in OpenCV's order of coefficients.

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
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Distortion {
    /// An ideal pinhole.
    None,
    /// `k1 k2 p1 p2 k3`.
    PlumbBob([f64; 5]),
    /// `k1 k2 p1 p2 k3 k4 k5 k6`.
    RationalPolynomial([f64; 8]),
}

/// Number of coefficients of the richest model; poorer ones are padded with zeros.
pub(crate) const COEFFICIENTS: usize = 8;

/// A distorted point with its derivatives.
pub(crate) struct Distorted {
    pub point: Vector2<f64>,
    /// `∂(x_d, y_d)/∂(x, y)`.
    pub by_point: Matrix2<f64>,
    /// `∂(x_d, y_d)/∂(k1, k2, p1, p2, k3, k4, k5, k6)`.
    pub by_coefficients: SMatrix<f64, 2, COEFFICIENTS>,
}

impl Distortion {
    /// The coefficients in the order `k1 k2 p1 p2 k3 k4 k5 k6`, zeros where the model has none.
    pub fn coefficients(&self) -> [f64; COEFFICIENTS] {
        match self {
            Self::None => [0.0; COEFFICIENTS],
            Self::PlumbBob(c) => [c[0], c[1], c[2], c[3], c[4], 0.0, 0.0, 0.0],
            Self::RationalPolynomial(c) => *c,
        }
    }

    pub(crate) fn validated(self) -> Result<Self> {
        for (name, value) in ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"].iter().zip(self.coefficients())
        {
            finite(&format!("distortion coefficient {name}"), value)?;
        }
        Ok(self)
    }
}

/// The distorted point alone.
#[inline]
pub(crate) fn distort(k: &[f64; COEFFICIENTS], p: &Vector2<f64>) -> Vector2<f64> {
    let (x, y) = (p.x, p.y);
    let s = x * x + y * y;
    let c = (1.0 + s * (k[0] + s * (k[1] + s * k[4]))) / (1.0 + s * (k[5] + s * (k[6] + s * k[7])));
    let xy2 = 2.0 * x * y;
    Vector2::new(x * c + k[2] * xy2 + k[3] * (s + 2.0 * x * x), y * c + k[2] * (s + 2.0 * y * y) + k[3] * xy2)
}

/// The distorted point with `∂/∂(x, y)`: the inner loop of the inverse.
#[inline]
pub(crate) fn distort_with_point_jacobian(
    k: &[f64; COEFFICIENTS],
    p: &Vector2<f64>,
) -> (Vector2<f64>, Matrix2<f64>) {
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
pub(crate) fn distort_with_jacobians(k: &[f64; COEFFICIENTS], p: &Vector2<f64>) -> Distorted {
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

/// The square of the largest `ρ` up to which the radial part `ρ c(ρ²)` rises: beyond it two rays share a pixel.
pub(crate) fn one_to_one_limit(k: &[f64; COEFFICIENTS]) -> f64 {
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
        if denominator <= 0.0 || rising <= 0.0 {
            let inside = rho - step;
            return inside * inside;
        }
    }
    f64::INFINITY
}
