//! The cone of rays that touch a sphere, fitted to edge points of its outline.
//!
//! Unit rays r of the outline satisfy `r · a = cos γ`, a the direction of the sphere's centre, γ its half angle; divided by cos γ it is linear,
//! `r · w = 1` with `w = a / cos γ` (Kanatani, "Geometric Computation for Machine Vision", 1993). The sphere's centre projects where a points,
//! which is not the outline's centroid. A sphere in a flat mirror is a sphere (the reflected one), so the same holds; the pane's glass changes the
//! cone by less than 0.05 px.

use super::circle::Circle;
use super::ray_edge::{MIN_EDGE_POINTS, NORMAL_SPREAD};
use super::shared::SharedErrors;
use crate::camera::Camera;
use crate::statistics::median;
use nalgebra::{Matrix2, Matrix2x3, Matrix3, Point3, Vector2, Vector3};
use std::sync::LazyLock;

/// Corners of the polygon that represents an outline.
const BOUNDARY_POINTS: usize = 72;
/// Sine and cosine of their directions.
static BOUNDARY_DIRECTIONS: LazyLock<[(f64, f64); BOUNDARY_POINTS]> = LazyLock::new(|| {
    core::array::from_fn(|i| (core::f64::consts::TAU * i as f64 / BOUNDARY_POINTS as f64).sin_cos())
});
/// Edge points farther from the fitted outline than this belong to something else, px, unless they are this uncertain themselves (deviations).
const INLIER_PX: f64 = 0.45;
const INLIER_DEVIATIONS: f64 = 2.5;
/// An edge that is an outlier among its neighbours is not the sphere's either, however near it is: this many
/// standard deviations of the others' scatter, which is at least this much.
const OUTSTANDING_SPREADS: f64 = 3.0;
const LEAST_SPREAD: f64 = 0.5;
/// Times that, an edge is of another thing for sure.
const FAR_OFF: f64 = 2.0;
/// Steps of the robust refit: inliers are chosen again from the last fit.
const REFITS: usize = 6;
/// An outline counts as seen all round where the mean of its edges' directions is at most so long (an eighth hidden), and as drawn out where that is this share of the
/// residuals' squares.
const MOST_ONE_SIDED: f64 = 0.15;
const DRAWN_OUT_SHARE: f64 = 0.5;
/// Worst condition of the scaled normal equations.
const WORST_CONDITION: f64 = 1e14;

/// A sub-pixel edge: where it is, px, and its standard deviation across the outline, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EdgePoint {
    /// (u, v), px.
    pub pixel: Vector2<f64>,
    /// Its own, px.
    pub std_px: f64,
    /// Of an error that it shares with its neighbours over a broad part of the outline, px: no residual shows it.
    pub shared_std_px: f64,
    /// How far one deviation of a cause that moves all edges of the ball moves this one, px, positive outward.
    pub common_px: f64,
    /// The same of another cause: the light on the ball.
    pub lit_px: f64,
}

/// How the scatter of edges counts in the covariance, and those that were left out.
pub(super) struct Scatter {
    /// Neighbours that share their errors, at least.
    pub correlated_points: f64,
    /// The share of the residuals' variance.
    pub share: f64,
    /// The share of the square of what edges that were left out would move the centre by.
    pub left_out_share: f64,
    /// Those up to this far from the outline, px.
    pub left_out_reach_px: f64,
}

/// A sphere's outline fitted to edge points.
#[derive(Debug, Clone, PartialEq)]
pub struct ConeFit {
    /// `w = a / cos γ`.
    pub parameters: Vector3<f64>,
    /// The outline's centre of area, px.
    pub centroid_px: Vector2<f64>,
    /// Its covariance from the edges' scatter, px².
    pub centroid_covariance_px2: Matrix2<f64>,
    /// The image of the sphere's centre, px.
    pub sphere_center_px: Vector2<f64>,
    /// The outline as a polygon, px.
    pub boundary_px: Vec<Vector2<f64>>,
    /// Radius of the disc of the same area, px.
    pub mean_radius_px: f64,
    /// Which edge points belong to it.
    pub inlier: Vec<bool>,
    /// How far the centre is moved by one deviation of the cause that moves all edges, px.
    pub common_moved_px: Vector2<f64>,
    /// RMS distance of those from the outline, px.
    pub residual_rms_px: f64,
}

/// Robust weighted fit of a sphere's outline to edge points in order around it, started from a circle; None where
/// they show none.
///
/// Minimises `Σ (d / std)²` with `d = f (acos(r·w / |w|) − acos(1 / |w|))`, f the camera's scale at the ball in
/// px/rad. The covariance is scaled by the size of the residuals and by the number of correlated neighbours: from
/// their autocorrelation, at least `correlated_points`. Errors that are common to a broad part of the outline, or
/// to all of it, are propagated through the fit separately: they have a larger effect on a part of an outline than
/// on a whole one.
pub fn fit_cone(
    points: &[EdgePoint],
    start: &Circle,
    camera: &Camera,
    correlated_points: f64,
) -> Option<ConeFit> {
    let near =
        |p: &EdgePoint| ((p.pixel - start.center_px).norm() - start.radius_px).abs() <= 2.0 * INLIER_PX;
    let inlier = points.iter().map(near).collect();
    let scatter = Scatter { correlated_points, share: 1.0, left_out_share: 0.0, left_out_reach_px: 0.0 };
    fit_cone_from(points, inlier, &start.center_px, camera, Some(&scatter))
}

/// [`fit_cone`] started from the edges that are probably the sphere's. Without a scatter neither the covariance is worked out nor how far the centre is moved: both are zero.
pub(super) fn fit_cone_from(
    points: &[EdgePoint],
    mut inlier: Vec<bool>,
    middle_px: &Vector2<f64>,
    camera: &Camera,
    scatter: Option<&Scatter>,
) -> Option<ConeFit> {
    let count = points.len();
    if count < MIN_EDGE_POINTS {
        return None;
    }
    let rays = points
        .iter()
        .map(|p| camera.unproject(&p.pixel).ok().map(|r| r.into_inner()))
        .collect::<Option<Vec<_>>>()?;
    let scale = px_per_rad(camera, middle_px)?;
    let mut parameters = Vector3::zeros();
    let mut away = vec![0.0; count];
    for _ in 0..REFITS {
        parameters = solve(points, &rays, &inlier)?;
        for (away, ray) in away.iter_mut().zip(&rays) {
            *away = distance_px(ray, &parameters, scale)?;
        }
        let chosen = agreeing(&away, points, &inlier);
        if chosen == inlier {
            break;
        }
        inlier = chosen;
    }
    let members = || (0..count).filter(|i| inlier[*i]);
    let number = members().count();
    if number < MIN_EDGE_POINTS {
        return None;
    }
    let rms = (members().map(|i| away[i] * away[i]).sum::<f64>() / number as f64).sqrt();
    let Some(scatter) = scatter else {
        let outline = Outline::of(&parameters, camera)?;
        return Some(ConeFit {
            centroid_px: outline.centroid_px,
            centroid_covariance_px2: Matrix2::zeros(),
            common_moved_px: Vector2::zeros(),
            sphere_center_px: camera.project(&Point3::from(parameters)).ok()?,
            mean_radius_px: (outline.area_px2 / core::f64::consts::PI).sqrt(),
            boundary_px: outline.boundary_px,
            parameters,
            inlier,
            residual_rms_px: rms,
        });
    };
    let whitened = without_shear(points, &members().collect::<Vec<_>>(), &away, middle_px);
    let freedom = number.saturating_sub(3).max(1) as f64;
    let correlated = correlation_factor(&whitened);
    let variance = scatter.share * whitened.iter().map(|r| r * r).sum::<f64>() / freedom
        * correlated.max(scatter.correlated_points);
    let mut normal = Matrix3::zeros();
    let (mut common, mut lit) = (Vector3::zeros(), Vector3::zeros());
    let away_px = |i: usize| points[i].pixel - middle_px;
    let radius_px = members().map(|i| away_px(i).norm()).sum::<f64>() / number as f64;
    // (Most neighbours are side by side; a gap is a few of them.)
    let steps_px = members().zip(members().skip(1)).map(|(i, j)| (points[j].pixel - points[i].pixel).norm());
    let mut shared = SharedErrors::on(radius_px, correlated * median(steps_px.collect()));
    for i in members() {
        let row = distance_gradient(&rays[i], &parameters, scale) / points[i].std_px;
        normal += row * row.transpose();
        let moved = row * (points[i].shared_std_px / points[i].std_px);
        shared.add(&away_px(i).try_normalize(0.0).unwrap_or_else(Vector2::x), &moved);
        common += row * (points[i].common_px / points[i].std_px);
        lit += row * (points[i].lit_px / points[i].std_px);
    }
    let spread = normal.symmetric_eigenvalues();
    if !(spread.min() > 0.0 && spread.max() < WORST_CONDITION * spread.min()) {
        return None;
    }
    let inverse = normal.try_inverse()?;
    let together = shared.information() + common * common.transpose() + lit * lit.transpose();
    let covariance = inverse * variance + inverse * together * inverse;
    let outline = cone_centroid(&parameters, camera)?;
    let doubt = if scatter.left_out_share > 0.0 {
        by_those_left_out(points, &rays, &away, scatter.left_out_reach_px, camera, &outline.centroid_px)
            * scatter.left_out_share
    } else {
        Matrix2::zeros()
    };
    Some(ConeFit {
        centroid_px: outline.centroid_px,
        centroid_covariance_px2: outline.by_parameters * covariance * outline.by_parameters.transpose()
            + doubt,
        common_moved_px: outline.by_parameters * (inverse * -common),
        sphere_center_px: camera.project(&Point3::from(parameters)).ok()?,
        boundary_px: outline.boundary_px,
        mean_radius_px: (outline.area_px2 / core::f64::consts::PI).sqrt(),
        parameters,
        inlier,
        residual_rms_px: rms,
    })
}

/// `m mᵀ`, m how far the centre moves if edges within reach of the outline that were left out are the ball's as well; px².
///
/// Where bent light or noise parts the edges, the larger part is not surely the outline: its scatter alone does not show that.
fn by_those_left_out(
    points: &[EdgePoint],
    rays: &[Vector3<f64>],
    away: &[f64],
    reach_px: f64,
    camera: &Camera,
    centroid_px: &Vector2<f64>,
) -> Matrix2<f64> {
    let near: Vec<bool> = away.iter().map(|d| d.abs() <= reach_px.max(INLIER_PX)).collect();
    let moved = solve(points, rays, &near)
        .and_then(|parameters| Outline::of(&parameters, camera))
        .map_or_else(Vector2::zeros, |other| other.centroid_px - centroid_px);
    moved * moved.transpose()
}

/// Residuals in their deviations, those of an outline that is drawn out taken off where they are most of all: a shutter that rolls shears the ball, and its second
/// harmonic moves no centre of an outline that is seen all round.
fn without_shear(
    points: &[EdgePoint],
    members: &[usize],
    away: &[f64],
    middle_px: &Vector2<f64>,
) -> Vec<f64> {
    let whitened: Vec<f64> = members.iter().map(|i| away[*i] / points[*i].std_px).collect();
    let directions: Vec<Vector2<f64>> =
        members.iter().filter_map(|i| (points[*i].pixel - middle_px).try_normalize(0.0)).collect();
    let middle = directions.iter().sum::<Vector2<f64>>() / members.len() as f64;
    if directions.len() < members.len() || middle.norm() > MOST_ONE_SIDED {
        return whitened;
    }
    let rows: Vec<Vector2<f64>> = directions
        .iter()
        .zip(members)
        .map(|(d, i)| Vector2::new(d.x * d.x - d.y * d.y, 2.0 * d.x * d.y) / points[*i].std_px)
        .collect();
    let (mut normal, mut right) = (Matrix2::identity() * 1e-9, Vector2::zeros());
    for (row, value) in rows.iter().zip(&whitened) {
        normal += row * row.transpose();
        right += row * *value;
    }
    let Some(factor) = normal.cholesky() else { return whitened };
    let drawn = factor.solve(&right);
    let all: f64 = whitened.iter().map(|w| w * w).sum();
    if right.dot(&drawn) < DRAWN_OUT_SHARE * all {
        return whitened;
    }
    rows.iter().zip(&whitened).map(|(row, value)| value - row.dot(&drawn)).collect()
}

/// The camera's scale at a pixel: px/rad, the root of the area's.
pub(super) fn px_per_rad(camera: &Camera, pixel: &Vector2<f64>) -> Option<f64> {
    let j = camera.unproject_with_jacobian(pixel).ok()?.by_pixel;
    let area = (j.transpose() * j).determinant();
    (area > 0.0).then(|| area.powf(-0.25))
}

/// Weighted least squares of `r · w = 1` over the inliers, in a frame whose z is their middle: the three columns are of like size there.
fn solve(points: &[EdgePoint], rays: &[Vector3<f64>], inlier: &[bool]) -> Option<Vector3<f64>> {
    let members = || (0..points.len()).filter(|i| inlier[*i]);
    if members().count() < MIN_EDGE_POINTS {
        return None;
    }
    let middle = members().map(|i| rays[i]).sum::<Vector3<f64>>().try_normalize(1e-12)?;
    let (side, other) = across(&middle);
    let local = |ray: &Vector3<f64>| Vector3::new(ray.dot(&side), ray.dot(&other), ray.dot(&middle));
    let size = members().map(|i| local(&rays[i]).xy().norm()).fold(0.0, f64::max).max(1e-9);
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for i in members() {
        let l = local(&rays[i]);
        let row = Vector3::new(l.x / size, l.y / size, 1.0);
        let weight = points[i].std_px.powi(-2);
        // With v = (w_x, w_y) / w_z and k = 1 / w_z: x v_x + y v_y − k = −z, and 1 − z is tiny: written so that it
        // keeps its digits.
        let target = l.xy().norm_squared() / (1.0 + l.z);
        normal += row * row.transpose() * weight;
        right += row * (weight * target);
    }
    let solution = normal.cholesky()?.solve(&right);
    // row · (v_x, v_y, 1 − k) = 1 − z.
    let k = 1.0 - solution.z;
    if !(k > 0.0) {
        return None;
    }
    let w = (side * (solution.x / size) + other * (solution.y / size) + middle) / k;
    (w.norm() > 1.0 && w.iter().all(|v| v.is_finite())).then_some(w)
}

/// Two directions across a unit vector and each other.
fn across(axis: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let helper = if axis.y.abs() < 0.9 { Vector3::y() } else { Vector3::x() };
    let side = axis.cross(&helper).normalize();
    (side, axis.cross(&side))
}

/// Signed distance of an edge ray from the cone, positive outside, px.
fn distance_px(ray: &Vector3<f64>, parameters: &Vector3<f64>, scale: f64) -> Option<f64> {
    let length = parameters.norm();
    if !(length > 1.0) {
        return None;
    }
    // Angles by their tangents: both are small, and the arc cosine has no digits there.
    let along = ray.dot(parameters);
    let angle = ray.cross(parameters).norm().atan2(along);
    let half = (length * length - 1.0).sqrt().atan();
    Some((angle - half) * scale)
}

/// `∂ distance / ∂w`, px.
fn distance_gradient(ray: &Vector3<f64>, parameters: &Vector3<f64>, scale: f64) -> Vector3<f64> {
    let length = parameters.norm();
    let along = ray.dot(parameters) / length;
    let sine = (ray.cross(parameters).norm() / length).max(1e-9);
    let by_along = (ray - parameters * (along / length)) / length;
    let half_sine = (1.0 - length.powi(-2)).max(1e-18).sqrt();
    (by_along / -sine - parameters / (length.powi(3) * half_sine)) * scale
}

/// Edges within the tolerance, without those next to an outlier: an occlusion disturbs its neighbours too. `before`
/// are those of the last fit.
///
/// A shadow beside the ball moves edges by some tenths of a pixel: little compared with the tolerance that noisy
/// and coded pictures need, much compared with the scatter of a clear one. The median of the residuals shows it
/// (Rousseeuw and Leroy, "Robust Regression and Outlier Detection", 1987).
fn agreeing(away: &[f64], points: &[EdgePoint], before: &[bool]) -> Vec<bool> {
    let whitened = away.iter().zip(points).map(|(d, p)| d.abs() / p.std_px);
    let shown = median(whitened.zip(before).filter(|(_, b)| **b).map(|(size, _)| size).collect());
    let most = OUTSTANDING_SPREADS * (NORMAL_SPREAD * shown).max(LEAST_SPREAD);
    let near: Vec<bool> = away
        .iter()
        .zip(points)
        .map(|(d, p)| d.abs() <= INLIER_PX.max(INLIER_DEVIATIONS * p.std_px).min(most * p.std_px))
        .collect();
    let count = near.len();
    // Far off, it is another thing, and spoils more.
    let far: Vec<bool> = away
        .iter()
        .zip(points)
        .map(|(d, p)| d.abs() > FAR_OFF * INLIER_PX.max(INLIER_DEVIATIONS * p.std_px))
        .collect();
    let beside = |i: usize, by: usize| [(i + by) % count, (i + count - by) % count];
    let kept: Vec<bool> = (0..count)
        .map(|i| near[i] && beside(i, 1).iter().all(|j| near[*j]) && beside(i, 2).iter().all(|j| !far[*j]))
        .collect();
    if kept.iter().filter(|k| **k).count() >= MIN_EDGE_POINTS { kept } else { near }
}

/// How much fewer independent edges there are than rays: 1 + 2 Σ of the residuals' autocorrelation along the outline, at least 1.
fn correlation_factor(residuals: &[f64]) -> f64 {
    let count = residuals.len();
    let power: f64 = residuals.iter().map(|r| r * r).sum();
    if !(power > 0.0) {
        return 1.0;
    }
    let mut factor = 1.0;
    for lag in 1..(count / 6).max(2) {
        let product: f64 = (0..count).map(|i| residuals[i] * residuals[(i + count - lag) % count]).sum();
        if product <= 0.0 {
            break;
        }
        factor += 2.0 * product / power;
    }
    factor
}

/// The outline of a cone in the picture.
#[derive(Debug, Clone, PartialEq)]
pub struct ConeOutline {
    /// Centre of area, px.
    pub centroid_px: Vector2<f64>,
    /// `∂ centroid / ∂w`, px.
    pub by_parameters: Matrix2x3<f64>,
    /// Area, px².
    pub area_px2: f64,
    /// The outline as a polygon, px.
    pub boundary_px: Vec<Vector2<f64>>,
}

/// The outline of a cone without its derivatives.
pub(super) struct Outline {
    pub centroid_px: Vector2<f64>,
    pub area_px2: f64,
    pub boundary_px: Vec<Vector2<f64>>,
}

/// The cone `r · w = 1`: `w` by length and direction, two directions across it, and its half angle.
struct Cone {
    length: f64,
    axis: Vector3<f64>,
    side: Vector3<f64>,
    other: Vector3<f64>,
    cosine: f64,
    sine: f64,
}

impl Cone {
    /// None where `w` is no cone's.
    fn of(parameters: &Vector3<f64>) -> Option<Self> {
        let length = parameters.norm();
        if !(length > 1.0) {
            return None;
        }
        let axis = parameters / length;
        let (side, other) = across(&axis);
        let (cosine, sine) = (length.recip(), (1.0 - length.powi(-2)).sqrt());
        Some(Self { length, axis, side, other, cosine, sine })
    }

    /// Where a ray of the cone leaves its axis, by the sine and cosine of its place round it, and the ray.
    fn ray(&self, (s, c): &(f64, f64)) -> (Vector3<f64>, Vector3<f64>) {
        let outward = self.side * *c + self.other * *s;
        (outward, self.axis * self.cosine + outward * self.sine)
    }
}

impl Outline {
    /// As [`cone_centroid`].
    pub fn of(parameters: &Vector3<f64>, camera: &Camera) -> Option<Self> {
        let cone = Cone::of(parameters)?;
        let boundary = BOUNDARY_DIRECTIONS
            .iter()
            .map(|place| camera.project(&Point3::from(cone.ray(place).1)).ok())
            .collect::<Option<Vec<_>>>()?;
        let middle = boundary.iter().sum::<Vector2<f64>>() / BOUNDARY_POINTS as f64;
        let (mut area, mut first) = (0.0, Vector2::zeros());
        for (i, corner) in boundary.iter().enumerate() {
            let (p, q) = (corner - middle, boundary[(i + 1) % BOUNDARY_POINTS] - middle);
            let cross = p.perp(&q);
            area += cross;
            first += (p + q) * cross;
        }
        (area.abs() > 0.0).then(|| Self {
            centroid_px: middle + first / (3.0 * area),
            area_px2: 0.5 * area.abs(),
            boundary_px: boundary,
        })
    }
}

/// The outline of the cone `r · w = 1` in a camera's picture; None where the cone does not lie before the camera.
pub fn cone_centroid(parameters: &Vector3<f64>, camera: &Camera) -> Option<ConeOutline> {
    let cone = Cone::of(parameters)?;
    let Cone { length, axis, sine, .. } = cone;
    // Along the axis only the half angle changes; across it the cone turns.
    let along = axis * -length.powi(-2);
    let mut boundary = Vec::with_capacity(BOUNDARY_POINTS);
    let mut moved: Vec<Matrix2x3<f64>> = Vec::with_capacity(BOUNDARY_POINTS);
    for place in &*BOUNDARY_DIRECTIONS {
        let (outward, ray) = cone.ray(place);
        let (pixel, by_point) = camera.project_with_point_jacobian(&Point3::from(ray)).ok()?;
        // ∂ray/∂|w|, then the turn ω = a × δa for δa = (I − a aᵀ) δw / |w|: δray = ω × ray.
        let by_length = along + outward * (length.powi(-3) / sine);
        let mut by_w = by_length * axis.transpose();
        for (column, e) in [Vector3::x(), Vector3::y(), Vector3::z()].iter().enumerate() {
            let turned = axis.cross(&((e - axis * axis.dot(e)) / length)).cross(&ray);
            let sum = by_w.column(column) + turned;
            by_w.set_column(column, &sum);
        }
        boundary.push(pixel);
        moved.push(by_point * by_w);
    }
    let (mut area, mut first) = (0.0, Vector2::zeros());
    let (mut d_area, mut d_first) = (Vector3::zeros(), Matrix2x3::zeros());
    let middle = boundary.iter().sum::<Vector2<f64>>() / BOUNDARY_POINTS as f64;
    for i in 0..BOUNDARY_POINTS {
        let j = (i + 1) % BOUNDARY_POINTS;
        let (p, q) = (boundary[i] - middle, boundary[j] - middle);
        let cross = p.perp(&q);
        let row = |k: usize, r: usize| moved[k].row(r).transpose();
        let d_cross = row(i, 0) * q.y + row(j, 1) * p.x - row(j, 0) * p.y - row(i, 1) * q.x;
        area += cross;
        d_area += d_cross;
        first += (p + q) * cross;
        d_first += (moved[i] + moved[j]) * cross + (p + q) * d_cross.transpose();
    }
    if !(area.abs() > 0.0) {
        return None;
    }
    let local = first / (3.0 * area);
    Some(ConeOutline {
        centroid_px: middle + local,
        by_parameters: d_first / (3.0 * area) - local * d_area.transpose() / area,
        area_px2: 0.5 * area.abs(),
        boundary_px: boundary,
    })
}
