//! Hues of a coded picture beside a ball's outline, smoothed along it.

use super::rays::{Rays, mean_colour};
use super::sight::CODED_ZONE_PX;

/// Weights of blue, green and red in the brightness.
const BRIGHTNESS: [f64; 3] = [0.114, 0.587, 0.299];
/// Ball and what lies behind have hues of their own over about this angle, rad, on both sides.
const REACH_RAD: f64 = 1.0;

fn brightness_of(bgr: &[f64; 3]) -> f64 {
    bgr.iter().zip(BRIGHTNESS).map(|(level, weight)| level * weight).sum()
}

/// A colour of brightness 1.
#[derive(Clone, Copy)]
pub(super) struct Hue([f64; 3]);

impl Hue {
    /// A colour's brightness with this hue.
    pub fn of(&self, colour: &[f64; 3]) -> [f64; 3] {
        let brightness = brightness_of(colour);
        self.0.map(|channel| channel * brightness)
    }
}

/// Of each value of a ring the median of those up to `reach` places away: a sorted window that gives up one value and takes one at each step.
fn medians_around(ring: &[f64], reach: usize) -> Vec<f64> {
    let count = ring.len();
    let mut window: Vec<f64> = (0..=2 * reach).map(|j| ring[(count + j - reach) % count]).collect();
    window.sort_unstable_by(f64::total_cmp);
    let place = |window: &[f64], value: f64| window.partition_point(|other| other.total_cmp(&value).is_lt());
    (0..count)
        .map(|at| {
            let middle = window[reach];
            let (leaves, comes) = (ring[(at + count - reach) % count], ring[(at + reach + 1) % count]);
            let (from, to) = (place(&window, leaves), place(&window, comes));
            if to > from {
                window[from..to].rotate_left(1);
                window[to - 1] = comes;
            } else {
                window[to..=from].rotate_right(1);
                window[to] = comes;
            }
            middle
        })
        .collect()
}

/// The hues of the ball and of the background by ray, medians over neighbours: a codec's errors of colour are as
/// long as a zone, and an error of a zone's colour moves the edge by its share of the window; the brightness of
/// each zone is preserved well.
pub(super) fn hues_of_zones(rays: &Rays<'_>) -> Vec<[Hue; 2]> {
    let count = rays.radius_px.len();
    let smoothed = |zone: &dyn Fn(f64) -> (f64, f64)| -> Vec<Hue> {
        let own: Vec<[f64; 3]> = (0..count)
            .map(|ray| {
                let (low, high) = zone(rays.window_px[ray]);
                let colour = mean_colour(&rays.colours(ray)[rays.between(low, high)]);
                let brightness = brightness_of(&colour).max(1e-3);
                colour.map(|channel| channel / brightness)
            })
            .collect();
        let reach = ((REACH_RAD / core::f64::consts::TAU * count as f64) as usize).min(count / 2 - 1);
        let [blue, green, red] = [0, 1, 2].map(|channel| {
            medians_around(&own.iter().map(|colour| colour[channel]).collect::<Vec<f64>>(), reach)
        });
        (0..count).map(|ray| Hue([blue[ray], green[ray], red[ray]])).collect()
    };
    let own = smoothed(&|window| (-window - CODED_ZONE_PX, -window));
    let other = smoothed(&|window| (window, window + CODED_ZONE_PX));
    own.into_iter().zip(other).map(|(own, other)| [own, other]).collect()
}

#[cfg(test)]
mod tests {
    use super::medians_around;
    use crate::statistics::median;

    #[test]
    fn a_window_that_moves_along_a_ring_has_the_medians_of_each_window_alone() {
        let ring: Vec<f64> = (0..31).map(|i| f64::from((i * i * 7 + 3 * i) % 11)).collect();
        for reach in [0, 1, 4, 14] {
            let alone =
                |at: usize| median((0..=2 * reach).map(|j| ring[(at + 31 + j - reach) % 31]).collect());
            let wanted: Vec<f64> = (0..31).map(alone).collect();
            assert_eq!(medians_around(&ring, reach), wanted, "{reach}");
        }
    }
}
