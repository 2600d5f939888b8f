//! The blur that the balls of a picture share.

use super::ray_edge::NORMAL_SPREAD;
use super::template::LEAST_VARIANCE_PX2;
use crate::statistics::median;
use nalgebra::{Matrix2, SymmetricEigen};

/// Variance of a blur at most, px².
const MOST_VARIANCE_PX2: f64 = 36.0;
/// Fewest balls for a common blur, and its largest precision, px².
const LEAST_SHARING: usize = 3;
const LEAST_SHARED_STD_PX2: f64 = 0.3;

/// A blur that the balls of a picture share: the camera moved, or the lens is out of focus.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CommonBlur {
    /// Its covariance, px².
    pub covariance_px2: Matrix2<f64>,
    /// How far a ball's own may be from that, a standard deviation of each number, px².
    pub std_px2: f64,
}

impl CommonBlur {
    /// By the medians of several balls' blurs, and how far they scatter; None for fewer than three.
    pub fn of(blurs_px2: &[Matrix2<f64>]) -> Option<Self> {
        if blurs_px2.len() < LEAST_SHARING {
            return None;
        }
        let number = |row: usize, column: usize| median(blurs_px2.iter().map(|b| b[(row, column)]).collect());
        let covariance_px2 = Matrix2::new(number(0, 0), number(0, 1), number(0, 1), number(1, 1));
        let away = blurs_px2.iter().flat_map(|b| {
            let off = b - covariance_px2;
            [off[(0, 0)].abs(), off[(0, 1)].abs(), off[(1, 1)].abs()]
        });
        Some(Self { covariance_px2, std_px2: LEAST_SHARED_STD_PX2 + NORMAL_SPREAD * median(away.collect()) })
    }
}

/// A blur with variances in their range.
pub(super) fn clamped(blur_px2: &Matrix2<f64>) -> Matrix2<f64> {
    let mut eigen = SymmetricEigen::new(*blur_px2);
    eigen.eigenvalues.apply(|v| *v = v.clamp(LEAST_VARIANCE_PX2, MOST_VARIANCE_PX2));
    eigen.recompose()
}
