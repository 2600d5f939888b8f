//! The truth of a picture: exact pixels, found by searching over traced beams, and visible shares.

use super::scene::Scene;
use super::{Beam, Eye};
use nalgebra::{Matrix2, Vector2, Vector3};

/// Which way the eye sees a thing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Via {
    Mirror,
    Direct,
}

/// The search starts in the picture's middle and gives up after this many steps; a dozen suffice.
const SEARCH_STEPS: usize = 60;
/// It is done when the beam passes the point within this distance, m.
const PASSING_DISTANCE_M: f64 = 1e-12;
/// Step of the numerical derivative, px.
const DERIVATIVE_STEP_PX: f64 = 0.01;
/// Longest step, px.
const LONGEST_STEP_PX: f64 = 200.0;
/// How far outside the picture (share of its size) a pixel is still sought.
const SEARCH_MARGIN: f64 = 0.3;
/// A point hidden by less than this, m, is its own surface.
const OWN_SURFACE_M: f64 = 3e-4;
/// Distance of the places at which a ball's picture is probed, px.
const PROBE_PX: f64 = 0.25;

/// A corner of the board in the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CornerTruth {
    /// Its exact pixel by way of the mirror; none where no beam of the picture's surroundings reaches it.
    pub pixel: Option<Vector2<f64>>,
    /// Whether it lies in the picture with nothing before it.
    pub is_visible: bool,
}

/// A ball as seen one way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViaTruth {
    /// Pixel of the beam through the ball's centre (not the centre of its outline).
    pub center_px: Vector2<f64>,
    /// Whether that pixel lies in the picture.
    pub in_image: bool,
    /// Centre of area of its whole outline, as if nothing stood before it, px.
    pub outline_px: Vector2<f64>,
    /// Area of its whole outline, px².
    pub outline_area_px2: f64,
    /// Share of the outline that is seen: not hidden and inside the picture.
    pub visible_fraction: f64,
    /// Centre of area of the part that is seen, px; none where nothing is.
    pub visible_px: Option<Vector2<f64>>,
}

/// A ball in the picture: by way of the mirror, and without it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BallTruth {
    /// In the mirror.
    pub mirror: Option<ViaTruth>,
    /// Seen directly.
    pub direct: Option<ViaTruth>,
}

/// The beam that arrives at the scene from a pixel, and its length to the mirror; none where it takes another path.
fn arriving(scene: &Scene, eye: &Eye, pixel: &Vector2<f64>, via: Via) -> Option<Beam> {
    let beam = eye.exact_beam(pixel, &scene.scene_from_camera)?;
    match via {
        Via::Direct => Some(beam),
        Via::Mirror => scene.pane.as_ref()?.main_path(&beam).map(|path| path.beam),
    }
}

/// The same by the eye's table where the pixel lies in the picture: fast, and exact to 1e-3 px.
fn arriving_fast(scene: &Scene, eye: &Eye, pixel: &Vector2<f64>, via: Via) -> Option<Beam> {
    if !eye.contains(pixel) {
        return arriving(scene, eye, pixel, via);
    }
    let beam = eye.beam(pixel, &scene.scene_from_camera.translation.vector, &scene.eye_rotation);
    match via {
        Via::Direct => Some(beam),
        Via::Mirror => scene.pane.as_ref()?.main_path(&beam).map(|path| path.beam),
    }
}

/// By how much a beam passes a point.
fn missing(beam: &Beam, point: &Vector3<f64>) -> Vector3<f64> {
    let to = point - beam.from;
    to - beam.along * to.dot(&beam.along)
}

/// The exact pixel of a point in the mirror (through glass and silver): the one whose traced beam passes through it.
///
/// Newton's method over traced beams, with differences as derivatives. None where no such pixel lies in the
/// picture or within 0.3 of its size around it.
pub fn pixel_of(scene: &Scene, eye: &Eye, point: &Vector3<f64>) -> Option<Vector2<f64>> {
    search(scene, eye, point, Via::Mirror)
}

fn search(scene: &Scene, eye: &Eye, point: &Vector3<f64>, via: Via) -> Option<Vector2<f64>> {
    let (width, height) = eye.size_px();
    let size = Vector2::new(width as f64, height as f64);
    let margin = size * SEARCH_MARGIN;
    let mut pixel = size / 2.0;
    for _ in 0..SEARCH_STEPS {
        let beam = arriving(scene, eye, &pixel, via)?;
        let miss = missing(&beam, point);
        let is_ahead = (point - beam.from).dot(&beam.along) > 0.0;
        if miss.norm() < PASSING_DISTANCE_M {
            return is_ahead.then_some(pixel);
        }
        let first = beam.along.cross(&Vector3::z()).try_normalize(1e-6)?;
        let second = beam.along.cross(&first);
        let flat = |m: Vector3<f64>| Vector2::new(first.dot(&m), second.dot(&m));
        let mut by_pixel = Matrix2::zeros();
        for axis in 0..2 {
            let mut step = Vector2::zeros();
            step[axis] = DERIVATIVE_STEP_PX;
            let ahead = missing(&arriving(scene, eye, &(pixel + step), via)?, point);
            let behind = missing(&arriving(scene, eye, &(pixel - step), via)?, point);
            by_pixel.set_column(axis, &(flat(ahead - behind) / (2.0 * DERIVATIVE_STEP_PX)));
        }
        let mut step = by_pixel.try_inverse()? * flat(miss);
        if step.norm() > LONGEST_STEP_PX {
            step *= LONGEST_STEP_PX / step.norm();
        }
        let next = pixel - step;
        // Rounding of the traced beams ends the search a little above the ideal distance.
        if (next - pixel).norm() < 1e-10 {
            return is_ahead.then_some(next);
        }
        pixel = Vector2::new(
            next.x.clamp(-margin.x, size.x + margin.x),
            next.y.clamp(-margin.y, size.y + margin.y),
        );
    }
    None
}

/// Whether the path from a pixel to the mirror is free (directly; no object is on it that the hit does not show).
fn way_is_free(scene: &Scene, eye: &Eye, pixel: &Vector2<f64>, via: Via) -> bool {
    let Some(beam) = eye.exact_beam(pixel, &scene.scene_from_camera) else { return false };
    let mirror_m = scene.pane.as_ref().and_then(|pane| pane.distance_m(&beam));
    match via {
        Via::Direct => true,
        // Beside the mirror there is no reflection; a body before the mirror hides it.
        Via::Mirror => mirror_m.is_some() && scene.first_before(&beam, mirror_m).is_none(),
    }
}

/// Where a corner (its point in the scene's frame, m) lies in the picture, and whether it is seen in the mirror.
pub fn corner_truth(scene: &Scene, eye: &Eye, point: &Vector3<f64>) -> CornerTruth {
    let pixel = pixel_of(scene, eye, point);
    let is_visible = pixel.is_some_and(|pixel| {
        eye.contains(&pixel)
            && way_is_free(scene, eye, &pixel, Via::Mirror)
            && arriving(scene, eye, &pixel, Via::Mirror).is_some_and(|beam| {
                let distance = (point - beam.from).norm();
                scene.first_meeting(&beam).is_none_or(|m| m.distance_m > distance - OWN_SURFACE_M)
            })
    });
    CornerTruth { pixel, is_visible }
}

/// How a ball, the body given as number `body`, lies in the picture.
pub fn ball_truth(scene: &Scene, eye: &Eye, body: usize) -> BallTruth {
    let body = scene.index_of(body);
    BallTruth {
        mirror: via_truth(scene, eye, body, Via::Mirror),
        direct: via_truth(scene, eye, body, Via::Direct),
    }
}

fn via_truth(scene: &Scene, eye: &Eye, body: usize, via: Via) -> Option<ViaTruth> {
    let center = scene.bodies[body].center;
    let center_px = search(scene, eye, &center, via)?;
    let beam = arriving(scene, eye, &center_px, via)?;
    // The picture's radius: half more than the length of the beam's path gives, for obliqueness.
    let start = scene.scene_from_camera.translation.vector;
    let way = match via {
        Via::Direct => (center - start).norm(),
        Via::Mirror => (beam.from - start).norm() + (center - beam.from).norm(),
    };
    let radius_m = scene.bodies[body].radius_m();
    let reach = 1.5 * eye.mean_focal_px() * radius_m / way.max(radius_m) + 1.0;
    let steps = (2.0 * reach / PROBE_PX).ceil() as i64;
    let (mut outline, mut seen) = (Vector2::zeros(), Vector2::zeros());
    let (mut outline_count, mut seen_count) = (0_u32, 0_u32);
    for j in 0..steps {
        for i in 0..steps {
            let at = center_px
                + Vector2::new((i as f64 + 0.5) * PROBE_PX - reach, (j as f64 + 0.5) * PROBE_PX - reach);
            let Some(beam) = arriving_fast(scene, eye, &at, via) else { continue };
            if scene.meets_alone(body, &beam).is_none() {
                continue;
            }
            outline += at;
            outline_count += 1;
            let is_seen = eye.contains(&at)
                && scene.first_meeting(&beam).is_some_and(|m| m.body == body)
                && way_is_free(scene, eye, &at, via);
            if is_seen {
                seen += at;
                seen_count += 1;
            }
        }
    }
    if outline_count == 0 {
        return None;
    }
    Some(ViaTruth {
        center_px,
        in_image: eye.contains(&center_px),
        outline_px: outline / f64::from(outline_count),
        outline_area_px2: f64::from(outline_count) * PROBE_PX * PROBE_PX,
        visible_fraction: f64::from(seen_count) / f64::from(outline_count),
        visible_px: (seen_count > 0).then(|| seen / f64::from(seen_count)),
    })
}
