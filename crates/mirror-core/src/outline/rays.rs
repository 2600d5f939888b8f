//! The light along rays from a ball's centre, and quantities read from it.

use super::curve::level_of;
use super::glints::take_off_glints;
use super::patch::Patch;
use super::shading::Shading;
use super::sight::{STEP_PX, Sight};
use core::ops::{Deref, Range};
use nalgebra::Vector2;
use std::borrow::Cow;
use std::sync::LazyLock;

/// The light on evenly spaced rays from a centre, around the outline expected on each.
pub(super) struct Rays<'a> {
    sight: &'a Sight,
    /// Light of each sample, ray by ray.
    colours: Vec<[f64; 3]>,
    luma: Vec<f64>,
    shade: Cow<'a, BallShade>,
}

/// The light on a ball, by sample of the rays of a sight.
#[derive(Clone)]
pub(super) struct BallShade {
    /// Ray by ray, 1 where it is typical, in the patch's values (light or levels).
    shade: Vec<f64>,
    /// As [`Shading::toward_lamp`].
    toward_lamp: Vector2<f64>,
}

impl BallShade {
    /// Of the ball in a patch that lies where the one of the sight did.
    pub fn of(patch: &Patch, sight: &Sight) -> Self {
        let shading = Shading::fit(patch, &sight.disc);
        let shown = |light: f64| if patch.coded { level_of(light) } else { light };
        let mut shade = Vec::with_capacity(sight.direction.len() * sight.offsets.len());
        for (direction, radius) in sight.direction.iter().zip(&sight.radius_px) {
            // Beyond the rim as at the rim.
            let along = shading.along(*direction);
            let inner = sight.offsets.iter().take_while(|offset| **offset < 0.0);
            let end = shade.len() + sight.offsets.len();
            shade.extend(inner.map(|offset| shown(along(1.0 + offset / radius))));
            shade.resize(end, shown(along(1.0)));
        }
        Self { shade, toward_lamp: shading.toward_lamp() }
    }
}

impl Deref for Rays<'_> {
    type Target = Sight;

    fn deref(&self) -> &Sight {
        self.sight
    }
}

impl<'a> Rays<'a> {
    /// Of a patch that lies where the one of the sight did; the light on the ball is fitted where it is not known.
    pub fn of(patch: &Patch, sight: &'a Sight, shade: Option<&'a BallShade>) -> Self {
        let shade = shade.map_or_else(|| Cow::Owned(BallShade::of(patch, sight)), Cow::Borrowed);
        let count = sight.direction.len() * sight.offsets.len();
        let mut colours = Vec::with_capacity(count);
        let mut luma = Vec::with_capacity(if patch.coded { count } else { 0 });
        for corners in &sight.corners {
            let ([blue, green, red], brightness) = patch.seen_at(corners);
            colours.push([blue, green, red]);
            if patch.coded {
                luma.push(brightness);
            }
        }
        if patch.coded {
            take_off_glints(sight, &shade.shade, &mut colours, &mut luma);
        }
        Self { sight, colours, luma, shade }
    }

    /// As [`Shading::toward_lamp`].
    pub fn toward_lamp(&self) -> Vector2<f64> {
        self.shade.toward_lamp
    }

    fn row(&self, ray: usize) -> Range<usize> {
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
        &self.shade.shade[self.row(ray)]
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

/// A blurred step at a place of a ray: what its samples count there, and how much of the step's height is left at each.
#[derive(Default)]
pub(super) struct Step {
    samples: Range<usize>,
    /// Weight, and the height left, by sample.
    rows: Vec<(f64, f64)>,
    gain: f64,
}

impl Step {
    /// How far from its place a step's samples lie, px.
    pub fn reach_px(blur_px: f64, taper: f64) -> f64 {
        3.0 * (taper * blur_px)
    }

    /// Put at an edge of the given blur (standard deviation, px); the place's neighbourhood, over `taper` blurs, has most weight.
    pub fn set(&mut self, rays: &Rays<'_>, edge: f64, blur_px: f64, taper: f64) {
        let (wide, reach) = (taper * blur_px, Self::reach_px(blur_px, taper));
        let samples = rays.between(edge - reach, edge + reach);
        let places = || rays.offsets[samples.clone()].iter().map(|offset| offset - edge);
        let first = places().next().unwrap_or(0.0);
        // Of even steps, a Gaussian's ratios have a constant ratio: two products a sample instead of two powers.
        let mut weight = Gaussian::from(first, wide.powi(-2));
        let mut under = Gaussian::from(first, wide.powi(-2) + blur_px.powi(-2));
        let mut gain = 0.0;
        let (table, per_px) = (LEFT.as_slice(), blur_px.recip());
        self.rows.clear();
        self.rows.extend(places().map(|t| {
            gain += under.next();
            (weight.next(), below_step(table, t * per_px))
        }));
        self.samples = samples;
        self.gain = gain / (blur_px * core::f64::consts::TAU.sqrt());
    }

    /// How far the edge lies beyond the place, by the samples minus a step there.
    ///
    /// `∫ h (f − m) dt / (height ∫ h φ_σ dt)`, h a Gaussian of `taper` blurs around the place: any symmetric blur
    /// leaves it unchanged, whatever its width. Light from farther away (a pane's second image, another object) has
    /// little weight.
    pub fn beyond(&self, more: impl Fn(usize, f64) -> f64) -> f64 {
        let sum: f64 =
            self.samples.clone().zip(&self.rows).map(|(i, (weight, left))| weight * more(i, *left)).sum();
        if self.gain > 0.0 { sum / self.gain } else { 0.0 }
    }
}

/// Values `exp(−a t² / 2)` at evenly spaced t.
struct Gaussian {
    value: f64,
    ratio: f64,
    change: f64,
}

impl Gaussian {
    fn from(first: f64, a: f64) -> Self {
        Self {
            value: (-0.5 * a * first * first).exp(),
            ratio: (-0.5 * a * STEP_PX * (2.0 * first + STEP_PX)).exp(),
            change: (-a * STEP_PX * STEP_PX).exp(),
        }
    }

    fn next(&mut self) -> f64 {
        let value = self.value;
        self.value *= self.ratio;
        self.ratio *= self.change;
        value
    }
}

/// Steps of the table below, and how far beyond a step it reaches on both sides, blurs.
const TABLE_STEPS: usize = 2048;
const TABLE_REACH: f64 = 4.0;
/// Share of a step's height that is left at evenly spaced places across it, blurred by a Gaussian of standard deviation 1: a logistic curve, within 0.0002 (Bowling et al. 2009).
static LEFT: LazyLock<Vec<f64>> = LazyLock::new(|| {
    let place = |i: usize| TABLE_REACH * (2.0 * i as f64 / TABLE_STEPS as f64 - 1.0);
    (0..=TABLE_STEPS).map(place).map(|t| ((1.5976 * t + 0.07056 * t * t * t).exp() + 1.0).recip()).collect()
});

/// That share at a place, within 1e-8 by three places of the table: an exponential costs some times as much, and a ball needs some ten thousand.
#[inline(always)]
fn below_step(table: &[f64], t: f64) -> f64 {
    let place = (t + TABLE_REACH).clamp(0.0, 2.0 * TABLE_REACH) * (0.5 * TABLE_STEPS as f64 / TABLE_REACH);
    // (Half as long as to 64 bits.)
    let low = (place as u32 as usize).min(TABLE_STEPS - 2);
    let (beyond, near) = (place - low as f64, &table[low..low + 3]);
    let (first, second) = (near[1] - near[0], near[2] - near[1]);
    near[0] + beyond * (first + 0.5 * (beyond - 1.0) * (second - first))
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

#[cfg(test)]
mod tests {
    use super::{LEFT, TABLE_REACH, below_step};

    #[test]
    fn a_step_by_the_table_is_the_logistic_curve_between_its_places_too() {
        for i in 0..4001 {
            let t = TABLE_REACH * (f64::from(i) / 2000.0 - 1.0);
            let wanted = ((1.5976 * t + 0.07056 * t * t * t).exp() + 1.0).recip();
            assert!((below_step(&LEFT, t) - wanted).abs() < 1e-8, "{t}");
        }
        assert!(below_step(&LEFT, -20.0) > 0.999 && below_step(&LEFT, 20.0) < 1e-3);
    }
}
