//! Edges of the brightness in pictures whose codec blurs the colours, and what the lens did before the codec.

use super::ray_edge::{MIN_EDGE_POINTS, RayEdge};
use super::rays::{Rays, STEP_PX, ZONE_PX, mean_and_variance, median, window_px};
use super::shading::ENCODING_POWER;

/// The lens' blur where no ray shows it, and what bilinear sampling adds, px; least contrast of brightness (0..1) that shows it.
const USUAL_LENS_PX: f64 = 0.5;
const SAMPLING_BLUR_PX: f64 = 0.32;
const MIN_CONTRAST: f64 = 0.1;
/// How much of the blur that the brightness shows is the lens'; the rest is the codec's own. Measured on JPEG of quality 75 and 92.
const LENS_SHARE: f64 = 0.5;
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
}

fn mean_in(rays: &Rays, values: &[f64], low: f64, high: f64) -> (f64, f64) {
    mean_and_variance(values[rays.between(low, high)].iter().copied())
}

/// Standard deviation of the blur that the brightness shows, px: an edge of contrast c blurred by a Gaussian is `c / (σ √2π)` steep.
pub(super) fn lens_blur_px(rays: &Rays, edges: &[RayEdge]) -> f64 {
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

/// Level that half of the light of both colours has, by channel.
fn half_level(ball: &[f64; 3], behind: &[f64; 3]) -> [f64; 3] {
    core::array::from_fn(|c| {
        let light = |level: f64| level.clamp(0.0, 1.0).powf(ENCODING_POWER);
        (0.5 * (light(ball[c]) + light(behind[c]))).powf(ENCODING_POWER.recip())
    })
}

/// How far the lens' own blur, which mixes linear light, moves the covered length that is summed in levels, px.
///
/// With g(w) the share that levels show at the share w, close to a parabola with `g(1/2) = 1/2 + b/4`:
/// `∫ g(Φ(-t/σ)) − Φ(-t/σ) dt = b σ / √π`.
pub(super) fn lens_before_codec(edge: &RayEdge, lens_px: f64) -> f64 {
    let half = half_level(&edge.ball, &edge.behind);
    let (mut along, mut power) = (0.0, 1e-6);
    for c in 0..3 {
        let contrast = edge.ball[c] - edge.behind[c];
        along += (half[c] - edge.behind[c]) * contrast;
        power += contrast * contrast;
    }
    4.0 * (along / power - 0.5) * lens_px / core::f64::consts::PI.sqrt()
}

/// Edges of the brightness near those of the colour.
pub(super) fn luma_edges(rays: &Rays, edges: &[RayEdge], lens_px: f64) -> Vec<LumaEdge> {
    let window = window_px(lens_px).min(0.45 * rays.mean_radius_px);
    edges.iter().enumerate().map(|(ray, edge)| luma_edge(rays, ray, edge, lens_px, window)).collect()
}

fn luma_edge(rays: &Rays, ray: usize, colour: &RayEdge, lens_px: f64, window: f64) -> LumaEdge {
    let none = LumaEdge { offset: colour.offset, std_px: f64::INFINITY };
    if !colour.found {
        return none;
    }
    let (values, shade) = (rays.luma(ray), rays.shade(ray));
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
        if !(contrast.abs() > MIN_CONTRAST) {
            return none;
        }
        let (covered, _) = rays.integral(edge, window, |i| (values[i] - behind) / contrast);
        let mut model = 0.0;
        for i in rays.between(edge - window - STEP_PX, edge + STEP_PX) {
            let (low, high) = (rays.offsets[i] - 0.5 * STEP_PX, rays.offsets[i] + 0.5 * STEP_PX);
            let length = (high.min(edge) - low.max(edge - window)).max(0.0);
            model += length * (own * carried(i) - behind) / contrast;
        }
        let doubt = SHADE_DOUBT * own * (1.0 - carried(rim)) / contrast;
        let uneven = (uneven_ball + uneven_behind) / (contrast * contrast) + doubt * doubt;
        found.offset = edge + (covered - model).clamp(-1.5, 1.5);
        found.std_px = EDGE_FLOOR_PX.hypot(0.5 * window * uneven.sqrt());
    }
    // What the lens does before the codec, as in the colours.
    let half = half_level(&colour.ball, &colour.behind);
    let luma = |c: &[f64; 3]| c.iter().zip(WEIGHTS).map(|(v, w)| v * w).sum::<f64>();
    let contrast = luma(&colour.ball) - luma(&colour.behind);
    if contrast.abs() > 0.5 * MIN_CONTRAST {
        let bend = ((luma(&half) - luma(&colour.behind)) / contrast - 0.5).clamp(-0.4, 0.4);
        found.offset -= LENS_SHARE * 4.0 * bend * lens_px / core::f64::consts::PI.sqrt();
    }
    found
}
