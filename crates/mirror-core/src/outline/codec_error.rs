//! What a coarse codec's errors do to a ball's centre, sampled: its surroundings are coded once more and measured again.
//!
//! A JPEG rounds the coefficients of its blocks. A block of colour is as large as a ball, so one rounding moves the edges of a whole side of the ball alike:
//! their scatter around the outline does not show that. The decoded picture, coded again with the file's own steps on a grid of blocks that is moved, has errors
//! of the same kind and size, but others; how far they move the centre is known. The same shifts average out such errors in pictures (Nosratinia, "Enhancement of
//! JPEG-compressed images by re-application of JPEG", 2001).

use super::ball::{Aim, RadiusRange};
use super::circle::Circle;
use super::patch::{Patch, Picture, Place};
use super::rays::BallShade;
use super::recoding::Codec;
use super::sight::Look;
use super::surroundings::Surroundings;
use crate::camera::Camera;
use nalgebra::{Matrix2, Vector2};

/// Shifts against the grid, samples of colour across and down: each way none twice. Three more give the same claims.
const SHIFTS: [(usize, usize); 4] = [(1, 3), (3, 1), (5, 7), (7, 5)];
/// Beyond its outline a measurement reads so much of a ball's surroundings, px: how far the edge is searched, the window of the most blur and the colours' zones.
const READ_PX: f64 = 12.0;
/// Beyond the last sample of a ray: a pixel's colour is interpolated between samples that are two apart, and both colour and brightness again in the patch.
const INTERPOLATED_PX: f64 = 3.0;
/// The part of the sampled variance that the edges' scatter does not hold already. Measured on balls of 7 to 13 px at JPEG qualities 20 to 85.
const UNSEEN_SHARE: f64 = 0.4;
/// So much of a covariance of a few samples is taken for round.
const ROUND_SHARE: f64 = 0.5;
/// A sample in which the ball is lost counts as so many of the others' mean squares.
const LOST_SQUARES: f64 = 3.0;
/// Fewer samples tell no variance.
const LEAST_SAMPLES: usize = 2;

/// The covariance (px²) that the rounding of a file's codec adds to the centre of a ball that was found at a circle; None where hardly any sample shows the ball.
/// `blur_px` is the one that the ball showed (standard deviation), where it was the same in all directions.
///
/// `share · Σ (c_i − c)(c_i − c)ᵀ / n`, c the centre in the picture, c_i in each of n recoded ones. Where the blur is not told, one round from the circle shows it; from there the
/// picture and the recoded ones are measured alike, in one round each: the samples differ from it by little. The light on the ball is the same in all.
pub fn codec_covariance(
    picture: &Picture<'_>,
    start: &Circle,
    range: &RadiusRange,
    camera: &Camera,
    codec: &Codec,
    blur_px: Option<f64>,
) -> Option<Matrix2<f64>> {
    let reach_px = start.radius_px + READ_PX;
    if !(reach_px.is_finite() && start.center_px.iter().all(|v| v.is_finite())) {
        return None;
    }
    let place = Place::within(picture, &start.center_px, reach_px)?;
    let patch = Patch::of(place.levels(picture), &place, picture);
    let aim = Aim::at(start, picture, camera)?.sparse();
    let aim = match blur_px {
        Some(std_px) => aim.blurred(std_px),
        None => aim.measured(&patch, range, camera, Look::Near)?.1,
    };
    let sight = aim.sight(&patch, Look::Near);
    let shade = BallShade::of(&patch, &sight);
    let center_in = |patch: &Patch| {
        let (ball, _) = aim.measured_on(&sight, Some(&shade), patch, range, camera, Look::Centre)?;
        range.holds(&ball).then_some(ball.cone.centroid_px)
    };
    let center_px = center_in(&patch)?;
    let (across, down) = codec.sampling();
    let coded_px = sight.outermost_px() + INTERPOLATED_PX;
    let surroundings = Surroundings::of(codec, picture, &place, &sight.center_px, coded_px.min(reach_px));
    let moved: Vec<Vector2<f64>> = SHIFTS
        .iter()
        .filter_map(|(u, v)| {
            let levels = surroundings.again((u * across, v * down));
            Some(center_in(&Patch::of(levels, &place, picture))? - center_px)
        })
        .collect();
    variance(&moved, SHIFTS.len()).map(|square| square * UNSEEN_SHARE)
}

/// Mean square around zero of those of so many displacements that are known, px².
fn variance(moved: &[Vector2<f64>], tried: usize) -> Option<Matrix2<f64>> {
    if moved.len() < LEAST_SAMPLES {
        return None;
    }
    let lost = 1.0 - moved.len() as f64 / tried as f64;
    let square = moved.iter().map(|m| m * m.transpose()).sum::<Matrix2<f64>>() / moved.len() as f64
        * (1.0 + (LOST_SQUARES - 1.0) * lost);
    Some(square * (1.0 - ROUND_SHARE) + Matrix2::identity() * (ROUND_SHARE * 0.5 * square.trace()))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_variance_is_the_mean_square_partly_round_and_larger_where_samples_are_lost() {
        let moved = [Vector2::new(0.2, 0.0), Vector2::new(-0.2, 0.0)];
        let whole = variance(&moved, 2).unwrap();
        assert!((whole.trace() - 0.04).abs() < 1e-12);
        assert!((whole[(0, 0)] - 3.0 * whole[(1, 1)]).abs() < 1e-12);
        assert!((variance(&moved, 4).unwrap() - whole * 2.0).norm() < 1e-12);
        assert!(variance(&moved[..1], 4).is_none());
    }
}
