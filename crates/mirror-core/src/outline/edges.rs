//! Sub-pixel edges of a ball's colour along rays.

use super::along::Along;
use super::blur::{Blur, blur_of_rays};
use super::channels::{Parted, Seen, deviations, parted};
use super::curve::moved_by_another_curve;
use super::hues::{Hue, hues_of_zones};
use super::luma::{lens_before_codec, lens_blur_px, luma_edges};
use super::patch::Patch;
use super::ray_edge::RayEdge;
use super::rays::{BallShade, Rays, Step, mean_and_variance, mean_colour};
use super::scatter::noise_of;
use super::sight::{Look, STEP_PX, Sight, ZONE_PX};
use super::unmixing::Unmixing;
use crate::statistics::median;
use nalgebra::Vector2;

/// Unevenness of a zone that even light and a clean picture leave, as a share of its brightness.
const SHARE_FLOOR: f64 = 0.02;
/// How much of the light's change from the zone to the rim may be wrong.
const SHADE_DOUBT: f64 = 0.18;
/// Error of an edge from pixel structure alone, px; of a coded picture's colour.
const EDGE_FLOOR_PX: f64 = 0.05;
const CODED_EDGE_FLOOR_PX: f64 = 0.07;
/// How far apart edges of colour and brightness may be, px.
const LUMA_REACH_PX: f64 = 1.0;
/// So much of the scatter of the colour's edges counts when they are joined with those of the brightness: theirs share errors of the light along the outline, which scatter does not show.
const COLOUR_NOISE_SHARE: f64 = 0.7;
/// What a coded picture's edges show as blur holds the codec's errors too: so much of it is blur, and at least so much, px. A window of more would sum up more of the errors.
const CODED_BLUR_SHARE: f64 = 0.9;
const LEAST_CODED_BLUR_PX: f64 = 0.8;
/// Width of the weights with which colours are summed about an edge, in blurs; of a coded picture.
const TAPER: f64 = 0.85;
const CODED_TAPER: f64 = 0.7;
/// Range of the zones' unevenness under these weights, in blurs.
const LEVER: f64 = 1.53;
/// Passes of setting the zones around the edge that was found.
const PASSES: usize = 3;
/// A pass moves an edge by at most so much, px.
const MOST_MOVED_PX: f64 = 1.5;

/// A channel from this light on may be cut off, and moves edges by this share of the blur.
const CLIPPED_LIGHT: f64 = 0.9;
const CLIPPED_SHARE: f64 = 0.09;
/// Where the coverage's overshoot is read, px from the edge.
const OVERSHOOT_PX: (f64, f64) = (1.0, 1.6);

/// One edge point a ray, its standard deviation along the ray (its own, the part common with its neighbours, and
/// the part common to all), and whether there is one.
pub(super) struct Edges {
    pub points_px: Vec<Vector2<f64>>,
    /// From the expected outline, px.
    pub offset_px: Vec<f64>,
    pub std_px: Vec<f64>,
    pub shared_std_px: Vec<f64>,
    /// Signed: one deviation of the camera's curve, less its mean, which does not move the centre.
    pub common_px: Vec<f64>,
    /// As [`super::shading::Shading::toward_lamp`].
    pub toward_lamp: Vector2<f64>,
    /// By how many of these deviations the channels show another curve; None where they do not determine it.
    pub curve_deviations: Option<f64>,
    /// Overshoot of the coverage, as a share of the step; 0 for none.
    pub overshoot: f64,
    pub found: Vec<bool>,
    pub blur: Blur,
    /// That of the lens alone (or of a motion), standard deviation over all directions, px: where a codec blurs the colours, by the brightness.
    pub lens_px: f64,
}

/// Edges of all rays of a sight. Where the outline is only roughly known, the colour's outermost end is taken for it.
pub(super) fn edges_on_rays(
    patch: &Patch,
    sight: &Sight,
    shade: Option<&BallShade>,
    blur: &Blur,
    look: Look,
) -> Edges {
    let count = sight.direction.len();
    let turn = core::f64::consts::TAU / count as f64;
    let rays = Rays::of(patch, sight, shade);
    let hues = (patch.coded && look != Look::Rough).then(|| hues_of_zones(&rays));
    let mut read = Read::default();
    let mut edges: Vec<RayEdge> = (0..count)
        .map(|ray| colour_edge(&rays, ray, hues.as_ref().map(|h| h[ray]), look, &mut read))
        .collect();
    for (ray, edge) in edges.iter_mut().enumerate() {
        edge.found &= rays.inside[ray] && edge.offset.abs() < rays.reach_px && edge.offset.is_finite();
        let floor = if patch.coded { CODED_EDGE_FLOOR_PX } else { EDGE_FLOOR_PX };
        edge.std = floor.hypot(edge.std);
    }
    let lens_px = if patch.coded { lens_blur_px(&rays, &edges) } else { 0.0 };
    let shown = match look {
        Look::Centre => *blur,
        _ if patch.coded => blur_of_rays(&edges, blur).scaled(CODED_BLUR_SHARE, LEAST_CODED_BLUR_PX),
        _ => blur_of_rays(&edges, blur),
    };
    // A blur along the outline carries a bent one inward: by σ² / 2r.
    for (ray, edge) in edges.iter_mut().enumerate() {
        let across =
            blur.along(turn * ray as f64 + core::f64::consts::FRAC_PI_2).min(0.5 * rays.radius_px[ray]);
        edge.offset += 0.5 * across * across / rays.radius_px[ray];
    }
    if patch.coded {
        join_brightness(&rays, &mut edges, lens_px);
    }
    // Only light has a curve, and only then it is read.
    let by_curve = !patch.coded && look == Look::Whole;
    let points = edges
        .iter()
        .enumerate()
        .map(|(ray, edge)| rays.center_px + rays.direction[ray] * (rays.radius_px[ray] + edge.offset))
        .collect();
    Edges {
        points_px: points,
        offset_px: edges.iter().map(|e| e.offset).collect(),
        shared_std_px: edges
            .iter()
            .zip(&sight.blur_px)
            .map(|(e, blur)| if e.clipped { CLIPPED_SHARE * blur } else { 0.0 })
            .collect(),
        common_px: if by_curve { common_px(&edges) } else { vec![0.0; count] },
        toward_lamp: rays.toward_lamp(),
        curve_deviations: if by_curve {
            deviations(edges.iter().filter(|e| e.found).map(|e| e.parted))
        } else {
            None
        },
        overshoot: if by_curve { overshoot(&edges) } else { 0.0 },
        std_px: edges.iter().map(|e| e.std).collect(),
        found: edges.iter().map(|e| e.found).collect(),
        blur: shown,
        lens_px: if patch.coded { lens_px } else { shown.mean_px() },
    }
}

/// What one deviation of the camera's curve does to edges, less its mean over them.
fn common_px(edges: &[RayEdge]) -> Vec<f64> {
    let found = || edges.iter().filter(|e| e.found);
    let mean = found().map(|e| e.by_curve).sum::<f64>() / found().count().max(1) as f64;
    edges.iter().map(|e| if e.found { e.by_curve - mean } else { 0.0 }).collect()
}

/// What most edges overshoot by, on the side where it is more.
fn overshoot(edges: &[RayEdge]) -> f64 {
    let side = |k: usize| median(edges.iter().filter(|e| e.found).map(|e| e.overshoot[k]).collect());
    side(0).max(side(1)).max(0.0)
}

/// The brightness has the picture's full resolution: where ball and background differ in it, it locates the edge
/// better.
fn join_brightness(rays: &Rays<'_>, edges: &mut [RayEdge], lens_px: f64) {
    for edge in edges.iter_mut() {
        edge.offset -= lens_before_codec(edge, lens_px);
    }
    let mut sharp = luma_edges(rays, edges, lens_px);
    let colour_noise = noise_of(rays, edges.iter().map(|e| (e.offset, e.contrast, e.found)));
    let luma_noise = noise_of(
        rays,
        edges.iter().zip(&sharp).map(|(e, s)| (s.offset, s.contrast, e.found && s.std_px.is_finite())),
    );
    // Another object in front of the ball may differ more from it than the background: its edges must not have more
    // weight than the outline's.
    let usual = median(edges.iter().filter(|e| e.found).map(|e| e.contrast).collect());
    let usual_luma = median(sharp.iter().filter(|s| s.std_px.is_finite()).map(|s| s.contrast).collect());
    for (edge, sharp) in edges.iter_mut().zip(&mut sharp) {
        edge.std =
            edge.std.hypot(COLOUR_NOISE_SHARE * colour_noise / edge.contrast.clamp(1e-6, usual.max(1e-6)));
        sharp.std_px = sharp.std_px.hypot(luma_noise / sharp.contrast.clamp(1e-6, usual_luma.max(1e-6)));
        let agrees = (sharp.offset - edge.offset).abs() < LUMA_REACH_PX.max(2.0 * edge.std);
        let weight = if agrees { (edge.std / sharp.std_px).powi(2) } else { 0.0 };
        edge.offset = (edge.offset + weight * sharp.offset) / (1.0 + weight);
        edge.std /= (1.0 + weight).sqrt();
    }
}

/// What is read of a ray by sample; kept from ray to ray, for each would be as long.
#[derive(Default)]
struct Read {
    light: Along,
    /// Of the ball and of what lies behind in the colour.
    parts: Vec<(f64, f64)>,
    step: Step,
}

fn colour_edge(rays: &Rays<'_>, ray: usize, hues: Option<[Hue; 2]>, look: Look, read: &mut Read) -> RayEdge {
    let none = RayEdge {
        offset: 0.0,
        std: 1.0,
        found: false,
        by_curve: 0.0,
        parted: Parted::default(),
        clipped: false,
        overshoot: [0.0; 2],
        moment: 0.0,
        contrast: 0.0,
        channels: [0.0; 3],
        ball: [0.0; 3],
        behind: [0.0; 3],
        at_rim: 1.0,
        beside_rim: 1.0,
    };
    let (window, blur) = (rays.window_px[ray], rays.blur_px[ray]);
    let (taper, lever) = if rays.coded { (CODED_TAPER, window) } else { (TAPER, LEVER * blur) };
    let colours = rays.colours(ray);
    // From where on a sample says nothing of an edge: beyond the zones, the step and the overshoot.
    let reach = (window + rays.zone_px.max(ZONE_PX) + STEP_PX)
        .max(Step::reach_px(blur, taper))
        .max(MOST_MOVED_PX + OVERSHOOT_PX.1);
    read.parts.resize(colours.len(), (0.0, 0.0));
    let mut result = none;
    for pass in 0..PASSES {
        let edge = result.offset;
        let ball_zone = rays.between(edge - window - rays.zone_px, edge - window);
        let behind_zone = rays.between(edge + window, edge + window + rays.zone_px);
        if ball_zone.is_empty() || behind_zone.is_empty() {
            return none;
        }
        let (ball, behind) =
            (mean_colour(&colours[ball_zone.clone()]), mean_colour(&colours[behind_zone.clone()]));
        let (ball, behind) = match hues {
            Some([own, other]) => (own.of(&ball), other.of(&behind)),
            None => (ball, behind),
        };
        let Some(unmixing) = Unmixing::new(ball, behind) else { return none };
        let near = if pass == 0 { 0..colours.len() } else { rays.between(edge - reach, edge + reach) };
        if rays.coded && pass > 0 {
            read.light.by_brightness(rays, ray, edge, [&ball_zone, &behind_zone], near.clone());
        } else {
            read.light.by_shading(rays, ray, edge, &ball_zone, near.clone());
        }
        for (parts, colour) in read.parts[near.clone()].iter_mut().zip(&colours[near]) {
            *parts = unmixing.parts(colour);
        }
        let Read { light, parts, step } = read;
        let (light, parts) = (&*light, &*parts);
        let (carried, at_rim) = (|i: usize| light.ball[i], light.at_rim);
        let (_, uneven_ball) = mean_and_variance(ball_zone.clone().map(|i| parts[i].0 / carried(i)));
        let (_, uneven_behind) = mean_and_variance(behind_zone.clone().map(|i| parts[i].1));
        let doubt = SHADE_DOUBT * (1.0 - at_rim);
        let variance_ball = uneven_ball + SHARE_FLOOR * SHARE_FLOOR + doubt * doubt;
        let variance_behind = if unmixing.black { 1e6 } else { uneven_behind + SHARE_FLOOR * SHARE_FLOOR };
        let trust = variance_behind / (variance_ball + variance_behind);
        let coverage = |i: usize| {
            let (s, w) = parts[i];
            (trust * s / carried(i) + (1.0 - trust) * (1.0 - w)).clamp(-0.5, 1.5)
        };
        if pass == 0 {
            result.offset = crossing(rays, coverage, look == Look::Rough);
            continue;
        }
        // What the ball's parts sum to must be the integral of its light up to the edge; what the background's parts sum to, its length.
        let ball_sum = |i: usize| trust * parts[i].0 + (1.0 - trust) * (1.0 - parts[i].1).clamp(-0.5, 1.5);
        let expected = |i: usize| trust * carried(i) + (1.0 - trust);
        let darker = |i: usize| (1.0 - trust) * (light.behind[i] - 1.0);
        step.set(rays, edge, blur, taper);
        let more = step.beyond(|i, left| ball_sum(i) - expected(i) * left + darker(i) * (1.0 - left));
        let at_edge = trust * at_rim + (1.0 - trust);
        result.offset = edge + (more / at_edge).clamp(-MOST_MOVED_PX, MOST_MOVED_PX);
        if pass + 1 < PASSES {
            continue;
        }
        result.std = lever * (variance_ball * variance_behind / (variance_ball + variance_behind)).sqrt();
        result.found = true;
        result.contrast = unmixing.contrast(trust);
        result.channels = unmixing.channels(trust);
        result.ball = ball;
        result.behind = behind;
        result.at_rim = at_rim;
        result.beside_rim = light.beside_rim;
        if !rays.coded && look == Look::Whole {
            let rim_colour = ball.map(|light| light * at_rim);
            let moved = moved_by_another_curve(&rim_colour, &behind);
            result.by_curve =
                blur * moved.iter().zip(&result.channels).map(|(m, part)| m * part).sum::<f64>();
            let seen = Seen { step, carried: &light.ball, at_rim, ball, behind, moved };
            result.parted = parted(rays, ray, &seen);
            result.clipped =
                rim_colour.iter().chain(&ball).chain(&behind).any(|light| *light > CLIPPED_LIGHT);
            let mean_of = |low: f64, high: f64| {
                mean_and_variance(rays.between(result.offset + low, result.offset + high).map(coverage)).0
            };
            let (near, far) = OVERSHOOT_PX;
            result.overshoot = [mean_of(-far, -near) - 1.0, -mean_of(near, far)];
        }
        if look != Look::Centre {
            let (moment, _) = rays.integral(edge, window + ZONE_PX, |i| {
                let t = rays.offsets[i] - result.offset;
                let beyond = if t > 0.0 { coverage(i) } else { 1.0 - coverage(i) };
                2.0 * beyond * t.abs()
            });
            result.moment = moment;
        }
    }
    result
}

/// Where the coverage falls through one half: the outermost place, or the one nearest to the expected outline.
fn crossing(rays: &Rays<'_>, coverage: impl Fn(usize) -> f64, outermost: bool) -> f64 {
    let values: Vec<f64> = (0..rays.offsets.len()).map(coverage).collect();
    let mut best: Option<f64> = None;
    for i in 0..values.len() - 1 {
        if values[i] > 0.5 && values[i + 1] <= 0.5 {
            let at = rays.offsets[i] + STEP_PX * (values[i] - 0.5) / (values[i] - values[i + 1]);
            if outermost || best.is_none_or(|b| at.abs() < b.abs()) {
                best = Some(at);
            }
        }
    }
    best.unwrap_or(0.0).clamp(-rays.reach_px, rays.reach_px)
}
