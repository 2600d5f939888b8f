//! The factors of board and camera that explain the views best: a coarse search over a factor's logarithm, then golden
//! sections.

use super::fit::Fit;
use super::reading::{Reading, Scale};
use super::views::Views;
use crate::cancel::Cancel;
use crate::error::Result;
use crate::statistics::least_between;
use rayon::prelude::*;

/// Factors of board or camera nearer to 1 than this are a matter of calibration, not of a mistake.
const LEAST_SCALE: f64 = 0.04;
/// The largest factor that is tried; the smallest is its inverse.
const LARGEST_FACTOR: f64 = 4.0;
/// Factors of the coarse search: neighbours differ by 12 %.
const COARSE: usize = 25;
/// Golden sections: they leave 1e-4 of a factor.
const SECTIONS: usize = 16;

/// A scale with its factor.
type Scaled = fn(f64) -> Scale;
const SCALES: [Scaled; 3] = [Scale::Squares, Scale::Resolution, Scale::FocalLength];

/// The reading that a scale is, in words.
fn reading(scale: Scale, square_m: f64) -> Reading {
    let factor = scale.factor();
    let mistake = match scale {
        Scale::AsStated => Reading::as_it_stands(),
        Scale::Squares(_) => Reading::mistake(
            "another board",
            format!(
                "the board is another one: its squares measure {:.2} mm, not {:.2} mm",
                1000.0 * factor * square_m,
                1000.0 * square_m
            ),
            "measure the printed squares and correct [board] square",
            Some("board_scale"),
        ),
        Scale::Resolution(_) => Reading::mistake(
            "camera of another resolution",
            format!(
                "the camera file is another camera's or another resolution's: {factor:.2} times its focal length and centre fit"
            ),
            "give the camera file of this camera at the resolution of these pictures",
            Some("camera_resolution"),
        ),
        Scale::FocalLength(_) => Reading::mistake(
            "camera of another focal length",
            format!(
                "the camera file is another camera's, or the pictures are cropped or zoomed: {factor:.2} times its focal length fits"
            ),
            "give the camera file of this camera as it took these pictures",
            Some("camera_focal"),
        ),
    };
    Reading { scale, ..mistake }
}

impl Views {
    /// The best factor of the squares' side, of the camera's resolution and of its focal length, each alone, where it is far
    /// from 1.
    ///
    /// # Errors
    /// As [`Views::fit`].
    pub(super) fn best_factors(&self, cancel: &Cancel) -> Result<Vec<(Reading, Fit)>> {
        let best = |scaled: &Scaled| {
            let Some(factor) = self.best_factor(*scaled, cancel)? else { return Ok(None) };
            if factor.ln().abs() <= LEAST_SCALE {
                return Ok(None);
            }
            let reading = reading(scaled(factor), self.board.square_m());
            let fit = self.fit(&reading, cancel)?;
            Ok(Some((reading, fit)))
        };
        let found: Vec<_> = SCALES.par_iter().with_max_len(1).map(best).collect::<Result<_>>()?;
        Ok(found.into_iter().flatten().collect())
    }

    /// The factor with the least residual of the board; none where none has a finite one.
    fn best_factor(&self, scaled: Scaled, cancel: &Cancel) -> Result<Option<f64>> {
        // By the logarithm of the inverse: of two equal costs a golden section keeps the larger number's side, which is then
        // the smaller factor's.
        let cost = |log_inverse: f64| {
            let scale = scaled((-log_inverse).exp());
            self.board_rms_px(&Reading { scale, ..Reading::as_it_stands() }, cancel)
        };
        let end = LARGEST_FACTOR.ln();
        let step = 2.0 * end / (COARSE - 1) as f64;
        let grid: [f64; COARSE] = core::array::from_fn(|i| end - i as f64 * step);
        let costs: Vec<f64> = grid.par_iter().map(|&at| cost(at)).collect::<Result<_>>()?;
        let least = (0..COARSE).min_by(|&i, &j| costs[i].total_cmp(&costs[j])).unwrap_or(0);
        if !costs[least].is_finite() {
            return Ok(None);
        }
        let (high, low) = (grid[least.saturating_sub(1)], grid[(least + 1).min(COARSE - 1)]);
        Ok(Some((-least_between(low, high, SECTIONS, cost)?).exp()))
    }
}
