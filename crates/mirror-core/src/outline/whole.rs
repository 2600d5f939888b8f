//! A ball that is blurred over much of its radius, measured as a whole: its image, shaded, moved and blurred, is
//! fitted to all of its pixels at once.
//!
//! Rays read their colours where no blur has mixed them. A ball that is small compared with the blur has no such
//! place, but its image is still a sphere's light through a kernel with three parameters. Only the colour that the
//! background lacks counts: the background may have any brightness.

use super::ball::{BallOutline, ellipse, expected_ellipse};
use super::circle::Circle;
use super::common_blur::{CommonBlur, clamped};
use super::cone::{ConeFit, cone_centroid, px_per_rad};
use super::own_colour::{MARGIN_PX, OwnColour};
use super::patch::{Patch, Picture};
use super::ray_edge::NORMAL_SPREAD;
use super::template::{BASES, Disc, Grid, planes};
use crate::camera::Camera;
use crate::statistics::median;
use nalgebra::{Matrix2, Point3, SMatrix, SVector, SymmetricEigen, Vector2, Vector3};

/// Of the outline: centre, radius, and the blur's covariance.
const SHAPE: usize = 6;
/// Colour that the background has of the ball's: even, and a slope each way.
const BEHIND: usize = 3;
const UNKNOWNS: usize = SHAPE + BASES + BEHIND;
const ROUNDS: usize = 14;
/// Steps of the centre and radius that count as none, px.
const DONE_PX: f64 = 0.004;
/// How far light changes over a ball by order, and the background's colour, as a share of the ball's.
const LIGHT_STD: [f64; 3] = [3.0, 0.6, 0.2];
const BEHIND_STD: f64 = 0.1;
/// Pixels that do not fit, by the spread, count less.
const OUTLYING_SPREADS: f64 = 3.0;
const LEAST_SPREAD: f64 = 0.008;
/// Residuals share their errors over about this area: so many px², and for each px² of blur.
const SHARED_AREA_PX2: [f64; 2] = [6.0, 4.0];
/// Larger balls are never small against a blur.
const MOST_RADIUS_PX: f64 = 200.0;
/// A disc's part that counts as its rim, by the covered share.
const RIM: (f64, f64) = (0.15, 0.85);

/// The prior knowledge of a ball.
#[derive(Debug, Clone, Copy)]
pub struct ExpectedRadius {
    /// px.
    pub radius_px: f64,
    /// Its standard deviation, px.
    pub std_px: f64,
}

/// A ball measured as a whole.
#[derive(Debug, Clone, PartialEq)]
pub struct BlurredBall {
    /// `arc_fraction` is the share of its rim whose pixels fit.
    pub outline: BallOutline,
    /// Its blur's covariance, px².
    pub blur_px2: Matrix2<f64>,
}

/// Measures a blurred ball near a circle's centre; None where nothing of the ball's colour differs from its
/// surroundings, or nothing fits.
///
/// Without a `common` blur it starts with the moments of the ball's colour; with it, at the circle's centre, where
/// a fit without it has ended.
///
/// Minimises the weighted squares of `y − T(c, r, Σ) β − (1 − α) γ` by Gauss–Newton: y the part of the ball's
/// colour that the background lacks, T the blurred basis of a sphere's light, α the share covered, Σ the blur. The
/// derivatives of the image by the centre and the blur are its gradient and half of its second derivatives (heat
/// equation); by the radius `∂F/∂r = −((p − c)·∇F + tr Σ∇∇F) / r`.
pub fn measure_blurred_ball(
    picture: &Picture<'_>,
    start: &Circle,
    expected: &ExpectedRadius,
    common: Option<&CommonBlur>,
    camera: &Camera,
) -> Option<BlurredBall> {
    let finite = start.center_px.iter().chain([&expected.radius_px, &expected.std_px]).all(|v| v.is_finite());
    if !(finite && expected.radius_px > 1.0 && expected.radius_px < MOST_RADIUS_PX && expected.std_px > 0.0) {
        return None;
    }
    let shape = Circle { center_px: start.center_px, radius_px: expected.radius_px };
    let (semi_axes, angle) = expected_ellipse(&shape, camera)?;
    let (sine, cosine) = angle.sin_cos();
    let turn = Matrix2::new(cosine, sine, -sine, cosine);
    let mean = (semi_axes.x * semi_axes.y).sqrt();
    let unit_from_px = Matrix2::from_diagonal(&semi_axes.map(|a| mean / a)) * turn;
    let half = expected.radius_px * semi_axes.x / mean + MARGIN_PX;
    let [u, v] = [start.center_px.x, start.center_px.y];
    let patch = Patch::cut(&picture.as_light(), [u - half, v - half], [u + half, v + half]);
    if patch.width < 8 || patch.height < 8 {
        return None;
    }
    let [left, top] = patch.place(0, 0);
    let grid = Grid { left, top, width: patch.width, height: patch.height };
    let seen = OwnColour::of(&patch, &grid, start.center_px, expected.radius_px)?;
    let mut disc = Disc { center_px: start.center_px, radius_px: expected.radius_px, unit_from_px };
    let mut fit = Fit::start(&grid, &seen, &disc)?;
    if let Some(common) = common {
        fit.blur_px2 = clamped(&common.covariance_px2);
    } else {
        disc.center_px = fit.center_px;
    }
    for _ in 0..ROUNDS {
        let step = fit.round(&grid, &seen, &mut disc, expected, common)?;
        if step < DONE_PX {
            break;
        }
    }
    Some(BlurredBall { outline: fit.outline(&grid, &disc, camera)?, blur_px2: fit.blur_px2 })
}

/// The present state of the fit.
struct Fit {
    center_px: Vector2<f64>,
    blur_px2: Matrix2<f64>,
    /// Of the ball's light, and of the background's share of its colour.
    light: SVector<f64, { BASES + BEHIND }>,
    spread: f64,
    covariance_px2: Matrix2<f64>,
    radius_variance_px2: f64,
    rms: f64,
    /// Share of the rim and of the disc whose pixels fit.
    rim: f64,
}

impl Fit {
    /// By the moments of the colour.
    fn start(grid: &Grid, seen: &OwnColour, disc: &Disc) -> Option<Self> {
        let mut center = disc.center_px;
        let mut blur = Matrix2::identity();
        for _ in 0..3 {
            let (mut sum, mut first, mut second) = (0.0, Vector2::zeros(), Matrix2::zeros());
            for (index, value) in seen.value.iter().enumerate() {
                let away = grid.place(index) - center;
                if *value > 0.25 && away.norm() < disc.radius_px + 0.6 * MARGIN_PX {
                    let share = value.min(1.0) * seen.weight[index];
                    sum += share;
                    first += away * share;
                    second += away * away.transpose() * share;
                }
            }
            if !(sum > 4.0) {
                return None;
            }
            let shift = first / sum;
            center += shift;
            blur = second / sum
                - shift * shift.transpose()
                - Matrix2::identity() * (0.25 * disc.radius_px.powi(2));
        }
        let mut light = SVector::zeros();
        (light[0], light[3]) = (0.5, 0.5);
        Some(Self {
            center_px: center,
            blur_px2: clamped(&(blur + Matrix2::identity())),
            light,
            spread: 0.1,
            covariance_px2: Matrix2::zeros(),
            radius_variance_px2: 0.0,
            rms: 0.0,
            rim: 0.0,
        })
    }

    /// One step of all unknowns; how far centre and radius went, px.
    fn round(
        &mut self,
        grid: &Grid,
        seen: &OwnColour,
        disc: &mut Disc,
        expected: &ExpectedRadius,
        common: Option<&CommonBlur>,
    ) -> Option<f64> {
        let planes = planes(grid, disc, &self.blur_px2);
        let count = grid.count();
        let behind = |index: usize| {
            let away = (grid.place(index) - disc.center_px) / disc.radius_px;
            [1.0, away.x.clamp(-2.0, 2.0), away.y.clamp(-2.0, 2.0)]
        };
        let mut ball = vec![0.0; count];
        let mut residual = vec![0.0; count];
        for index in 0..count {
            let under = behind(index);
            let other: f64 = (0..BEHIND).map(|k| self.light[BASES + k] * under[k]).sum();
            let own: f64 = (0..BASES).map(|k| self.light[k] * planes[k][index]).sum();
            // What moves with the ball: its light minus the background that it hides.
            ball[index] = own - other * planes[0][index];
            residual[index] = seen.value[index] - own - other * (1.0 - planes[0][index]);
        }
        let near: Vec<f64> = (0..count).filter(|i| planes[0][*i] > 0.03).map(|i| residual[i].abs()).collect();
        self.spread = (NORMAL_SPREAD * median(near)).max(LEAST_SPREAD);
        let mut normal = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
        let mut right = SVector::<f64, UNKNOWNS>::zeros();
        let (mut squares, mut total) = (0.0, 0.0);
        let (mut rim, mut rim_fits) = (0.0, 0.0);
        for row in 1..grid.height.saturating_sub(1) {
            for column in 1..grid.width.saturating_sub(1) {
                let index = row * grid.width + column;
                let size = residual[index] / (OUTLYING_SPREADS * self.spread);
                let fits = (1.0 + size * size).powi(-2);
                let weight = seen.weight[index] * fits;
                let alpha = planes[0][index];
                if alpha > 0.03 {
                    squares += weight * residual[index].powi(2);
                    total += weight;
                }
                if alpha > RIM.0 && alpha < RIM.1 {
                    rim += 1.0;
                    rim_fits += weight;
                }
                let at =
                    |dy: isize, dx: isize| ball[(index as isize + dy * grid.width as isize + dx) as usize];
                let (gx, gy) = (0.5 * (at(0, 1) - at(0, -1)), 0.5 * (at(1, 0) - at(-1, 0)));
                let xx = at(0, 1) - 2.0 * at(0, 0) + at(0, -1);
                let yy = at(1, 0) - 2.0 * at(0, 0) + at(-1, 0);
                let xy = 0.25 * (at(1, 1) - at(1, -1) - at(-1, 1) + at(-1, -1));
                let away = grid.place(index) - disc.center_px;
                let s = &self.blur_px2;
                let by_radius =
                    -(away.x * gx + away.y * gy + s[(0, 0)] * xx + 2.0 * s[(0, 1)] * xy + s[(1, 1)] * yy)
                        / disc.radius_px;
                let mut line = SVector::<f64, UNKNOWNS>::zeros();
                line.fixed_rows_mut::<SHAPE>(0).copy_from_slice(&[
                    -gx,
                    -gy,
                    by_radius,
                    0.5 * xx,
                    xy,
                    0.5 * yy,
                ]);
                for k in 0..BASES {
                    line[SHAPE + k] = planes[k][index];
                }
                let under = behind(index);
                for k in 0..BEHIND {
                    line[SHAPE + BASES + k] = (1.0 - alpha) * under[k];
                }
                // (Its lower triangle: the factor reads no more of it.)
                normal.syger(weight, &line, &line, 1.0);
                right.axpy(weight * residual[index], &line, 1.0);
            }
        }
        // Neighbouring pixels have correlated errors: this many count as one.
        let area = SHARED_AREA_PX2[0] + SHARED_AREA_PX2[1] * 0.5 * self.blur_px2.trace();
        let variance = area * self.spread.powi(2);
        let prior = |normal: &mut SMatrix<f64, UNKNOWNS, UNKNOWNS>,
                     right: &mut SVector<f64, UNKNOWNS>,
                     at: usize,
                     away: f64,
                     std: f64| {
            normal[(at, at)] += variance / (std * std);
            right[at] -= away * variance / (std * std);
        };
        prior(&mut normal, &mut right, 2, disc.radius_px - expected.radius_px, expected.std_px);
        for k in 0..3 {
            // A step of the blur's variances in one round is held to about their size.
            prior(&mut normal, &mut right, 3 + k, 0.0, 2.0 + self.blur_px2.trace());
        }
        if let Some(common) = common {
            let off = self.blur_px2 - common.covariance_px2;
            for (k, away) in [off[(0, 0)], off[(0, 1)], off[(1, 1)]].into_iter().enumerate() {
                prior(&mut normal, &mut right, 3 + k, away, common.std_px2);
            }
        }
        for k in 0..BASES {
            let order = [0, 1, 1, 1, 2, 2, 2, 2, 2][k];
            let away = if k == 0 { 0.0 } else { self.light[k] };
            prior(&mut normal, &mut right, SHAPE + k, away, LIGHT_STD[order]);
        }
        for k in 0..BEHIND {
            prior(&mut normal, &mut right, SHAPE + BASES + k, self.light[BASES + k], BEHIND_STD);
        }
        let factor = normal.cholesky()?;
        let step = factor.solve(&right);
        let most = 0.35 * expected.radius_px;
        let held = |value: f64| value.clamp(-most, most);
        let shift = Vector2::new(held(step[0]), held(step[1]));
        disc.center_px += shift;
        let grown = step[2].clamp(-0.15 * expected.radius_px, 0.15 * expected.radius_px);
        disc.radius_px = (disc.radius_px + grown).clamp(0.6 * expected.radius_px, 1.6 * expected.radius_px);
        self.center_px = disc.center_px;
        self.blur_px2 = clamped(&(self.blur_px2 + Matrix2::new(step[3], step[4], step[4], step[5])));
        self.light += step.fixed_rows::<{ BASES + BEHIND }>(SHAPE);
        if !(self.light.iter().all(|l| l.is_finite()) && shift.norm().is_finite() && total > 0.0) {
            return None;
        }
        let inverse = factor.inverse();
        self.rms = (squares / total).sqrt();
        let scale = area * self.rms.powi(2);
        self.covariance_px2 = inverse.fixed_view::<2, 2>(0, 0) * scale;
        self.radius_variance_px2 = inverse[(2, 2)] * scale;
        self.rim = rim_fits / f64::max(rim, 1.0);
        Some(shift.norm() + grown.abs())
    }

    fn outline(&self, grid: &Grid, disc: &Disc, camera: &Camera) -> Option<BallOutline> {
        let inside = |p: &Vector2<f64>| {
            p.x >= grid.left
                && p.y >= grid.top
                && p.x < grid.left + grid.width as f64
                && p.y < grid.top + grid.height as f64
        };
        if !inside(&disc.center_px) {
            return None;
        }
        // The cone whose outline has its centre of area here.
        let mut aim = disc.center_px;
        let half = disc.radius_px / px_per_rad(camera, &aim)?;
        let mut parameters = Vector3::zeros();
        let mut found = None;
        for _ in 0..4 {
            parameters = camera.unproject(&aim).ok()?.into_inner() / half.min(1.2).cos();
            let cone = cone_centroid(&parameters, camera)?;
            aim += disc.center_px - cone.centroid_px;
            found = Some(cone);
        }
        let cone = found?;
        let (ellipse_center, semi_axes, angle) = ellipse(&cone.boundary_px);
        let variances = SymmetricEigen::new(self.blur_px2).eigenvalues;
        let (narrow, wide) = (variances.min().sqrt(), variances.max().sqrt());
        Some(BallOutline {
            ellipse_center_px: ellipse_center,
            semi_axes_px: semi_axes,
            angle_rad: angle,
            arc_fraction: self.rim,
            blur_px: wide,
            narrow_blur_px: narrow,
            curve_deviations: None,
            lens_blur_px: (0.5 * (narrow * narrow + wide * wide)).sqrt(),
            cone: ConeFit {
                parameters,
                centroid_px: disc.center_px,
                centroid_covariance_px2: self.covariance_px2,
                sphere_center_px: camera.project(&Point3::from(parameters)).ok()?,
                boundary_px: cone.boundary_px,
                mean_radius_px: disc.radius_px,
                inlier: Vec::new(),
                common_moved_px: Vector2::zeros(),
                // By the slope of a blurred edge.
                residual_rms_px: self.rms * wide * core::f64::consts::TAU.sqrt(),
            },
        })
    }
}
