//! The whole measurement of one ball: patch, circle, edges, cone, in a few rounds.

use super::blur::Blur;
use super::circle::{Circle, fit_circle};
use super::cone::{ConeFit, EdgePoint, fit_cone};
use super::edges::edges_on_rays;
use super::patch::{Patch, Picture};
use crate::camera::Camera;
use nalgebra::{Matrix2, Vector2};

/// Rounds of centring the rays and fitting again.
const ROUNDS: usize = 4;
/// The patch reaches so far beyond the ball.
const MARGIN_SHARE: f64 = 1.4;
const MARGIN_PX: f64 = 16.0;
/// Fewest and most rays.
const RAYS: (f64, f64) = (24.0, 240.0);
/// The blur that a lens and a pixel have, px; of a codec's colours, by the pixels that share one.
const USUAL_BLUR_PX: f64 = 0.7;
const BLUR_OF_STEP: f64 = 0.6;
/// Edge points farther than this from a circle are not on it, px.
const CIRCLE_TOLERANCE_PX: f64 = 0.675;
/// Along the outline, edges share their errors over about this length (times the blur, where that is above 1 px): what lies behind, and a codec's blocks.
const CORRELATION_PX: f64 = 3.0;
const CODED_CORRELATION_PX: f64 = 6.0;
/// How much longer for each px by which a noisy picture was smoothed.
const SMOOTHED_CORRELATION: f64 = 0.5;
/// What has no edge (another part before the ball) spoils the edges beside it over this length.
const SPOILED_PX: f64 = 2.0;

/// The radii that a ball may have, px.
#[derive(Debug, Clone, Copy)]
pub struct RadiusRange {
    /// Smallest, px.
    pub min_px: f64,
    /// Largest, px.
    pub max_px: f64,
}

/// A measured ball.
#[derive(Debug, Clone, PartialEq)]
pub struct BallOutline {
    /// The outline's fit.
    pub cone: ConeFit,
    /// The outline's ellipse: centre, half axes (px), angle of the major one from +u towards +v (rad).
    pub ellipse_center_px: Vector2<f64>,
    /// Half axes, the longer first, px.
    pub semi_axes_px: Vector2<f64>,
    /// rad.
    pub angle_rad: f64,
    /// Share of the outline that edge points agree with.
    pub arc_fraction: f64,
    /// Standard deviation of the picture's blur at the ball in the direction where it is widest, px.
    pub blur_px: f64,
}

/// Measures the ball near a circle in a picture; None where no outline of a sphere of a fitting size is there.
pub fn measure_ball(
    picture: &Picture<'_>,
    start: &Circle,
    range: &RadiusRange,
    camera: &Camera,
) -> Option<BallOutline> {
    if !(start.radius_px > 1.0
        && start.radius_px.is_finite()
        && start.center_px.iter().all(|v| v.is_finite()))
    {
        return None;
    }
    let margin = start.radius_px * MARGIN_SHARE + MARGIN_PX;
    let [u, v] = [start.center_px.x, start.center_px.y];
    let patch = Patch::cut(picture, [u - margin, v - margin], [u + margin, v + margin]);
    if patch.width < 4 || patch.height < 4 {
        return None;
    }
    let count = (core::f64::consts::TAU * start.radius_px).round().clamp(RAYS.0, RAYS.1) as usize;
    let correlation = if patch.coded { CODED_CORRELATION_PX } else { CORRELATION_PX };
    let mut blur =
        Blur::round(if patch.coded { BLUR_OF_STEP * picture.widest_step() } else { USUAL_BLUR_PX });
    let mut circle = *start;
    let mut center = start.center_px;
    let mut radius = vec![start.radius_px; count];
    let mut measured: Option<BallOutline> = None;
    for round in 0..ROUNDS {
        let edges = edges_on_rays(&patch, center, &radius, &blur, round == 0);
        blur = edges.blur;
        let found = beside_found(&edges.found, count as f64 / (core::f64::consts::TAU * circle.radius_px));
        let points: Vec<EdgePoint> = (0..count)
            .filter(|i| found[*i])
            .map(|i| EdgePoint { pixel: edges.points_px[i], std_px: edges.std_px[i] })
            .collect();
        if round == 0 {
            let places: Vec<Vector2<f64>> = points.iter().map(|p| p.pixel).collect();
            circle = fit_circle(&places, range.min_px, range.max_px, CIRCLE_TOLERANCE_PX)?;
        }
        let shared =
            correlation * blur.mean_px().max(1.0) * (1.0 + SMOOTHED_CORRELATION * patch.smoothing_px);
        let correlated = shared * count as f64 / (core::f64::consts::TAU * circle.radius_px);
        let cone = fit_cone(&points, &circle, camera, correlated)?;
        circle = Circle { center_px: cone.centroid_px, radius_px: cone.mean_radius_px };
        center = cone.centroid_px;
        let agreeing = cone.inlier.iter().filter(|i| **i).count();
        let (ellipse_center, semi_axes, angle) = ellipse(&cone.boundary_px);
        for (i, radius) in radius.iter_mut().enumerate() {
            let turned = core::f64::consts::TAU * i as f64 / count as f64 - angle;
            let (s, c) = turned.sin_cos();
            *radius = semi_axes.x * semi_axes.y / (semi_axes.y * c).hypot(semi_axes.x * s);
        }
        measured = Some(BallOutline {
            cone,
            ellipse_center_px: ellipse_center,
            semi_axes_px: semi_axes,
            angle_rad: angle,
            arc_fraction: agreeing as f64 / count as f64,
            blur_px: blur.widest_px(),
        });
    }
    measured
        .filter(|ball| ball.cone.mean_radius_px >= range.min_px && ball.cone.mean_radius_px <= range.max_px)
}

/// Edges that are found, those beside what has none left out; all of them where too few would be left.
fn beside_found(found: &[bool], rays_per_px: f64) -> Vec<bool> {
    let count = found.len();
    let reach = (SPOILED_PX * rays_per_px).round() as usize;
    let kept: Vec<bool> =
        (0..count).map(|i| (0..=2 * reach).all(|j| found[(i + count + j - reach) % count])).collect();
    if kept.iter().filter(|k| **k).count() * 3 >= count { kept } else { found.to_vec() }
}

/// Centre, half axes and angle from the boundary's moments: for an ellipse sampled evenly in its angle, axis² = 2 × variance.
fn ellipse(boundary: &[Vector2<f64>]) -> (Vector2<f64>, Vector2<f64>, f64) {
    let count = boundary.len() as f64;
    let center = boundary.iter().sum::<Vector2<f64>>() / count;
    let spread =
        boundary.iter().map(|p| (p - center) * (p - center).transpose()).sum::<Matrix2<f64>>() / count;
    let eigen = spread.symmetric_eigen();
    let (major, minor) = if eigen.eigenvalues.x >= eigen.eigenvalues.y { (0, 1) } else { (1, 0) };
    let half = |i: usize| (2.0 * eigen.eigenvalues[i].max(0.0)).sqrt();
    let axis = eigen.eigenvectors.column(major);
    (center, Vector2::new(half(major), half(minor)), axis.y.atan2(axis.x))
}
