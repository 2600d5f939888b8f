//! Edges of the brightness in pictures whose codec blurs the colours, and what the lens did before the codec.

use super::curve::{level_of, light_of, moved_by_light};
use super::ray_edge::{MIN_EDGE_POINTS, RayEdge};
use super::rays::{Rays, Step, mean_and_variance};
use super::sight::{LUMA_WINDOW, STEP_PX, ZONE_PX, window_px};
use crate::statistics::median;

/// The lens' blur where no ray shows it, and what bilinear sampling adds, px; least contrast of brightness (0..1) that shows it.
const USUAL_LENS_PX: f64 = 0.5;
const SAMPLING_BLUR_PX: f64 = 0.32;
const MIN_CONTRAST: f64 = 0.06;
/// Least contrast of an edge of the brightness: below, the codec's own steps are as large.
const MIN_EDGE_CONTRAST: f64 = 0.1;
/// The share of the brightness's blur that precedes the codec's curve; the rest is the codec's.
const LENS_SHARE: f64 = 0.9;
/// Width of the weights with which the brightness is summed around an edge, in blurs.
const TAPER: f64 = 1.0;
/// Steps of the curve from a share of light to its brightness, and the range of its slope beyond the two colours.
const CURVE_STEPS: usize = 16;
const END_SLOPE: (f64, f64) = (0.4, 2.5);
/// Errors of edges in the brightness, px.
const EDGE_FLOOR_PX: f64 = 0.08;
/// How much of the light's change from the zone to the rim may be wrong.
const SHADE_DOUBT: f64 = 0.25;
const PASSES: usize = 3;
/// Weights of blue, green and red in the brightness.
const WEIGHTS: [f64; 3] = [0.114, 0.587, 0.299];

/// An edge of the brightness: offset and standard deviation, px; infinite where there is no contrast.
#[derive(Clone, Copy)]
pub(super) struct LumaEdge {
    pub offset: f64,
    pub std_px: f64,
    /// Difference of the two brightnesses, 0..1.
    pub contrast: f64,
}

fn mean_in(rays: &Rays<'_>, values: &[f64], low: f64, high: f64) -> (f64, f64) {
    mean_and_variance(values[rays.between(low, high)].iter().copied())
}

/// Standard deviation of the blur that the brightness shows, px: an edge of contrast c blurred by a Gaussian is `c / (σ √2π)` steep.
pub(super) fn lens_blur_px(rays: &Rays<'_>, edges: &[RayEdge]) -> f64 {
    let mut shown = Vec::new();
    for (ray, edge) in edges.iter().enumerate().filter(|(_, e)| e.found) {
        let (values, window) = (rays.luma(ray), rays.window_px[ray]);
        let ball = mean_in(rays, values, edge.offset - window - ZONE_PX, edge.offset - window).0;
        let behind = mean_in(rays, values, edge.offset + window, edge.offset + window + ZONE_PX).0;
        let contrast = (ball - behind).abs();
        if contrast > MIN_CONTRAST {
            let near = rays.between(edge.offset - 1.5, edge.offset + 1.5);
            let steepest =
                values[near].windows(2).map(|pair| (pair[1] - pair[0]).abs() / STEP_PX).fold(1e-3, f64::max);
            shown.push(contrast / steepest);
        }
    }
    if shown.len() < MIN_EDGE_POINTS {
        return USUAL_LENS_PX;
    }
    let wide = median(shown) / core::f64::consts::TAU.sqrt();
    // Bilinear sampling widens an edge by itself.
    (wide * wide - SAMPLING_BLUR_PX * SAMPLING_BLUR_PX).clamp(0.04, 4.0).sqrt()
}

/// How far the lens' own blur, which mixes linear light, moves the covered length that is summed in levels, px.
pub(super) fn lens_before_codec(edge: &RayEdge, lens_px: f64) -> f64 {
    LENS_SHARE * lens_px * moved_by_light(&edge.rim(), &edge.beside(), &edge.channels)
}

/// From the brightness between two colours to the share of the first's light: light mixes before it is encoded.
struct Curve {
    /// The brightness at even steps of the share.
    brightness: [f64; CURVE_STEPS + 1],
    /// Share for each brightness, from each step on.
    slope: [f64; CURVE_STEPS],
}

impl Curve {
    /// None where the brightness between the colours does not rise all the way.
    fn new(ball: &[f64; 3], behind: &[f64; 3]) -> Option<Self> {
        let light = |c: &[f64; 3]| c.map(light_of);
        let (own, other) = (light(ball), light(behind));
        let at = |share: f64| -> f64 {
            (0..3).map(|c| WEIGHTS[c] * level_of(share * own[c] + (1.0 - share) * other[c])).sum()
        };
        let (low, high) = (at(0.0), at(1.0));
        let brightness: [f64; CURVE_STEPS + 1] =
            core::array::from_fn(|i| (at(i as f64 / CURVE_STEPS as f64) - low) / (high - low));
        let step = 1.0 / CURVE_STEPS as f64;
        let slope = core::array::from_fn(|i| step / (brightness[i + 1] - brightness[i]));
        brightness.windows(2).all(|pair| pair[1] > pair[0] + 1e-4).then_some(Self { brightness, slope })
    }

    /// The share at a brightness, 0 and 1 at the two colours'.
    #[inline]
    fn share(&self, brightness: f64) -> f64 {
        let end = |at: usize| self.slope[at].clamp(END_SLOPE.0, END_SLOPE.1);
        if brightness <= 0.0 {
            return brightness * end(0);
        }
        if brightness >= 1.0 {
            return 1.0 + (brightness - 1.0) * end(CURVE_STEPS - 1);
        }
        let below = self.brightness[1..CURVE_STEPS].partition_point(|b| *b <= brightness);
        below as f64 / CURVE_STEPS as f64 + (brightness - self.brightness[below]) * self.slope[below]
    }
}

/// Edges of the brightness near those of the colour.
pub(super) fn luma_edges(rays: &Rays<'_>, edges: &[RayEdge], lens_px: f64) -> Vec<LumaEdge> {
    let window = window_px(lens_px, LUMA_WINDOW).min(0.45 * rays.mean_radius_px);
    let mut step = Step::default();
    edges
        .iter()
        .enumerate()
        .map(|(ray, edge)| luma_edge(rays, ray, edge, window, lens_px, &mut step))
        .collect()
}

/// Of one ray; `step` is overwritten.
fn luma_edge(
    rays: &Rays<'_>,
    ray: usize,
    colour: &RayEdge,
    window: f64,
    lens_px: f64,
    step: &mut Step,
) -> LumaEdge {
    let none = LumaEdge { offset: colour.offset, std_px: f64::INFINITY, contrast: 0.0 };
    if !colour.found {
        return none;
    }
    let Some(curve) = Curve::new(&colour.rim(), &colour.behind) else { return none };
    let (values, shade) = (rays.luma(ray), rays.shade(ray));
    let blur = lens_px.hypot(SAMPLING_BLUR_PX);
    let mut found = none;
    let limit = rays.offsets.len() - 1;
    for _ in 0..PASSES {
        let edge = found.offset.clamp(-rays.reach_px, rays.reach_px);
        let zone = rays.between(edge - window - ZONE_PX, edge - window);
        if zone.is_empty() {
            return none;
        }
        let zone_shade = mean_and_variance(shade[zone.clone()].iter().copied()).0;
        let rim = rays.between(edge, edge + STEP_PX).start.min(limit);
        let carried = |i: usize| (shade[i.min(rim)] / zone_shade).clamp(0.5, 1.6);
        let (own, uneven_ball) = mean_and_variance(zone.clone().map(|i| values[i] / carried(i)));
        let (behind, uneven_behind) = mean_in(rays, values, edge + window, edge + window + ZONE_PX);
        let contrast = own * carried(rim) - behind;
        if !(contrast.abs() > MIN_EDGE_CONTRAST) {
            return none;
        }
        let per_contrast = contrast.recip();
        let of_ball = |i: usize| curve.share((own * carried(i) - behind) * per_contrast);
        let at_rim = of_ball(rim);
        step.set(rays, edge, blur, TAPER);
        let more = step.beyond(|i, left| {
            let ball = if i < rim { of_ball(i) } else { at_rim };
            curve.share((values[i] - behind) * per_contrast) - ball * left
        });
        let doubt = SHADE_DOUBT * own * (1.0 - carried(rim)) / contrast;
        let uneven = (uneven_ball + uneven_behind) / (contrast * contrast) + doubt * doubt;
        found.offset = edge + more.clamp(-1.5, 1.5);
        found.contrast = contrast.abs();
        found.std_px = EDGE_FLOOR_PX.hypot(0.5 * window * uneven.sqrt());
    }
    found
}
