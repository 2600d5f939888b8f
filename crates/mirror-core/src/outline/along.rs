//! The light of a ball and of its background along a ray, relative to the zones in which their colours are read.
//!
//! A codec's colours are coarse, so their zones lie some pixels from the edge. The change of light between zone and
//! edge (the end of a lamp's light on the ball, the shadow that the ball casts on what carries it) is read from the
//! brightness, which the codec keeps finer, up to where the lens has mixed the two.

use super::rays::{Rays, mean_and_variance};
use super::sight::STEP_PX;
use core::ops::Range;

/// Range of a light against that of its zone.
const BALL_RANGE: (f64, f64) = (0.3, 2.5);
const BEHIND_RANGE: (f64, f64) = (0.3, 2.0);
/// Distance from the edge, inside and outside, up to which the brightness is the ball's alone, and the background's
/// alone, px.
const BALL_CLEAR_PX: f64 = 1.8;
const BEHIND_CLEAR_PX: f64 = 1.5;
/// Least brightness of a zone.
const LEAST_BRIGHTNESS: f64 = 1e-3;

/// Light by sample of a ray, 1 where it is as in the zone. Set for one ray after the other, each time only for the samples that are read.
#[derive(Default)]
pub(super) struct Along {
    /// Of the ball; beyond the rim, as at the rim.
    pub ball: Vec<f64>,
    /// Of the background; inside of the edge, as at the edge.
    pub behind: Vec<f64>,
    /// The ball's at the rim.
    pub at_rim: f64,
    /// The background's at the edge.
    pub beside_rim: f64,
}

impl Along {
    /// By the ball's shading alone: what lies behind is even.
    pub fn by_shading(
        &mut self,
        rays: &Rays<'_>,
        ray: usize,
        edge: f64,
        ball_zone: &Range<usize>,
        read: Range<usize>,
    ) {
        let shade = rays.shade(ray);
        let rim = rim_of(rays, edge);
        let zone = mean_and_variance(shade[ball_zone.clone()].iter().copied()).0;
        let of_ball = |i: usize| in_range(shade[i] / zone, BALL_RANGE);
        self.at_rim = of_ball(rim);
        self.ball.resize(shade.len(), 1.0);
        self.behind.resize(shade.len(), 1.0);
        self.beside_rim = 1.0;
        self.behind[read.clone()].fill(1.0);
        let inner = rim.clamp(read.start, read.end);
        for i in read.start..inner {
            self.ball[i] = of_ball(i);
        }
        self.ball[inner..read.end].fill(self.at_rim);
    }

    /// By the brightness too: the shading carries the ball's over the last part to the rim.
    pub fn by_brightness(
        &mut self,
        rays: &Rays<'_>,
        ray: usize,
        edge: f64,
        [ball_zone, behind_zone]: [&Range<usize>; 2],
        read: Range<usize>,
    ) {
        let (luma, shade) = (rays.luma(ray), rays.shade(ray));
        let rim = rim_of(rays, edge);
        let of_zone = |zone: &Range<usize>| {
            mean_and_variance(luma[zone.clone()].iter().copied()).0.max(LEAST_BRIGHTNESS)
        };
        let (own, other) = (of_zone(ball_zone), of_zone(behind_zone));
        let last = rays.between(edge - BALL_CLEAR_PX, edge).start.min(rim);
        let first = rays.between(edge + BEHIND_CLEAR_PX, f64::INFINITY).start.min(luma.len() - 1);
        self.ball.resize(luma.len(), 1.0);
        self.behind.resize(luma.len(), 1.0);
        // Its own brightness up to the last clear sample, from there to the rim carried by the shading.
        let (clear, inner) = (last.clamp(read.start, read.end), rim.clamp(read.start, read.end));
        let (per_own, carried) = (own.recip(), luma[last] / (own * shade[last]));
        self.at_rim = in_range(shade[rim] * carried, BALL_RANGE);
        for (to, level) in self.ball[read.start..clear].iter_mut().zip(&luma[read.start..clear]) {
            *to = in_range(level * per_own, BALL_RANGE);
        }
        for (to, light) in self.ball[clear..inner].iter_mut().zip(&shade[clear..inner]) {
            *to = in_range(light * carried, BALL_RANGE);
        }
        self.ball[inner..read.end].fill(self.at_rim);
        // What lies behind from its first clear sample on, and inward as there.
        let per_other = other.recip();
        let begin = first.clamp(read.start, read.end);
        self.beside_rim = in_range(luma[first] * per_other, BEHIND_RANGE);
        self.behind[read.start..begin].fill(self.beside_rim);
        for (to, level) in self.behind[begin..read.end].iter_mut().zip(&luma[begin..read.end]) {
            *to = in_range(level * per_other, BEHIND_RANGE);
        }
    }
}

/// The sample at the edge.
fn rim_of(rays: &Rays<'_>, edge: f64) -> usize {
    rays.between(edge, edge + STEP_PX).start.min(rays.offsets.len() - 1)
}

fn in_range(light: f64, (least, most): (f64, f64)) -> f64 {
    light.clamp(least, most)
}
