//! Where the rays from a ball's centre are sampled: all that a measurement needs of an expected outline, whatever the light there.

use super::patch::{Corners, Patch};
use super::shading::Disc;
use core::ops::Range;
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

/// What a round is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Look {
    /// The outline is only roughly known.
    Rough,
    /// Another round follows: nothing of what the covariance alone needs is worked out.
    Near,
    /// The ball is to be used.
    Whole,
    /// Nothing but the centre is used.
    Centre,
}

/// Evenly spaced rays from a centre, and places on them around the outline expected on each.
pub(super) struct Sight {
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
    /// Whether all of a ray lies in the picture.
    pub inside: Vec<bool>,
    /// The pixels around each sample, ray by ray.
    pub corners: Vec<Corners>,
    /// The pixels that show the ball's light.
    pub disc: Disc,
}

impl Sight {
    /// A ray for each outline distance; `blur_px` by ray. `rough`: the outline is only roughly known.
    pub fn new(
        patch: &Patch,
        center_px: Vector2<f64>,
        radius_px: &[f64],
        blur_px: Vec<f64>,
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
        let turn = core::f64::consts::TAU / count as f64;
        let direction: Vec<Vector2<f64>> = (0..count)
            .map(|i| (turn * i as f64).sin_cos())
            .map(|(sine, cosine)| Vector2::new(cosine, sine))
            .collect();
        let mut corners = Vec::with_capacity(count * samples);
        let mut inside = Vec::with_capacity(count);
        for (direction, radius) in direction.iter().zip(radius_px) {
            let at = |offset: &f64| center_px + direction * (radius + offset);
            // What lies between two places in the patch lies there too.
            let ends = [offsets.first(), offsets.last()];
            let within = ends.into_iter().flatten().all(|offset| patch.holds(at(offset)));
            inside.push(within);
            if within {
                corners.extend(offsets.iter().map(|offset| patch.around_place_within(at(offset))));
            } else {
                corners.extend(offsets.iter().map(|offset| patch.around_place(at(offset))));
            }
        }
        Self {
            center_px,
            direction,
            radius_px: radius_px.to_vec(),
            mean_radius_px: mean,
            window_px: window,
            blur_px,
            zone_px: zone,
            coded: patch.coded,
            reach_px: reach,
            offsets,
            inside,
            corners,
            disc: Disc::within(patch, center_px, radius_px, clear, luma_clear),
        }
    }

    /// Distance of the outermost sample from the centre, px.
    pub fn outermost_px(&self) -> f64 {
        self.radius_px.iter().copied().fold(0.0, f64::max) + self.offsets.last().copied().unwrap_or(0.0)
    }

    /// Samples between two places (inclusive).
    #[inline]
    pub fn between(&self, low: f64, high: f64) -> Range<usize> {
        let (first, count) = (self.offsets[0], self.offsets.len());
        // Whole numbers by conversion: rounding a float is a call on processors of the oldest kind.
        let place = |at: f64, more: f64| (at - first) / STEP_PX + more;
        let (from, to) = (place(low, -1e-9).clamp(0.0, count as f64), place(high, 1e-9));
        let whole = from as u32;
        let begin = whole as usize + usize::from(f64::from(whole) < from);
        let end = if to >= 0.0 { to.min(count as f64) as u32 as usize + 1 } else { 0 };
        begin..end.clamp(begin, count)
    }
}
