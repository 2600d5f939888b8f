//! The fisheye lens of Kannala and Brandt in normalised image coordinates `(X/Z, Y/Z)`: `ρ = tan θ` goes to `θ (1 + k1 θ² + …)`.

use super::distorted::{COEFFICIENTS, Distorted};
use nalgebra::{Matrix2, SMatrix, Vector2};

/// How far off the axis points are projected: beyond, normalised coordinates have no digits left.
const WIDEST_ANGLE_RAD: f64 = 1.553;
/// Steps of the search for a fold.
const FOLD_STEPS: usize = 1500;
/// Below this `ρ` the factor is its series: `θ_d / ρ = 1 + (k1 − 1/3) ρ² + …`.
const SMALL: f64 = 1e-4;
/// Steps of the inverse.
const INVERSE_STEPS: usize = 30;

/// `θ_d` and `dθ_d/dθ`.
#[inline]
fn bent(k: &[f64; COEFFICIENTS], theta: f64) -> (f64, f64) {
    let t = theta * theta;
    let value = theta * (1.0 + t * (k[0] + t * (k[1] + t * (k[2] + t * k[3]))));
    let slope = 1.0 + t * (3.0 * k[0] + t * (5.0 * k[1] + t * (7.0 * k[2] + t * 9.0 * k[3])));
    (value, slope)
}

/// The factor `c = θ_d / ρ` and `dc/ds`, `s = ρ²`.
#[inline]
fn factor(k: &[f64; COEFFICIENTS], s: f64) -> (f64, f64) {
    let rho = s.sqrt();
    if rho < SMALL {
        let first = k[0] - 1.0 / 3.0;
        return (1.0 + first * s, first);
    }
    let (value, slope) = bent(k, rho.atan());
    let by_rho = (slope / (1.0 + s) - value / rho) / rho;
    (value / rho, by_rho / (2.0 * rho))
}

#[inline]
pub(super) fn distort(k: &[f64; COEFFICIENTS], p: &Vector2<f64>) -> Vector2<f64> {
    p * factor(k, p.norm_squared()).0
}

#[inline]
pub(super) fn distort_with_point_jacobian(
    k: &[f64; COEFFICIENTS],
    p: &Vector2<f64>,
) -> (Vector2<f64>, Matrix2<f64>) {
    let (c, dc) = factor(k, p.norm_squared());
    (p * c, Matrix2::identity() * c + p * p.transpose() * (2.0 * dc))
}

pub(super) fn distort_with_jacobians(k: &[f64; COEFFICIENTS], p: &Vector2<f64>) -> Distorted {
    let (point, by_point) = distort_with_point_jacobian(k, p);
    let rho = p.norm();
    let theta = rho.atan();
    let mut by_coefficients = SMatrix::<f64, 2, COEFFICIENTS>::zeros();
    if rho > 0.0 {
        for power in 0..4 {
            let column = p * (theta.powi(2 * power + 3) / rho);
            by_coefficients.set_column(power as usize, &column);
        }
    }
    Distorted { point, by_point, by_coefficients }
}

/// The square of the largest `ρ` up to which `θ_d` rises, within the widest angle.
pub(super) fn one_to_one_limit(k: &[f64; COEFFICIENTS]) -> f64 {
    let step = WIDEST_ANGLE_RAD / FOLD_STEPS as f64;
    let mut theta = 0.0;
    for i in 1..=FOLD_STEPS {
        let next = i as f64 * step;
        if bent(k, next).1 <= 0.0 {
            break;
        }
        theta = next;
    }
    theta.tan().powi(2)
}

/// The inverse by its one number: `θ` of `θ_d`, by Newton's method kept inside the one-to-one region by halving.
pub(super) fn undistorted(k: &[f64; COEFFICIENTS], target: &Vector2<f64>, limit: f64) -> Vector2<f64> {
    let wanted = target.norm();
    if wanted < SMALL {
        return *target;
    }
    let (mut low, mut high) = (0.0, limit.sqrt().atan());
    let mut theta = wanted.min(high);
    for _ in 0..INVERSE_STEPS {
        let (value, slope) = bent(k, theta);
        if value > wanted {
            high = theta;
        } else {
            low = theta;
        }
        let newton = theta - (value - wanted) / slope;
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        if (next - theta).abs() < 1e-16 {
            break;
        }
        theta = next;
    }
    target * (theta.tan() / wanted)
}
