//! Unit vectors compared.

use super::rotation::nearest;
use nalgebra::{Matrix3, Vector3};

/// RMS angle between unit vectors in pairs, rad; 0 for none.
pub fn rms_angle(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| a.cross(b).norm().atan2(a.dot(b)).powi(2));
    let count = a.len().min(b.len()).max(1) as f64;
    (squares.sum::<f64>() / count).sqrt()
}

/// As [`rms_angle`], with a turned by the one rotation that brings it closest to b.
pub fn rms_angle_turned(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    let sum: Matrix3<f64> = a.iter().zip(b).map(|(a, b)| b * a.transpose()).sum();
    let rotation = nearest(&sum).unwrap_or_else(Matrix3::identity);
    rms_angle(&a.iter().map(|a| rotation * a).collect::<Vec<_>>(), b)
}
