//! The camera's tone curve, told by the board's pattern.
//!
//! A lens mixes light. Read by a wrong curve, the mixture of a dark and a bright square is too dark (or too bright) on
//! both sides of a square, whatever the lens does to light: edges from dark to bright and from bright to dark move
//! against each other, and that no blur and no ghost does. The pattern P is known, so the levels are
//! `g((a + c P ∗ G_b)^(1 / p))`: a and c planes (light changes slowly), G_b a Gaussian of b px, g sRGB's curve, and
//! `p = 1.085^x` the power by which the camera's light differs from sRGB's. x, b and the planes by least squares of
//! the levels (Gauss–Newton; `∂(P ∗ G_b)/∂b = b ∇²(P ∗ G_b)`, heat equation).
//!
//! Ink that spreads over the squares' edges moves them as a curve does, and a sharpening that was told by sRGB's curve
//! hides another one. Neither is fitted, for they look much alike; their deviations are propagated into that of x.

use super::curve::CURVE_DOUBT;
use super::patch::linear;
use super::picture_noise::smooth;
use crate::error::{Error, Result};
use nalgebra::{SMatrix, SVector};

/// Of the light: a plane of the mean and one of the contrast. Then the blur and the curve.
const PLANES: usize = 6;
const BLUR: usize = PLANES;
const CURVE: usize = PLANES + 1;
const UNKNOWNS: usize = PLANES + 2;
/// Pixels nearer to the border mix with what is not drawn.
const CLEAR_PX: usize = 4;
/// Levels outside of these may be cut off; so much of the pattern must lie between them, and at least so many pixels.
const CLEAR_LEVELS: (u8, u8) = (3, 252);
const LEAST_CLEAR: f64 = 0.9;
const LEAST_PIXELS: usize = 100;
/// The most pixels that are read: more take time and tell no more.
const MOST_PIXELS: usize = 3000;
/// Blurs to begin with, the range of the blur, and its largest step, px: beyond, the squares melt.
const START_BLURS_PX: [f64; 3] = [0.45, 0.8, 1.5];
const BLUR_RANGE_PX: (f64, f64) = (0.25, 4.0);
const MOST_BLUR_STEP: f64 = 0.4;
/// The largest step of the curve, and the farthest curve that is told, deviations: powers of 0.5 to 2.
const MOST_CURVE_STEP: f64 = 3.0;
const MOST_DEVIATIONS: f64 = 8.5;
/// Steps at most, and the ones that count as none: px of blur and deviations of the curve.
const ROUNDS: usize = 6;
const DONE: f64 = 0.02;
/// Least light, for its logarithm.
const LEAST_LIGHT: f64 = 1e-4;
/// One power is not the whole curve: another part of it (a toe, other colours) may differ by so much of what the board's part does. For a gamma of 1.8, balls show 1.95 deviations
/// where the board shows 2.8.
const OTHER_PART_SHARE: f64 = 0.3;

/// A part of a picture, and the pattern drawn there; rows of pixels.
#[derive(Debug, Clone, Copy)]
pub struct PatternLevels<'a> {
    /// Pixels across.
    pub width: usize,
    /// And down.
    pub height: usize,
    /// Grey levels.
    pub levels: &'a [u8],
    /// 1 and −1 by square, edges averaged over each pixel.
    pub pattern: &'a [f32],
    /// So many pixels share their errors: an edge's, on both of its sides.
    pub shared_pixels: f64,
    /// How far ink may spread over the edge of a square, a standard deviation, px.
    pub ink_px: f64,
    /// Where a sharpening was undone: how much each level (0..1) falls for each px² of more that is undone, and the standard deviation of its strength, px².
    pub sharpening: Option<(&'a [f32], f64)>,
}

/// A camera's tone curve as a pattern shows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PatternCurve {
    /// The light is sRGB's to the power `1.085^deviations`.
    pub deviations: f64,
    /// Standard deviation of that.
    pub std: f64,
    /// The blur of the pattern, px.
    pub blur_px: f64,
}

/// The curve that a view of the pattern shows; None where its levels are cut off, or it does not determine it.
///
/// # Errors
/// [`Error::LengthMismatch`] where levels, pattern or sharpening are not of the view's size.
pub fn pattern_curve(view: &PatternLevels<'_>) -> Result<Option<PatternCurve>> {
    let count = view.width * view.height;
    let sharpening = view.sharpening.map_or(count, |(falls, _)| falls.len());
    for (what, got) in
        [("levels", view.levels.len()), ("pattern", view.pattern.len()), ("sharpening", sharpening)]
    {
        if got != count {
            return Err(Error::LengthMismatch {
                what: format!("{what} of {} × {} px", view.width, view.height),
                got,
                needed: count,
            });
        }
    }
    let inner = view.width.saturating_sub(2 * CLEAR_PX) * view.height.saturating_sub(2 * CLEAR_PX);
    let stride = inner.div_ceil(MOST_PIXELS).max(1);
    let kept = view.kept(stride);
    if kept.len() < LEAST_PIXELS || ((kept.len() * stride) as f64) < LEAST_CLEAR * inner as f64 {
        return Ok(None);
    }
    Ok(told(view, &kept, view.shared_pixels / stride as f64))
}

impl PatternLevels<'_> {
    /// Pixels on slanted lines, so that edges along rows and columns are read alike.
    fn kept(&self, stride: usize) -> Vec<usize> {
        let (low, high) = CLEAR_LEVELS;
        let rows = CLEAR_PX..self.height.saturating_sub(CLEAR_PX);
        rows.flat_map(|row| {
            let first = CLEAR_PX + row % stride;
            let columns = (first..self.width.saturating_sub(CLEAR_PX)).step_by(stride);
            columns.map(move |column| row * self.width + column)
        })
        .filter(|at| (low..=high).contains(&self.levels[*at]))
        .collect()
    }

    fn blurred(&self, blur_px: f64) -> Vec<f32> {
        let mut pattern = self.pattern.to_vec();
        smooth(&mut pattern, self.width, self.height, blur_px);
        pattern
    }

    /// The basis of the light at a pixel: 1 and the place, each alone and by the pattern.
    fn basis(&self, at: usize, pattern: f64) -> SVector<f64, PLANES> {
        let u = 2.0 * (at % self.width) as f64 / self.width as f64 - 1.0;
        let v = 2.0 * (at / self.width) as f64 / self.height as f64 - 1.0;
        SVector::from([1.0, u, v, pattern, u * pattern, v * pattern])
    }
}

/// The planes of light by a blurred pattern, for sRGB's curve, and the squares that they leave.
fn planes(
    view: &PatternLevels<'_>,
    kept: &[usize],
    pattern: &[f32],
    light: &[f32; 256],
) -> Option<(SVector<f64, PLANES>, f64)> {
    let mut normal = SMatrix::<f64, PLANES, PLANES>::zeros();
    let (mut right, mut squares) = (SVector::<f64, PLANES>::zeros(), 0.0);
    for at in kept {
        let basis = view.basis(*at, f64::from(pattern[*at]));
        let seen = f64::from(light[usize::from(view.levels[*at])]);
        normal.syger(1.0, &basis, &basis, 1.0);
        right += basis * seen;
        squares += seen * seen;
    }
    normal.fill_upper_triangle_with_lower_triangle();
    let found = normal.cholesky()?.solve(&right);
    Some((found, squares - found.dot(&right)))
}

/// sRGB's level of light `exp(log)`, and its derivative by that logarithm.
#[inline]
fn level_and_slope(log: f64) -> (f64, f64) {
    /// The logarithm of 0.0031308, below which the curve is straight.
    const STRAIGHT: f64 = -5.7664;
    if log < STRAIGHT {
        let level = 12.92 * log.exp();
        return (level, level);
    }
    let curved = 1.055 * (log / 2.4).exp();
    (curved - 0.055, curved / 2.4)
}

fn told(view: &PatternLevels<'_>, kept: &[usize], shared_pixels: f64) -> Option<PatternCurve> {
    let light = linear();
    let starts = START_BLURS_PX.iter().filter_map(|blur| {
        planes(view, kept, &view.blurred(*blur), light).map(|(planes, left)| (*blur, planes, left))
    });
    let (mut blur, mut planes, _) = starts.min_by(|a, b| a.2.total_cmp(&b.2))?;
    let mut curve = 0.0;
    let mut result = None;
    for _ in 0..ROUNDS {
        let pattern = view.blurred(blur);
        let power = CURVE_DOUBT.powf(-curve);
        let mut normal = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
        let mut right = SVector::<f64, UNKNOWNS>::zeros();
        let (mut by_ink, mut by_sharpening, mut squares) = (right, right, 0.0);
        for at in kept {
            let here = f64::from(pattern[*at]);
            let around =
                [at - 1, at + 1, at - view.width, at + view.width].map(|place| f64::from(pattern[place]));
            let [left, next, above, below] = around;
            let basis = view.basis(*at, here);
            let lit = planes.dot(&basis).max(LEAST_LIGHT);
            let log = lit.ln();
            let (level, slope) = level_and_slope(power * log);
            let by_light = slope * power / lit;
            // What a change of the pattern does here.
            let by_pattern = by_light * (planes[3] + planes[4] * basis[1] + planes[5] * basis[2]);
            let mut row = SVector::<f64, UNKNOWNS>::zeros();
            for k in 0..PLANES {
                row[k] = by_light * basis[k];
            }
            row[BLUR] = by_pattern * blur * (left + next + above + below - 4.0 * here);
            row[CURVE] = -slope * power * log * CURVE_DOUBT.ln();
            let seen = f64::from(view.levels[*at]) / 255.0;
            normal.syger(1.0, &row, &row, 1.0);
            right.axpy(seen - level, &row, 1.0);
            by_ink.axpy(
                -by_pattern * 0.5 * ((next - left).powi(2) + (below - above).powi(2)).sqrt(),
                &row,
                1.0,
            );
            if let Some((falls, _)) = view.sharpening {
                by_sharpening.axpy(-f64::from(falls[*at]), &row, 1.0);
            }
            squares += (seen - level).powi(2);
        }
        normal.fill_upper_triangle_with_lower_triangle();
        let solver = normal.cholesky()?;
        let step = solver.solve(&right);
        let noise = shared_pixels * squares / kept.len() as f64 * solver.inverse()[(CURVE, CURVE)];
        let ink = view.ink_px * solver.solve(&by_ink)[CURVE];
        let sharpened = view.sharpening.map_or(0.0, |(_, std)| std * solver.solve(&by_sharpening)[CURVE]);
        for k in 0..PLANES {
            planes[k] += step[k];
        }
        let widened = step[BLUR].clamp(-MOST_BLUR_STEP * blur, MOST_BLUR_STEP * blur);
        let bent = step[CURVE].clamp(-MOST_CURVE_STEP, MOST_CURVE_STEP);
        blur = (blur + widened).clamp(BLUR_RANGE_PX.0, BLUR_RANGE_PX.1);
        curve += bent;
        let other = OTHER_PART_SHARE * curve;
        let std = noise.sqrt().hypot(ink).hypot(sharpened).hypot(other);
        result = Some(PatternCurve { deviations: curve, std, blur_px: blur });
        if widened.abs().max(bent.abs()) < DONE {
            break;
        }
    }
    result.filter(|found| found.std.is_finite() && found.deviations.abs() < MOST_DEVIATIONS)
}
