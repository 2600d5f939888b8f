//! The part of a ball's colour that its surroundings lack: the brightness of the background, and objects of a third
//! colour, do not count.

use super::patch::Patch;
use super::template::Grid;
use crate::statistics::median;
use nalgebra::{Vector2, Vector3};

/// The grid extends this far beyond the ball, px.
pub(super) const MARGIN_PX: f64 = 13.0;
/// Smallest part of a ball's colour that the background lacks, as a share of its light.
const LEAST_OWN_COLOUR: f64 = 0.15;
/// Pixels of a third colour, by their share of it against the ball's own, count less.
const THIRD_COLOUR: f64 = 0.15;

/// The ball's own colour by pixel, 1 within it and 0 around, and how much each pixel counts.
pub(super) struct OwnColour {
    pub value: Vec<f64>,
    pub weight: Vec<f64>,
}

impl OwnColour {
    pub fn of(patch: &Patch, grid: &Grid, center: Vector2<f64>, radius: f64) -> Option<Self> {
        let light: Vec<Vector3<f64>> = patch
            .pixels
            .iter()
            .map(|p| Vector3::new(f64::from(p[0]), f64::from(p[1]), f64::from(p[2])))
            .collect();
        let middle = |keep: &dyn Fn(f64) -> bool| -> Vector3<f64> {
            let kept: Vec<&Vector3<f64>> = light
                .iter()
                .enumerate()
                .filter(|(i, _)| keep((grid.place(*i) - center).norm()))
                .map(|(_, l)| l)
                .collect();
            Vector3::from_fn(|c, _| median(kept.iter().map(|l| l[c]).collect()))
        };
        let ball = middle(&|d| d < 0.5 * radius);
        let around = middle(&|d| d > radius + 0.7 * MARGIN_PX);
        let behind = around.try_normalize(1e-4).unwrap_or_else(Vector3::zeros);
        let own = ball - behind * ball.dot(&behind);
        let size = own.norm();
        if !(size > LEAST_OWN_COLOUR * ball.norm() && size > 1e-4) {
            return None;
        }
        let own = own / size;
        let third = own.cross(&behind);
        let value = light.iter().map(|l| l.dot(&own) / size).collect();
        let weight =
            light.iter().map(|l| (1.0 + (l.dot(&third) / size / THIRD_COLOUR).powi(2)).powi(-2)).collect();
        Some(Self { value, weight })
    }
}
