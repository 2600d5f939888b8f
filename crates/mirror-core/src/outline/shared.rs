//! Errors that the edges of an outline share with their neighbours, and what they do to its fit.
//!
//! What lies behind a ball is as large on a large ball's outline as on a small one's: edges share the errors that a blur mixes in over a length, not over an angle, and
//! the variance of a large ball's centre falls with its radius. The length is one of the picture: in an enlarged one all is as many times as long, the
//! correlation of the edges' scatter too, which therefore tells it. On small balls the light on the ball itself limits it to an angle.

use nalgebra::{Complex, Matrix3, SMatrix, Vector2, Vector3};

/// Errors are correlated over about this angle along the outline (standard deviation of a Gaussian), rad: measured on balls of 9 to 20 px.
const REACH_RAD: f64 = 0.8;
/// On large balls over so many times the length over which the edges' scatter is correlated, and over at least so many px: what that angle is on balls of 14 px, whose
/// scatter is correlated over 1.8 px.
const REACH_CORRELATIONS: f64 = 6.0;
const LEAST_REACH_PX: f64 = 11.0;
/// Harmonics of the correlation at most, and so many of its widths in the frequency as count: the next are below 0.05 of the first.
const MOST_HARMONICS: usize = 12;
const WIDTHS: f64 = 2.5;

/// `Σ_ij ρ(θ_i − θ_j) g_i g_jᵀ` over the edges of an outline, g how far one deviation of an edge's shared error moves the fit's right side, ρ a Gaussian of the
/// angle between two edges, as its Fourier series: `ρ(θ) = Σ_k c_k cos kθ`, `c_k = (2 − δ_k0) s / √2π exp(−k² s² / 2)`, s its width.
pub(super) struct SharedErrors {
    reach_rad: f64,
    count: usize,
    /// Sums of `g cos kθ` and `g sin kθ`, by k.
    sums: SMatrix<f64, 3, { 2 * MOST_HARMONICS }>,
}

impl SharedErrors {
    /// On an outline of a radius; `correlated_px`: the length over which its edges' scatter is correlated.
    pub fn on(radius_px: f64, correlated_px: f64) -> Self {
        let reach_px = (REACH_CORRELATIONS * correlated_px).max(LEAST_REACH_PX);
        let reach_rad = (reach_px / radius_px.max(1.0)).min(REACH_RAD);
        let count = ((WIDTHS / reach_rad).ceil() as usize + 1).min(MOST_HARMONICS);
        Self { reach_rad, count, sums: SMatrix::zeros() }
    }

    /// An edge in a direction from the outline's middle, and its g.
    pub fn add(&mut self, direction: &Vector2<f64>, moved: &Vector3<f64>) {
        // The angle's cosine and sine; their multiples by powers.
        let (turn, mut turned) = (Complex::new(direction.x, direction.y), Complex::new(1.0, 0.0));
        for k in 0..self.count {
            self.sums.column_mut(2 * k).axpy(turned.re, moved, 1.0);
            self.sums.column_mut(2 * k + 1).axpy(turned.im, moved, 1.0);
            turned *= turn;
        }
    }

    /// The sum over all pairs.
    pub fn information(&self) -> Matrix3<f64> {
        let mut sum = Matrix3::zeros();
        for k in 0..self.count {
            let (order, sides) = (k as f64, if k == 0 { 1.0 } else { 2.0 });
            let weight = sides * self.reach_rad / core::f64::consts::TAU.sqrt()
                * (-0.5 * (order * self.reach_rad).powi(2)).exp();
            for column in [self.sums.column(2 * k), self.sums.column(2 * k + 1)] {
                sum += column * column.transpose() * weight;
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Variance of the mean of `n · e` over evenly spaced edges of a circle, e shared errors of 1 px: of a whole outline's centre, times 1/4.
    fn centre_variance(radius_px: f64, correlated_px: f64) -> f64 {
        let count = (core::f64::consts::TAU * radius_px) as usize;
        let mut shared = SharedErrors::on(radius_px, correlated_px);
        for i in 0..count {
            let (sine, cosine) = (core::f64::consts::TAU * i as f64 / count as f64).sin_cos();
            shared.add(&Vector2::new(cosine, sine), &(Vector3::new(cosine, sine, 1.0) / count as f64));
        }
        shared.information()[(0, 0)]
    }

    #[test]
    fn the_series_is_the_sum_over_all_pairs() {
        for (radius_px, reach_px) in [(8.0, 8.0 * REACH_RAD), (40.0, LEAST_REACH_PX)] {
            let mut shared = SharedErrors::on(radius_px, 0.0);
            let mut edges = Vec::new();
            // Three quarters of an outline.
            for i in 0..90 {
                let angle = 0.052 * f64::from(i);
                let g = Vector3::new(angle.cos(), angle.sin(), 1.0 + 0.1 * f64::from(i % 7));
                shared.add(&Vector2::new(angle.cos(), angle.sin()), &g);
                edges.push((angle, g));
            }
            let mut wanted = Matrix3::zeros();
            for (a, g) in &edges {
                for (b, h) in &edges {
                    for wrap in -2..=2 {
                        let away_px = radius_px * (a - b + core::f64::consts::TAU * f64::from(wrap));
                        wanted += g * h.transpose() * (-0.5 * (away_px / reach_px).powi(2)).exp();
                    }
                }
            }
            let off = (shared.information() - wanted).norm() / wanted.norm();
            assert!(off < 0.02, "{radius_px}: {off}");
        }
    }

    #[test]
    fn a_large_outline_has_more_parts_of_its_own_unless_all_is_enlarged() {
        // With n lengths on the outline the variance falls with 1 / n.
        let (large, larger) = (centre_variance(60.0, 1.8), centre_variance(120.0, 1.8));
        assert!((large / larger - 2.0).abs() < 0.15, "{large} {larger}");
        // The same ball in a picture that is enlarged five times.
        let (small, enlarged) = (centre_variance(12.0, 1.8), centre_variance(60.0, 9.0));
        assert!((small / enlarged - 1.0).abs() < 0.01, "{small} {enlarged}");
    }
}
