//! Unit vectors compared.

use super::rotation::nearest;
use crate::error::{Error, Result};
use nalgebra::{Matrix3, Vector3};

/// RMS angle between unit vectors in pairs, rad: `√(Σ ∠(a_k, b_k)² / N)`; 0 for none.
///
/// # Errors
/// [`Error::LengthMismatch`] where one has more vectors than the other.
pub fn rms_angle(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> Result<f64> {
    if a.len() != b.len() {
        return Err(Error::LengthMismatch {
            what: "second unit vectors (one for each of the first)".to_owned(),
            got: b.len(),
            needed: a.len(),
        });
    }
    if a.is_empty() {
        // An empty sum of floats is −0.
        return Ok(0.0);
    }
    let squares = a.iter().zip(b).map(|(a, b)| a.cross(b).norm().atan2(a.dot(b)).powi(2));
    Ok((squares.sum::<f64>() / a.len() as f64).sqrt())
}

/// As [`rms_angle`], with a turned by the one rotation that brings it closest to b.
///
/// # Errors
/// As [`rms_angle`].
pub fn rms_angle_turned(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> Result<f64> {
    let sum: Matrix3<f64> = a.iter().zip(b).map(|(a, b)| b * a.transpose()).sum();
    let rotation = nearest(&sum).unwrap_or_else(Matrix3::identity);
    rms_angle(&a.iter().map(|a| rotation * a).collect::<Vec<_>>(), b)
}
