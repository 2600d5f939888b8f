//! The camera's tone curve, estimated from the three channels of a picture.
//!
//! A blur mixes light. If the curve from levels to light is wrong, the edge of a channel moves in proportion to the
//! difference of its two values. Red may rise where green falls; the channels of one edge then lie apart, by an
//! amount and in a direction that the colours determine. This needs no other ball and no model of the robot.

use super::rays::{Rays, Step};

/// Smallest difference of light at which a channel determines an edge.
const LEAST_STEP: f64 = 0.04;
/// ... where neither light is cut off.
const MOST_LIGHT: f64 = 0.9;
/// Fewest rays (by their weights) that determine a curve.
const LEAST_RAYS: f64 = 8.0;

/// The separation of an edge's channels against the separation that another curve would cause: product and square,
/// weighted and summed.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Parted {
    pub product: f64,
    pub square: f64,
}

/// An edge for the channels: a step there, the ball's light along the ray and at the rim, and the two colours.
pub(super) struct Seen<'a> {
    pub step: &'a Step,
    pub carried: &'a [f64],
    pub at_rim: f64,
    pub ball: [f64; 3],
    pub behind: [f64; 3],
    /// How far another curve moves the edge of each channel, in blurs.
    pub moved: [f64; 3],
}

/// Of one ray, for one deviation of the curve.
pub(super) fn parted(rays: &Rays<'_>, ray: usize, seen: &Seen<'_>) -> Parted {
    let (colours, blur) = (rays.colours(ray), rays.blur_px[ray]);
    let mut rows = [(0.0, 0.0, 0.0); 3];
    for (channel, row) in rows.iter_mut().enumerate() {
        let (ball, behind) = (seen.ball[channel], seen.behind[channel]);
        let step = ball * seen.at_rim - behind;
        if step.abs() < LEAST_STEP || ball.max(behind) > MOST_LIGHT {
            continue;
        }
        let beyond = seen.step.beyond(|i, left| {
            let covered = ((colours[i][channel] - behind) / step).clamp(-0.5, 1.5);
            covered - (ball * seen.carried[i] - behind) / step * left
        });
        *row = (step.abs(), beyond, blur * seen.moved[channel]);
    }
    let total: f64 = rows.iter().map(|r| r.0).sum();
    if rows.iter().filter(|r| r.0 > 0.0).count() < 2 {
        return Parted::default();
    }
    let place = rows.iter().map(|r| r.0 * r.1).sum::<f64>() / total;
    let moved = rows.iter().map(|r| r.0 * r.2).sum::<f64>() / total;
    Parted {
        product: rows.iter().map(|r| r.0 * (r.1 - place) * (r.2 - moved)).sum(),
        square: rows.iter().map(|r| r.0 * (r.2 - moved).powi(2)).sum(),
    }
}

/// By how many deviations the curve differs, by the weighted median of the rays; None with too few rays.
pub(super) fn deviations(parted: impl Iterator<Item = Parted>) -> Option<f64> {
    let mut slopes: Vec<(f64, f64)> =
        parted.filter(|p| p.square > 1e-9).map(|p| (p.product / p.square, p.square)).collect();
    let total: f64 = slopes.iter().map(|s| s.1).sum();
    let squares: f64 = slopes.iter().map(|s| s.1 * s.1).sum();
    if total * total < LEAST_RAYS * squares || slopes.is_empty() {
        return None;
    }
    slopes.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut sum = 0.0;
    slopes
        .iter()
        .find(|slope| {
            sum += slope.1;
            sum >= 0.5 * total
        })
        .map(|slope| slope.0)
        .filter(|d| d.is_finite())
}
