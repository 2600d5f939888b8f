//! The image of a shaded ball through a blurred lens and a moving camera: planes of a basis of its light, on a grid
//! of pixels.
//!
//! The blur is a Gaussian with the width of its narrow direction; the excess width in the other direction is a
//! motion on a line while the shutter is open, of the same variance.

use nalgebra::{Matrix2, SymmetricEigen, Vector2};

/// 1, the normal's parts, and its quadratics: what matt balls show under distant lights.
pub(super) const BASES: usize = 9;
/// Distance of samples along a motion, px, and how many at most.
const MOTION_STEP_PX: f64 = 0.8;
const MOST_STEPS: usize = 48;
/// Least variance of a blur, px²: a pixel's area and a lens.
pub(super) const LEAST_VARIANCE_PX2: f64 = 0.15;
/// Where a Gaussian is cut off, standard deviations.
const REACH: f64 = 3.5;

/// A rectangle of pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    pub left: f64,
    pub top: f64,
    pub width: usize,
    pub height: usize,
}

impl Grid {
    pub fn count(&self) -> usize {
        self.width * self.height
    }

    /// The pixel of an index, row by row.
    pub fn place(&self, index: usize) -> Vector2<f64> {
        Vector2::new(self.left + (index % self.width) as f64, self.top + (index / self.width) as f64)
    }
}

/// A ball's outline: an ellipse of a fixed shape.
#[derive(Debug, Clone, Copy)]
pub(super) struct Disc {
    pub center_px: Vector2<f64>,
    pub radius_px: f64,
    /// From px about the centre to the unit disc, for a mean radius of 1 px.
    pub unit_from_px: Matrix2<f64>,
}

/// The planes of the basis of a ball's light, blurred with a covariance (px²); plane 0 is the share of each pixel that the ball covers.
pub(super) fn planes(grid: &Grid, disc: &Disc, blur_px2: &Matrix2<f64>) -> Vec<Vec<f64>> {
    let (narrow_px2, motion) = parts_of(blur_px2);
    let steps = ((motion.norm() / MOTION_STEP_PX).ceil() as usize).clamp(1, MOST_STEPS);
    let mut planes = vec![vec![0.0; grid.count()]; BASES];
    let share = (steps as f64).recip();
    for step in 0..steps {
        let center = disc.center_px + motion * ((step as f64 + 0.5) * share - 0.5);
        let reach = 1.6 * disc.radius_px + 2.0;
        let range = |middle: f64, first: f64, count: usize| {
            let low = (middle - reach - first).ceil().clamp(0.0, count as f64);
            let high = (middle + reach - first).floor().clamp(-1.0, count as f64 - 1.0) + 1.0;
            low as usize..(high as usize).max(low as usize)
        };
        for row in range(center.y, grid.top, grid.height) {
            for column in range(center.x, grid.left, grid.width) {
                let away = Vector2::new(grid.left + column as f64, grid.top + row as f64) - center;
                let unit = disc.unit_from_px * away / disc.radius_px;
                let rho = unit.norm();
                let local = if rho > 1e-6 { away.norm() / rho } else { disc.radius_px };
                let covered = ((1.0 - rho) * local + 0.5).clamp(0.0, 1.0) * share;
                if covered > 0.0 {
                    let index = row * grid.width + column;
                    for (plane, value) in planes.iter_mut().zip(basis(&unit, rho)) {
                        plane[index] += covered * value;
                    }
                }
            }
        }
    }
    let sigma = narrow_px2.sqrt();
    let half = (REACH * sigma).ceil() as usize;
    let raw: Vec<f64> =
        (0..=2 * half).map(|i| (-0.5 * ((i as f64 - half as f64) / sigma).powi(2)).exp()).collect();
    let total: f64 = raw.iter().sum();
    let kernel: Vec<f64> = raw.iter().map(|k| k / total).collect();
    let mut wide = vec![0.0; grid.count()];
    for plane in &mut planes {
        blurred(plane, &mut wide, grid, &kernel);
    }
    planes
}

/// The basis at a place of the unit disc; beyond the rim as at the rim.
fn basis(unit: &Vector2<f64>, rho: f64) -> [f64; BASES] {
    let (x, y) = if rho > 1.0 { (unit.x / rho, unit.y / rho) } else { (unit.x, unit.y) };
    let z = (1.0 - x * x - y * y).max(0.0).sqrt();
    [1.0, x, y, z, x * y, x * z, y * z, x * x - y * y, 3.0 * z * z - 1.0]
}

/// Variance of the Gaussian, and the motion.
fn parts_of(blur_px2: &Matrix2<f64>) -> (f64, Vector2<f64>) {
    let eigen = SymmetricEigen::new(*blur_px2);
    let (wide, narrow) = if eigen.eigenvalues.x >= eigen.eigenvalues.y { (0, 1) } else { (1, 0) };
    let least = eigen.eigenvalues[narrow].max(LEAST_VARIANCE_PX2);
    let more = (eigen.eigenvalues[wide] - least).max(0.0);
    (least, eigen.eigenvectors.column(wide) * (12.0 * more).sqrt())
}

/// Across, then down; what lies outside is dark.
fn blurred(plane: &mut [f64], wide: &mut [f64], grid: &Grid, kernel: &[f64]) {
    let half = kernel.len() / 2;
    wide.fill(0.0);
    for row in 0..grid.height {
        let (from, to) = (&plane[row * grid.width..(row + 1) * grid.width], row * grid.width);
        for (tap, weight) in kernel.iter().enumerate() {
            let (low, high) = overlap(tap, half, grid.width);
            for column in low..high {
                wide[to + column] += weight * from[column + tap - half];
            }
        }
    }
    plane.fill(0.0);
    for (tap, weight) in kernel.iter().enumerate() {
        let (low, high) = overlap(tap, half, grid.height);
        for row in low..high {
            let from = (row + tap - half) * grid.width;
            let to = &mut plane[row * grid.width..(row + 1) * grid.width];
            for (sum, value) in to.iter_mut().zip(&wide[from..from + grid.width]) {
                *sum += weight * value;
            }
        }
    }
}

/// Places whose neighbour by a kernel's tap lies within the grid.
fn overlap(tap: usize, half: usize, count: usize) -> (usize, usize) {
    let low = half.saturating_sub(tap).min(count);
    let high = (count + half).saturating_sub(tap).min(count);
    (low, high.max(low))
}
