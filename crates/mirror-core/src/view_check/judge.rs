//! Which mistake is named: the one that explains the views, markers included, far better than the session as it stands.

use super::fit::{Fit, LEAST_MARKER_PX};
use super::reading::Reading;
use super::usual_mistakes::usual_mistakes;
use super::views::Views;
use crate::cancel::Cancel;
use crate::error::{Result, positive};
use rayon::prelude::*;

/// No corner is known better, px.
const LEAST_NOISE_PX: f64 = 0.05;
/// RMS of the board's residual, in deviations of the noise, above which the usual mistakes are tried. Hand-made mounts leave
/// up to 10.
const SUSPICIOUS_DEVIATIONS: f64 = 2.0;
/// A reading that leaves more than this, in deviations of the noise, explains nothing.
const EXPLAINED_DEVIATIONS: f64 = 20.0;
/// Median distance of the markers from the model's, as a share of the picture's width, above which it may be doubted.
const SUSPICIOUS_MARKERS: f64 = 0.05;
/// How many times smaller the residuals (board times markers) must be for a mistake to be named; squared for two mistakes at
/// once.
const LEAST_GAIN: f64 = 8.0;
/// No residual of a named reading may be larger than this many times the session's own.
const WORSE: f64 = 1.5;

/// How views are checked.
#[derive(Debug, Clone)]
pub struct ViewCheckOptions {
    /// Standard deviation of a corner along one axis, px.
    pub noise_px: f64,
    /// Mistakes are tried only where the board's residuals are far from what mounts by hand leave.
    pub gross: bool,
    /// Stops the check.
    pub cancel: Cancel,
}

impl Default for ViewCheckOptions {
    /// The usual noise of a corner, and everything that may be doubted is.
    fn default() -> Self {
        Self { noise_px: 0.2, gross: false, cancel: Cancel::default() }
    }
}

/// The result of a check.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewCheck {
    /// How well the session as it stands explains its views.
    pub as_it_stands: Fit,
    /// The noise of a corner's distance (both axes) with which residuals were compared, px.
    pub noise_px: f64,
    /// What is wrong and how to correct it, in a sentence; none where no mistake is named.
    pub mistake: Option<String>,
    /// The readings of that sentence: the best one, and those that cannot be separated from it here.
    pub readings: Vec<Reading>,
}

/// Tests views of the board in the mirror against the model, and against the usual mistakes.
///
/// # Errors
/// [`crate::Error::OutOfRange`] and [`crate::Error::NotFinite`] for a noise that is not above zero and for numbers that make no
/// camera or board at a factor that is tried, [`crate::Error::Cancelled`].
pub fn check_views(views: &Views, options: &ViewCheckOptions) -> Result<ViewCheck> {
    let noise_px = positive("noise of a corner (px)", options.noise_px)?;
    let noise_px = LEAST_NOISE_PX.max(noise_px * std::f64::consts::SQRT_2);
    let own = views.fit(&Reading::as_it_stands(), &options.cancel)?;
    let nothing = ViewCheck { as_it_stands: own, noise_px, mistake: None, readings: Vec::new() };
    if !doubted(&own, views, noise_px, options.gross) {
        return Ok(nothing);
    }
    let usual = usual_mistakes(views.board.corners(), views.square_picture());
    let fitted = |reading: Reading| {
        let fit = views.fit(&reading, &options.cancel)?;
        Ok((reading, fit))
    };
    let (fits, factors) = rayon::join(
        || usual.into_par_iter().map(fitted).collect::<Result<Vec<_>>>(),
        || views.best_factors(&options.cancel),
    );
    let mut fits = fits?;
    fits.extend(factors?);
    fits.retain(|(reading, fit)| explains(reading, fit, &own, noise_px));
    // Of mistakes that explain the views, those that take the fewest.
    let fewest = fits.iter().map(|(reading, _)| reading.mistakes).min();
    fits.retain(|(reading, _)| Some(reading.mistakes) == fewest);
    let gains: Vec<f64> = fits.iter().map(|(_, fit)| fit.gain_over(&own, noise_px)).collect();
    let Some(first) = (0..gains.len()).rev().max_by(|&i, &j| gains[i].total_cmp(&gains[j])) else {
        return Ok(nothing);
    };
    let best = fits.remove(first);
    // A reading that explains the views as well as the best one cannot be separated from it.
    fits.retain(|(_, fit)| best.1.gain_over(fit, noise_px) < WORSE);
    let mistake = Some(sentence(&own, &best, &fits));
    let readings = core::iter::once(best).chain(fits).map(|(reading, _)| reading).collect();
    Ok(ViewCheck { mistake, readings, ..nothing })
}

/// Whether a session's own fit is a reason to try the usual mistakes.
fn doubted(own: &Fit, views: &Views, noise_px: f64, gross: bool) -> bool {
    if gross {
        return own.board_rms_px > EXPLAINED_DEVIATIONS * noise_px;
    }
    let far_px = SUSPICIOUS_MARKERS * f64::from(views.camera.size_px().0);
    own.board_rms_px > SUSPICIOUS_DEVIATIONS * noise_px || own.marker_px.is_some_and(|away| away > far_px)
}

fn explains(reading: &Reading, fit: &Fit, own: &Fit, noise_px: f64) -> bool {
    let most_px = (WORSE * own.board_rms_px.max(noise_px)).min(EXPLAINED_DEVIATIONS * noise_px);
    let markers = match (own.marker_px, fit.marker_px) {
        (Some(own), Some(fit)) => fit <= WORSE * own.max(LEAST_MARKER_PX),
        _ => true,
    };
    fit.board_rms_px <= most_px
        && markers
        && fit.gain_over(own, noise_px) >= LEAST_GAIN.powi(i32::from(reading.mistakes))
}

fn sentence(own: &Fit, (best, fit): &(Reading, Fit), equal: &[(Reading, Fit)]) -> String {
    let stands = if own.board_rms_px.is_finite() {
        format!("{:.2} px RMS", own.board_rms_px)
    } else {
        "no mirror at all explains them".to_owned()
    };
    let mut text = format!(
        "{}: read so, the board's reflections fit a mirror to {:.2} px RMS, as they stand: {stands}; {}",
        best.said, fit.board_rms_px, best.fix
    );
    for (other, _) in equal {
        text += &format!("; or {} (cannot be separated here): {}", other.said, other.fix);
    }
    text
}
