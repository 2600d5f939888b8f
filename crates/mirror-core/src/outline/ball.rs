//! The whole measurement of one ball: patch, circle, edges, cone, in a few iterations.

use super::blur::Blur;
use super::circle::Circle;
use super::cone::{ConeFit, EdgePoint, Outline, Scatter, fit_cone_from, px_per_rad};
use super::consensus::of_one_outline;
use super::edges::edges_on_rays;
use super::patch::{Patch, Picture};
use super::rays::BallShade;
use super::sight::{Look, Sight};
use crate::camera::Camera;
use nalgebra::{Matrix2, Vector2};

/// Iterations of centring the rays and fitting; from the second to last on they end when centre and radius move by
/// less than this, px.
const ROUNDS: usize = 4;
const SETTLED_PX: f64 = 0.05;
/// Fewest and most rays, and how far apart they are along the outline, px: nearer ones share their errors. Coarser colour is the same over more px.
const RAYS: (f64, f64) = (24.0, 240.0);
const RAY_SPACING_PX: f64 = 1.0;
const CODED_RAY_SPACING_PX: f64 = 2.0;
/// So many times as far apart while the outline is searched, and in samples of a codec's errors.
const SPARSER: f64 = 2.0;
/// The blur that a lens and a pixel have, px; of a codec's colours, by the pixels that share one.
const USUAL_BLUR_PX: f64 = 0.7;
const BLUR_OF_STEP: f64 = 0.6;
/// Edges farther than this from an outline are not on it, px.
const TOLERANCE_PX: f64 = 0.675;
/// Common error of neighbouring edges by the blur, which mixes light from outside over the rim: px for each px of
/// blur and for each px² of it, and the same in coded pictures. Measured on rendered and path-traced balls, as the
/// shares below. (In linear light what is even in the blur lies along a lamp's light alone.)
const SHARED_BY_BLUR: [f64; 2] = [0.0, 0.0171];
const SHARED_BY_CODED_BLUR: [f64; 2] = [0.0276, 0.0213];
/// Error of all edges of a ball along a lamp's light, px for each px of blur: the model of the light errs at the lit rim to
/// the other side than at the dark one, which moves the centre, and no residual shows it. On balls of more than this radius
/// it is less by its root: over the same blur the normal near the rim turns less. Measured on rendered balls, whose squared
/// errors were twice as large along a lamp's light as across it, and alike in both directions under soft light.
const LIT_BY_BLUR: f64 = 0.0184;
const LIT_RADIUS_PX: f64 = 14.0;
/// The same by sharpening, px for an overshoot of the whole step; beside that, it parts the channels (`channels`).
const SHARED_BY_OVERSHOOT_PX: f64 = 0.4;
/// Along the outline, edges share their errors over about this length (times the blur, where that is above 1 px): what lies behind, and a codec's blocks.
const CORRELATION_PX: f64 = 1.35;
const CODED_CORRELATION_PX: f64 = 1.8;
/// Variance of the centre by the edges' scatter against what they show: the fit follows the errors that reach farthest along the outline. So many times more for
/// each time that there are more edges than agree; in noise, which drives good edges out too, by more.
const SCATTER_SHARE: f64 = 1.35;
const CODED_SCATTER_SHARE: f64 = 1.45;
const DISAGREEING_POWER: f64 = 0.6;
const DISAGREEING_POWER_IN_NOISE: f64 = 1.0;
/// So much of the square that edges left out near the outline would move the centre by is added; in coded pictures none.
const LEFT_OUT_SHARE: f64 = 0.3;
/// Edges that were left out may be the ball's own up to this far from its outline, px and blurs: what light does to an edge reaches no farther than the blur that
/// mixes it. Beyond, they are of what hides a part of the ball, and do not move its centre.
const LEFT_OUT_REACH_PX: f64 = 1.35;
const LEFT_OUT_REACH_BLURS: f64 = 1.0;
/// The same for each px by which a noisy picture was smoothed: noise under a Gaussian of σ is worth one number in 2 √π σ. How much longer it is in coded pictures.
const SMOOTHED_CORRELATION: f64 = 3.6;
const CODED_SMOOTHED_CORRELATION: f64 = 0.8;
/// Least square of the share of the outline that edges agree with, in that.
const LEAST_HELD: f64 = 0.1;
/// A part without an edge (an occlusion) disturbs the adjacent edges over this length.
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
    /// The same in the direction where it is narrowest, px: much less where ball or camera moved.
    pub narrow_blur_px: f64,
    /// What lens and motion have of it, over all directions, px: a codec's own blur of the colours is not in it.
    pub lens_blur_px: f64,
    /// By how many deviations of the allowed error the channels show another tone curve than sRGB's; None where
    /// they do not determine it.
    pub curve_deviations: Option<f64>,
}

/// Measures the ball near a circle in a picture; None where no outline of a sphere of a fitting size is there.
pub fn measure_ball(
    picture: &Picture<'_>,
    start: &Circle,
    range: &RadiusRange,
    camera: &Camera,
) -> Option<BallOutline> {
    let patch = Patch::around(picture, start)?;
    let aim = Aim::at(start, picture, camera)?;
    settled(&patch, aim, range, camera).filter(|ball| range.holds(ball))
}

/// Rounds from an aim on until the ball settles.
fn settled(patch: &Patch, mut aim: Aim, range: &RadiusRange, camera: &Camera) -> Option<BallOutline> {
    let mut round = 0;
    loop {
        let look = match round {
            0 => Look::Rough,
            round if round + 2 < ROUNDS => Look::Near,
            _ => Look::Whole,
        };
        let (ball, next) = aim.measured(patch, range, camera, look)?;
        round += 1;
        let moved = (next.circle.center_px - aim.circle.center_px)
            .norm()
            .max((next.circle.radius_px - aim.circle.radius_px).abs());
        if round >= ROUNDS || (round + 1 >= ROUNDS && moved < SETTLED_PX) {
            return Some(ball);
        }
        aim = next;
    }
}

impl RadiusRange {
    /// Whether a ball's radius is within.
    pub(super) fn holds(&self, ball: &BallOutline) -> bool {
        (self.min_px..=self.max_px).contains(&ball.cone.mean_radius_px)
    }
}

/// Where a round looks for the outline: its centre, its distance in evenly spaced directions, and the blur.
pub(super) struct Aim {
    circle: Circle,
    radius: Vec<f64>,
    blur: Blur,
    /// Rays of the rounds to come, for each px of the radius.
    rays_per_radius: f64,
}

impl Aim {
    /// The outline of a sphere at a circle, of a usual blur.
    pub fn at(start: &Circle, picture: &Picture<'_>, camera: &Camera) -> Option<Self> {
        let spacing = if picture.coded() { CODED_RAY_SPACING_PX } else { RAY_SPACING_PX };
        let rays_per_radius = core::f64::consts::TAU / spacing;
        let count = ray_count(start.radius_px, rays_per_radius / SPARSER);
        let blur = if picture.coded() { BLUR_OF_STEP * picture.widest_step() } else { USUAL_BLUR_PX };
        let radius = expected_radii(start, camera, count)?;
        Some(Self { circle: *start, radius, blur: Blur::round(blur), rays_per_radius })
    }

    /// The same with sparse rays, also in the rounds to come.
    pub fn sparse(self) -> Self {
        Self { rays_per_radius: self.rays_per_radius / SPARSER, ..self }
    }

    /// The same for a known blur (standard deviation, px), alike in all directions.
    pub fn blurred(self, std_px: f64) -> Self {
        Self { blur: Blur::round(std_px), ..self }
    }

    /// The ball near this outline, and the aim of the next round.
    pub fn measured(
        &self,
        patch: &Patch,
        range: &RadiusRange,
        camera: &Camera,
        look: Look,
    ) -> Option<(BallOutline, Self)> {
        self.measured_on(&self.sight(patch, look), None, patch, range, camera, look)
    }

    /// Where a patch is sampled; it serves for others at the same place too.
    pub fn sight(&self, patch: &Patch, look: Look) -> Sight {
        let turn = core::f64::consts::TAU / self.radius.len() as f64;
        let blur_px = (0..self.radius.len()).map(|i| self.blur.along(turn * i as f64)).collect();
        Sight::new(patch, self.circle.center_px, &self.radius, blur_px, look == Look::Rough)
    }

    /// [`Self::measured`] by this aim's sight; the light on the ball is fitted where it is not known.
    pub fn measured_on(
        &self,
        sight: &Sight,
        shade: Option<&BallShade>,
        patch: &Patch,
        range: &RadiusRange,
        camera: &Camera,
        look: Look,
    ) -> Option<(BallOutline, Self)> {
        let (circle, center, count) = (&self.circle, self.circle.center_px, self.radius.len());
        let edges = edges_on_rays(patch, sight, shade, &self.blur, look);
        let blur = edges.blur;
        let found = beside_found(&edges.found, count as f64 / (core::f64::consts::TAU * circle.radius_px));
        let growth = (range.min_px - circle.radius_px, range.max_px - circle.radius_px);
        let together = of_one_outline(&edges.offset_px, &edges.std_px, &found, TOLERANCE_PX, growth)?;
        let widest = blur.widest_px();
        let [by_px, by_px2] = if patch.coded { SHARED_BY_CODED_BLUR } else { SHARED_BY_BLUR };
        let by_blur = (by_px * widest).hypot(by_px2 * widest.powi(2));
        let by_lamp = LIT_BY_BLUR * (LIT_RADIUS_PX / circle.radius_px).min(1.0).sqrt();
        let by_all = by_blur.hypot(SHARED_BY_OVERSHOOT_PX * edges.overshoot);
        let (points, inlier): (Vec<EdgePoint>, Vec<bool>) = (0..count)
            .filter(|i| found[*i])
            .map(|i| {
                let point = EdgePoint {
                    pixel: edges.points_px[i],
                    std_px: edges.std_px[i],
                    shared_std_px: by_all.hypot(edges.shared_std_px[i]),
                    common_px: edges.common_px[i],
                    lit_px: by_lamp * sight.blur_px[i] * sight.direction[i].dot(&edges.toward_lamp),
                };
                (point, together[i])
            })
            .unzip();
        let smoothed = patch.noise.correlation_px();
        let unsmoothed = (blur.mean_px().powi(2) - patch.noise.smoothing_px.powi(2)).max(1.0).sqrt();
        let wide = blur.mean_px().max(1.0);
        // The coarser a codec has made the colour, the longer is the correlation of its errors; and where other
        // objects hide a part of the outline, they disturb some of the rest too.
        let held = together.iter().filter(|t| **t).count() as f64 / count as f64;
        let longer = if patch.coded { wide / (held * held).max(LEAST_HELD) } else { 1.0 };
        let shared = if patch.coded {
            CODED_CORRELATION_PX * wide * longer * (1.0 + CODED_SMOOTHED_CORRELATION * smoothed)
        } else {
            (CORRELATION_PX * unsmoothed).hypot(SMOOTHED_CORRELATION * smoothed)
        };
        let correlated = shared * count as f64 / (core::f64::consts::TAU * circle.radius_px);
        let mut cone = fit_cone_from(
            &points,
            inlier,
            &center,
            camera,
            (look == Look::Whole)
                .then(|| Scatter {
                    correlated_points: correlated,
                    share: if patch.coded { CODED_SCATTER_SHARE } else { SCATTER_SHARE },
                    left_out_share: if patch.coded { 0.0 } else { LEFT_OUT_SHARE },
                    left_out_reach_px: LEFT_OUT_REACH_PX.min(LEFT_OUT_REACH_BLURS * blur.mean_px()),
                })
                .as_ref(),
        )?;
        let circle = Circle { center_px: cone.centroid_px, radius_px: cone.mean_radius_px };
        let agreeing = cone.inlier.iter().filter(|i| **i).count();
        // In coded pictures edges scatter so much that their agreement says little.
        if !patch.coded {
            let more = points.len() as f64 / agreeing.max(1) as f64;
            let noisy = patch.noise.smoothing_px > 0.0;
            let power = if noisy { DISAGREEING_POWER_IN_NOISE } else { DISAGREEING_POWER };
            cone.centroid_covariance_px2 *= more.powf(power);
        }
        let (ellipse_center, semi_axes, angle) = ellipse(&cone.boundary_px);
        let ball = BallOutline {
            cone,
            ellipse_center_px: ellipse_center,
            semi_axes_px: semi_axes,
            angle_rad: angle,
            arc_fraction: agreeing as f64 / count as f64,
            blur_px: blur.widest_px(),
            narrow_blur_px: blur.narrowest_px(),
            lens_blur_px: edges.lens_px,
            curve_deviations: edges.curve_deviations,
        };
        let rays_per_radius = self.rays_per_radius;
        let radius = radii(&semi_axes, angle, ray_count(circle.radius_px, rays_per_radius));
        Some((ball, Self { circle, radius, blur, rays_per_radius }))
    }
}

/// Rays of an outline of a radius.
fn ray_count(radius_px: f64, per_radius: f64) -> usize {
    (per_radius * radius_px).round().clamp(RAYS.0, RAYS.1) as usize
}

/// Distances of a sphere's outline from its centre in evenly spaced directions, for the sphere at a circle.
fn expected_radii(circle: &Circle, camera: &Camera, count: usize) -> Option<Vec<f64>> {
    let (semi_axes, angle) = expected_ellipse(circle, camera)?;
    Some(radii(&semi_axes, angle, count))
}

/// Half axes (px) and angle (rad) of a sphere's outline, for the sphere at a circle.
pub(super) fn expected_ellipse(circle: &Circle, camera: &Camera) -> Option<(Vector2<f64>, f64)> {
    let axis = camera.unproject(&circle.center_px).ok()?.into_inner();
    let half = circle.radius_px / px_per_rad(camera, &circle.center_px)?;
    let (_, semi_axes, angle) = ellipse(&Outline::of(&(axis / half.min(1.2).cos()), camera)?.boundary_px);
    Some((semi_axes, angle))
}

/// Distances of an ellipse from its centre in evenly spaced directions.
fn radii(semi_axes: &Vector2<f64>, angle: f64, count: usize) -> Vec<f64> {
    (0..count)
        .map(|i| {
            let (s, c) = (core::f64::consts::TAU * i as f64 / count as f64 - angle).sin_cos();
            semi_axes.x * semi_axes.y / (semi_axes.y * c).hypot(semi_axes.x * s)
        })
        .collect()
}

/// Edges that are found, without those next to a gap; all of them if too few would be left.
fn beside_found(found: &[bool], rays_per_px: f64) -> Vec<bool> {
    let count = found.len();
    let reach = (SPOILED_PX * rays_per_px).round() as usize;
    let kept: Vec<bool> =
        (0..count).map(|i| (0..=2 * reach).all(|j| found[(i + count + j - reach) % count])).collect();
    if kept.iter().filter(|k| **k).count() * 3 >= count { kept } else { found.to_vec() }
}

/// Centre, half axes and angle from the boundary's moments: for an ellipse sampled evenly in its angle, axis² = 2 × variance.
pub(super) fn ellipse(boundary: &[Vector2<f64>]) -> (Vector2<f64>, Vector2<f64>, f64) {
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
