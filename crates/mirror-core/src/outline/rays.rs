//! Samples of a patch along rays from a ball's centre, and quantities read from them.

use super::curve::level_of;
use super::patch::Patch;
use super::shading::Shading;
use nalgebra::Vector2;

/// Distance of samples along a ray, px.
pub(super) const STEP_PX: f64 = 0.25;
/// The search along a ray, on both sides of the expected edge, px, and at most this share of the radius; while the outline is only roughly known, at least
/// the last share of it.
const REACH_PX: f64 = 3.0;
const REACH_SHARE: f64 = 0.4;
const ROUGH_SHARE: f64 = 0.12;
/// Half width of the window over which the covered length is summed: a minimum, a part that no blur changes, and a
/// part for each px of blur. What a window contains beyond the blur is other objects' light. A codec's blur is
/// estimated less well, and has its own value; so has its brightness.
const WINDOW: [f64; 3] = [1.5, -0.1, 2.2];
const CODED_WINDOW: [f64; 3] = [1.75, 0.2, 2.0];
pub(super) const LUMA_WINDOW: [f64; 3] = [1.4, 0.16, 1.6];
/// It is at most this share of the radius.
const WINDOW_SHARE: f64 = 0.45;
/// Distance from the outline up to which the brightness of a coded picture is the ball's alone.
const LUMA_CLEAR_PX: f64 = 1.75;
/// Width of the zones next to the window in which the two colours are read; a codec has one colour sample for two
/// pixels.
pub(super) const ZONE_PX: f64 = 1.5;
pub(super) const CODED_ZONE_PX: f64 = 2.25;

/// Half width of the window for a blur.
pub(super) fn window_px(blur_px: f64, [least, base, per_blur]: [f64; 3]) -> f64 {
    (base + per_blur * blur_px).max(least)
}

/// Evenly spaced rays from a centre, sampled around the outline expected on each.
pub(super) struct Rays {
    pub center_px: Vector2<f64>,
    pub direction: Vec<Vector2<f64>>,
    /// Distance of the expected outline, by ray.
    pub radius_px: Vec<f64>,
    pub mean_radius_px: f64,
    /// Half width of the window, by ray.
    pub window_px: Vec<f64>,
    /// Standard deviation of the blur across the outline, by ray.
    pub blur_px: Vec<f64>,
    /// Width of the zones next to the window.
    pub zone_px: f64,
    pub coded: bool,
    pub reach_px: f64,
    /// Places of the samples from the expected outline, outward.
    pub offsets: Vec<f64>,
    /// Light of each sample, ray by ray.
    pub colours: Vec<[f64; 3]>,
    pub luma: Vec<f64>,
    /// Whether all of a ray lies in the picture.
    pub inside: Vec<bool>,
    shade: Vec<f64>,
}

impl Rays {
    /// Casts a ray for each outline distance; `blur_px` by ray. `rough`: the outline is only roughly known.
    pub fn cast(
        patch: &Patch,
        center_px: Vector2<f64>,
        radius_px: &[f64],
        blur_px: &[f64],
        rough: bool,
    ) -> Self {
        let count = radius_px.len();
        let mean = radius_px.iter().sum::<f64>() / count as f64;
        let widest = WINDOW_SHARE * mean;
        let (kind, zone) = if patch.coded { (CODED_WINDOW, CODED_ZONE_PX) } else { (WINDOW, ZONE_PX) };
        let window: Vec<f64> = blur_px.iter().map(|b| window_px(*b, kind).min(widest)).collect();
        let largest = window.iter().copied().fold(0.0, f64::max);
        let reach = (REACH_PX.min(REACH_SHARE * mean)).max(if rough { ROUGH_SHARE * mean } else { 0.0 });
        let inner = (mean - 0.25).min(reach + largest + zone);
        let samples = ((inner + reach + largest + zone) / STEP_PX + 0.5) as usize + 1;
        let offsets: Vec<f64> = (0..samples).map(|i| -inner + STEP_PX * i as f64).collect();
        let least = radius_px.iter().copied().fold(f64::INFINITY, f64::min);
        let clear = (largest.min(widest)).min(0.6 * least);
        let luma_clear = LUMA_CLEAR_PX.min(0.6 * least);
        let shading = Shading::fit(patch, center_px, radius_px, clear, luma_clear);
        let turn = core::f64::consts::TAU / count as f64;
        let direction: Vec<Vector2<f64>> = (0..count)
            .map(|i| (turn * i as f64).sin_cos())
            .map(|(sine, cosine)| Vector2::new(cosine, sine))
            .collect();
        let mut colours = Vec::with_capacity(count * samples);
        let mut luma = Vec::with_capacity(if patch.coded { count * samples } else { 0 });
        let mut shade = Vec::with_capacity(count * samples);
        let mut inside = vec![true; count];
        let shown = |light: f64| if patch.coded { level_of(light) } else { light };
        for ray in 0..count {
            // Beyond the rim as at the rim.
            let at_rim = shown(shading.at(direction[ray]));
            for offset in &offsets {
                let at = center_px + direction[ray] * (radius_px[ray] + offset);
                let (colour, brightness, within) = patch.sample(at.x, at.y);
                colours.push(colour);
                if patch.coded {
                    luma.push(brightness);
                }
                inside[ray] &= within;
                shade.push(if *offset < 0.0 {
                    shown(shading.at(direction[ray] * (1.0 + offset / radius_px[ray])))
                } else {
                    at_rim
                });
            }
        }
        Self {
            center_px,
            direction,
            radius_px: radius_px.to_vec(),
            mean_radius_px: mean,
            window_px: window,
            blur_px: blur_px.to_vec(),
            zone_px: zone,
            coded: patch.coded,
            reach_px: reach,
            offsets,
            colours,
            luma,
            inside,
            shade,
        }
    }

    fn row(&self, ray: usize) -> core::ops::Range<usize> {
        let samples = self.offsets.len();
        ray * samples..(ray + 1) * samples
    }

    /// The samples of a ray.
    pub fn colours(&self, ray: usize) -> &[[f64; 3]] {
        &self.colours[self.row(ray)]
    }

    /// The brightness along a ray; empty where the picture is not coded.
    pub fn luma(&self, ray: usize) -> &[f64] {
        &self.luma[self.row(ray)]
    }

    /// The ball's brightness along a ray, 1 where it is typical, in the patch's values (light or levels).
    pub fn shade(&self, ray: usize) -> &[f64] {
        &self.shade[self.row(ray)]
    }

    /// Samples between two places (inclusive).
    pub fn between(&self, low: f64, high: f64) -> core::ops::Range<usize> {
        let first = self.offsets[0];
        let count = self.offsets.len() as f64;
        let begin = ((low - first) / STEP_PX - 1e-9).ceil().clamp(0.0, count);
        let end = ((high - first) / STEP_PX + 1e-9).floor() + 1.0;
        begin as usize..(end.clamp(begin, count)) as usize
    }

    /// `∫ f dt` over `edge ± window`, the samples at its ends counted in part, and how much of the window has no samples.
    pub fn integral(&self, edge: f64, window: f64, f: impl Fn(usize) -> f64) -> (f64, f64) {
        let mut sum = 0.0;
        let mut length = 0.0;
        for i in self.between(edge - window - STEP_PX, edge + window + STEP_PX) {
            let weight =
                ((window + 0.5 * STEP_PX - (self.offsets[i] - edge).abs()) / STEP_PX).clamp(0.0, 1.0);
            sum += weight * f(i) * STEP_PX;
            length += weight * STEP_PX;
        }
        (sum, 2.0 * window - length)
    }
}

/// How far an edge of the given blur (standard deviation, px) lies beyond a place, from the samples minus a step
/// there; the place's neighbourhood has most weight.
///
/// `∫ h (f − m) dt / (height ∫ h φ_σ dt)`, h a Gaussian of `taper` blurs around the place: any symmetric blur
/// leaves it unchanged, whatever its width. Light from farther away (a pane's second image, another object) has
/// little weight.
pub(super) fn beyond_step(
    rays: &Rays,
    edge: f64,
    blur_px: f64,
    taper: f64,
    more: impl Fn(usize, f64) -> f64,
) -> f64 {
    let wide = taper * blur_px;
    let (mut sum, mut gain) = (0.0, 0.0);
    for i in rays.between(edge - 3.0 * wide, edge + 3.0 * wide) {
        let t = rays.offsets[i] - edge;
        let weight = (-0.5 * (t / wide).powi(2)).exp();
        sum += weight * more(i, below_step(t / blur_px));
        gain += weight * (-0.5 * (t / blur_px).powi(2)).exp() / (blur_px * core::f64::consts::TAU.sqrt());
    }
    if gain > 0.0 { sum / gain } else { 0.0 }
}

/// Share of a step's height that is left at a place beyond it, blurred by a Gaussian of standard deviation 1: a logistic curve, within 0.0002 (Bowling et al. 2009).
fn below_step(t: f64) -> f64 {
    ((1.5976 * t + 0.07056 * t * t * t).exp() + 1.0).recip()
}

/// Mean of colours; zeros for none.
pub(super) fn mean_colour(colours: &[[f64; 3]]) -> [f64; 3] {
    let count = colours.len().max(1) as f64;
    core::array::from_fn(|channel| colours.iter().map(|c| c[channel]).sum::<f64>() / count)
}

/// Mean and variance of numbers; zeros for none.
pub(super) fn mean_and_variance(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let (mut count, mut sum) = (0.0, 0.0);
    for value in values.clone() {
        count += 1.0;
        sum += value;
    }
    let mean = sum / f64::max(count, 1.0);
    let spread: f64 = values.map(|v| (v - mean).powi(2)).sum();
    (mean, spread / f64::max(count, 1.0))
}
