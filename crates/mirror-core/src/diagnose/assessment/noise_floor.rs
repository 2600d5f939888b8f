//! The noise floor: the gap that would remain if only the measurement's noise were left.
//!
//! Two independent estimates are combined.
//!
//! * One needs no model of the body: the disagreement of the views of one posture (or, where postures have one view,
//!   the noise that the session states).
//! * The other is what the whole model, free-form errors included, leaves of the postures that it was fitted to:
//!   with n rows and p parameters, `σ² = Σ r² / (n − p)`. It is no smaller than the noise, and equals the noise
//!   where nothing significant is left.
//!
//! Both use the same residuals as the gap after, tails and detector errors included, so that gap and floor are
//! comparable.

use crate::diagnose::criteria::cross_validation::{PostureGap, gap_of, seen_size, size};
use crate::diagnose::criteria::lack_of_fit::noticeable_excess;
use crate::diagnose::likelihood::fit::Fit;
use crate::diagnose::likelihood::noise::{STATED_LOG_STD, is_settled};
use crate::diagnose::likelihood::noise_correlation::{shared_by_views, successive_correlation};
use crate::diagnose::likelihood::noise_scale::log_std_of_views;
use crate::diagnose::likelihood::saturated::{FreePosture, free_markers};
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::{FAR_DEVIATIONS, FEWEST_REDUNDANT_ROWS, Threshold};
use crate::diagnose::selection::search::Search;
use crate::error::Result;

/// An estimate of the floor: its value and the standard deviation of its logarithm.
#[derive(Debug, Clone, Copy)]
struct Known {
    value: f64,
    log_std: f64,
    /// Whether it is stated for these measurements, so that the residuals are not used.
    stated: bool,
}

/// Sizes of a floor.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FloorSize {
    pub m: f64,
    pub px: f64,
}

/// The source of the floor.
#[derive(Debug, Clone)]
pub(crate) struct Floor {
    /// The whole model's gap on the postures that it was fitted to.
    pub fitted: Vec<PostureGap>,
    /// Root of `n / (n − p)`.
    loss: f64,
    /// The independent estimate of the floor, as a share of the measured noise with which `fitted` was weighted.
    independent: Known,
    /// What the whole model leaves, as a multiple of the measured noise, freedom allowed for.
    pub fitted_scale: f64,
    /// Size of the pixel residuals that one measured noise makes.
    unit_px: f64,
    /// Uncertainty of the estimate from the fitted residuals: standard deviation of the logarithm.
    fitted_log_std: f64,
    /// Whether tests found nothing significant left: the fitted residuals are noise then, and no mere upper bound.
    nothing_left: bool,
}

impl Floor {
    /// The floor of a model's gaps.
    ///
    /// # Errors
    /// Invalid parameters of the camera or mirror.
    pub fn new(search: &Search<'_>, fit: &Fit, nothing_left: bool) -> Result<Self> {
        let problem = &search.problem;
        let deformation = search.deformation(&fit.model);
        let noise = search.detector_noise();
        let postures = free_markers(problem, &deformation, noise, true, None)?;
        let fitted: Vec<PostureGap> = postures.iter().map(gap_of).collect();
        let rows: f64 = postures.iter().map(|p| p.freedom_left + p.freedom_taken).sum();
        let loss = (rows / (rows - spent(search, fit)).max(0.2 * rows).max(1.0)).sqrt().max(1.0);
        let pixels: f64 = fitted.iter().map(|g| g.pixels).sum();
        // Raw residuals are a little smaller than the noise: their frame's plane has given way to them.
        let whitened = postures.iter().map(|p| p.chi2_predicted).sum::<f64>() / rows.max(1.0);
        let raw = fitted.iter().map(|g| g.square_sum_px2).sum::<f64>() / pixels.max(1.0);
        let unit_px = if pixels > 0.0 && whitened > 0.0 { (raw / whitened).sqrt() } else { 0.0 };
        Ok(Self {
            loss,
            fitted_scale: whitened.max(0.0).sqrt() * loss,
            independent: independent(problem, &deformation, noise, &postures)?,
            unit_px,
            fitted_log_std: log_std(&fitted),
            nothing_left,
            fitted,
        })
    }

    /// The floor over some of the postures (`fitted`), with the independent estimate varied by `deviation` standard
    /// deviations.
    pub fn of(&self, fitted: &[PostureGap], deviation: f64) -> FloorSize {
        let seen = size(fitted);
        let known = self.independent.value * (self.independent.log_std * deviation).exp();
        FloorSize {
            m: self.together(seen.rms_m * self.loss, seen.floor_m * known),
            px: self.together(seen.rms_px.unwrap_or(0.0) * self.loss, self.unit_px * known),
        }
    }

    /// The precision-weighted mean of the two estimates' logarithms; if one is only an upper bound, the smaller.
    fn together(&self, fitted: f64, independent: f64) -> f64 {
        if self.independent.stated {
            return independent;
        }
        if fitted <= 0.0 || independent <= 0.0 {
            return fitted.max(independent);
        }
        if !self.nothing_left {
            return fitted.min(independent);
        }
        let (a, b) = (self.fitted_log_std.powi(-2), self.independent.log_std.powi(-2));
        ((a * fitted.ln() + b * independent.ln()) / (a + b)).exp()
    }
}

/// Whether a model's held-out gap (`after`) is no larger than its floor, with the tails of the noise: where the
/// views of a posture determine the noise, a Gaussian with the same core would be too small a measure.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn is_reached(search: &Search<'_>, fit: &Fit, after: &[PostureGap]) -> Result<bool> {
    let floor = Floor::new(search, fit, false)?;
    let size_of_floor = floor.of(&floor.fitted, 0.0);
    let pixels = size(after).rms_px.is_some();
    let floor = if pixels { size_of_floor.px } else { size_of_floor.m };
    Ok(floor > 0.0 && (seen_size(after) / floor).powi(2) < 1.0 + noticeable_excess())
}

/// Measured points that scatter by this share of the robot's reach show nothing of it.
const SHARE_OF_REACH: Threshold = 0.1;

/// Whether the apparent noise is not noise: the views of one posture disagree on markers by far more than a
/// detector with corners as accurate as these, or as the session states; or corners are worse than stated by as
/// much; or measured points scatter by the length of the robot's links.
pub(crate) fn is_no_noise(measured: Noise, stated: Noise, reach_m: f64) -> bool {
    let far = |one: f64, usual: f64| (one / usual).ln() > FAR_DEVIATIONS * STATED_LOG_STD;
    far(measured.marker_px, measured.corner_px.max(stated.marker_px))
        || far(measured.corner_px, stated.corner_px)
        || (reach_m > 0.0 && measured.point_m > SHARE_OF_REACH * reach_m)
}

/// Effective number of fitted parameters: of one with a prior, the share that the data determine.
fn spent(search: &Search<'_>, fit: &Fit) -> f64 {
    let told = |at: usize, prior: f64| 1.0 - (fit.covariance[(at, at)] / (prior * prior)).clamp(0.0, 1.0);
    let first_group = fit.model.nuisances.len();
    let of_group = search.group.prior_std.iter().take(fit.model.group.len()).enumerate();
    let of_group: f64 = of_group.map(|(k, prior)| told(first_group + k, *prior)).sum();
    let mut at = fit.first_term;
    let mut of_terms = 0.0;
    for term in &fit.model.terms {
        for prior in search.catalogue.prior_stds(term.hypothesis, term.variant).take(term.parameters.len()) {
            of_terms += told(at, prior * term.prior_scale);
            at += 1;
        }
    }
    first_group as f64 + of_group + of_terms
}

/// Standard deviation of the logarithm of a root mean square, from the scatter of the postures that make it.
fn log_std(gaps: &[PostureGap]) -> f64 {
    let pixels = gaps.iter().any(|g| g.pixels > 0.0);
    let of =
        |g: &PostureGap| if pixels { (g.square_sum_px2, g.pixels) } else { (g.square_sum_m2, g.markers) };
    let (sum, count) = gaps.iter().map(of).fold((0.0, 0.0), |(s, c), (a, b)| (s + a, c + b));
    if sum <= 0.0 {
        return STATED_LOG_STD;
    }
    let mean = sum / count;
    let scatter: f64 = gaps.iter().map(of).map(|(s, c)| (s - mean * c).powi(2)).sum();
    (0.5 * scatter.sqrt() / sum).max(1e-3)
}

fn independent(
    problem: &Problem,
    deformation: &Deformation,
    noise: Noise,
    postures: &[FreePosture],
) -> Result<Known> {
    let redundant = |p: &[FreePosture]| p.iter().map(|p| p.freedom_left.max(0.0)).sum::<f64>();
    let stated = Known {
        value: 1.0,
        log_std: STATED_LOG_STD,
        stated: problem.camera.is_none() && problem.point_noise_stated,
    };
    if problem.camera.is_none() || redundant(postures) < FEWEST_REDUNDANT_ROWS {
        return Ok(stated);
    }
    let mut at = noise;
    let mut postures = postures.to_vec();
    for _ in 0..SOLVER.rounds {
        let variance = postures.iter().map(|p| p.chi2_free.max(0.0)).sum::<f64>() / redundant(&postures);
        if variance <= 0.0 {
            return Ok(stated);
        }
        at.marker_px *= variance.sqrt();
        if is_settled(variance) {
            break;
        }
        postures = free_markers(problem, deformation, at, true, None)?;
    }
    let correlation = successive_correlation(problem, deformation, noise)?;
    let views = postures.iter().map(|p| p.frames.len()).sum::<usize>() as f64 / postures.len().max(1) as f64;
    // Views of one posture are successive: of errors that are correlated over frames they show only the difference.
    let shared = shared_by_views(correlation, views);
    Ok(Known {
        value: at.marker_px / noise.marker_px / (1.0 - shared).sqrt(),
        log_std: log_std_of_views(redundant(&postures)).hypot(0.25 * shared),
        stated: false,
    })
}
