//! What every lens model gives: a distorted point with its derivatives.

use nalgebra::{Matrix2, SMatrix, Vector2};

/// Number of coefficients of the richest model; poorer ones are padded with zeros.
pub(crate) const COEFFICIENTS: usize = 8;

/// A distorted point with its derivatives.
pub(crate) struct Distorted {
    pub point: Vector2<f64>,
    /// `∂(x_d, y_d)/∂(x, y)`.
    pub by_point: Matrix2<f64>,
    /// `∂(x_d, y_d)/∂` the coefficients in their model's order, zeros beyond them.
    pub by_coefficients: SMatrix<f64, 2, COEFFICIENTS>,
}
