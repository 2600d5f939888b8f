//! How an image point depends on where the point is, on the mirror's plane and on the lens.

use super::*;
use crate::gap::free_optics::SeenPoint;

/// How an image point depends on everything, px.
pub(super) struct Sight {
    pub pixel: Vector2<f64>,
    pub by_point: Matrix2x3<f64>,
    pub by_foot: Matrix2x3<f64>,
    pub by_glass: Vector2<f64>,
    pub by_curvature: Vector2<f64>,
    pub by_lens: SMatrix<f64, 2, 4>,
    /// By the optics' free-form errors but the board's shape, where they were asked for.
    pub free: Option<FreeColumns>,
}

/// How a seen point's pixel moves with the optics' free-form errors.
fn free_columns(eye: &Eye, seen: &Vector3<f64>, foot: Option<&Vector3<f64>>) -> Option<FreeColumns> {
    let (pixel, by_seen) = eye.camera.project_with_point_jacobian(&Point3::from(*seen)).ok()?;
    Some(SeenPoint { eye, seen, pixel: &pixel, by_seen: &by_seen, foot }.columns())
}

/// Where a point is seen in the mirror, without the free-form errors.
fn apparent(eye: &Eye, foot: &Vector3<f64>, point: &Vector3<f64>) -> Option<Vector3<f64>> {
    let plane = Problem::plane(foot)?;
    Some(eye.mirror.apparent_point(&plane, &Point3::from(*point)).ok()?.coords)
}

/// Pixel in the mirror and its derivative by the plane's foot point.
pub(super) fn mirrored_pixel(
    eye: &Eye,
    foot: &Vector3<f64>,
    point: &Vector3<f64>,
) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
    let plane = Problem::plane(foot)?;
    if let Some(free) = &eye.free {
        let seen = eye.mirror.project_with_jacobians(&eye.camera, &plane, &Point3::from(*point)).ok()?;
        let columns = free_columns(eye, &apparent(eye, foot, point)?, Some(foot))?;
        return Some((seen.pixel + columns * free, seen.by_foot_point));
    }
    if eye.mirror == MirrorOptics::IDEAL {
        return ideally_mirrored(eye, foot, point).map(|seen| (seen.0, seen.2));
    }
    let seen = eye.mirror.project_with_jacobians(&eye.camera, &plane, &Point3::from(*point)).ok()?;
    Some((seen.pixel, seen.by_foot_point))
}

/// Pixel in a flat front-surface mirror and its derivatives by the point and the foot point f:
/// `p′ = p + 2 (1 − f·p/f²) f`. The mirror that nearly all sessions have, without the general optics' ray tracing.
pub(super) fn ideally_mirrored(
    eye: &Eye,
    foot: &Vector3<f64>,
    point: &Vector3<f64>,
) -> Option<(Vector2<f64>, Matrix2x3<f64>, Matrix2x3<f64>)> {
    let square = foot.norm_squared();
    let share = foot.dot(point) / square;
    // Behind the mirror nothing is seen; written so that NaN fails.
    if !(share < 1.0) {
        return None;
    }
    let seen = Point3::from(point + foot * (2.0 * (1.0 - share)));
    let (pixel, by_seen) = eye.camera.project_with_point_jacobian(&seen).ok()?;
    let along = by_seen * foot;
    let by_point = by_seen - along * foot.transpose() * (2.0 / square);
    let share_by_foot = (point - foot * (2.0 * share)) / square;
    let by_foot = by_seen * (2.0 * (1.0 - share)) - along * share_by_foot.transpose() * 2.0;
    Some((pixel, by_point, by_foot))
}

pub(super) fn sight_of(
    eye: &Eye,
    via: Via,
    foot: &Vector3<f64>,
    point: &Vector3<f64>,
    lens: bool,
    free: bool,
) -> Option<Sight> {
    let mut sight = without_free_errors(eye, via, foot, point, lens)?;
    if free || eye.free.is_some() {
        let columns = match via {
            Via::Direct => free_columns(eye, point, None)?,
            Via::Mirror => free_columns(eye, &apparent(eye, foot, point)?, Some(foot))?,
        };
        if let Some(values) = &eye.free {
            sight.pixel += columns * values;
        }
        sight.free = Some(columns);
    }
    Some(sight)
}

fn without_free_errors(
    eye: &Eye,
    via: Via,
    foot: &Vector3<f64>,
    point: &Vector3<f64>,
    lens: bool,
) -> Option<Sight> {
    let point = Point3::from(*point);
    let by_lens = |seen: &Point3<f64>| -> Option<SMatrix<f64, 2, 4>> {
        let mut out = SMatrix::<f64, 2, 4>::zeros();
        if lens {
            let projection = eye.camera.project_with_jacobians(seen).ok()?;
            let focal = projection
                .by_intrinsics
                .column(0)
                .component_mul(&Vector2::new(eye.nominal_focal.x, 0.0))
                + projection.by_intrinsics.column(1).component_mul(&Vector2::new(0.0, eye.nominal_focal.y));
            out.set_column(0, &focal);
            out.set_column(1, &projection.by_intrinsics.column(2));
            out.set_column(2, &projection.by_intrinsics.column(3));
            out.set_column(3, &projection.by_distortion.column(0));
        }
        Some(out)
    };
    match via {
        Via::Direct => {
            let (pixel, by_point) = eye.camera.project_with_point_jacobian(&point).ok()?;
            Some(Sight {
                pixel,
                by_point,
                by_foot: Matrix2x3::zeros(),
                by_glass: Vector2::zeros(),
                by_curvature: Vector2::zeros(),
                by_lens: by_lens(&point)?,
                free: None,
            })
        }
        Via::Mirror => {
            let plane = Problem::plane(foot)?;
            if !lens && eye.mirror == MirrorOptics::IDEAL {
                let (pixel, by_point, by_foot) = ideally_mirrored(eye, foot, &point.coords)?;
                return Some(Sight {
                    pixel,
                    by_point,
                    by_foot,
                    by_glass: Vector2::zeros(),
                    by_curvature: Vector2::zeros(),
                    by_lens: SMatrix::zeros(),
                    free: None,
                });
            }
            let seen = eye.mirror.project_with_jacobians(&eye.camera, &plane, &point).ok()?;
            let apparent = if lens { eye.mirror.apparent_point(&plane, &point).ok()? } else { point };
            Some(Sight {
                pixel: seen.pixel,
                by_point: seen.by_point,
                by_foot: seen.by_foot_point,
                by_glass: seen.by_thickness,
                by_curvature: seen.by_curvature,
                by_lens: by_lens(&apparent)?,
                free: None,
            })
        }
    }
}

/// A first plane: the board's reflection lies in the direction of the corners' mean, at the depth at which its picture has
/// the size that it has; the mirror is half-way to it (the paper's Eq. 2 with a crude position).
pub(super) fn start_of_plane(
    problem: &Problem,
    eye: &Eye,
    camera_from_board: &Pose,
    frame: usize,
) -> Option<Vector3<f64>> {
    let corners = &problem.frames[frame].corners;
    let count = corners.len() as f64;
    let mut directions = Vec::with_capacity(corners.len());
    for (index, pixel) in corners {
        directions.push((problem.corners[*index], eye.camera.unproject(pixel).ok()?.into_inner()));
    }
    let mean = directions.iter().map(|d| d.1).sum::<Vector3<f64>>() / count;
    let center = directions.iter().map(|d| d.0).sum::<Vector3<f64>>() / count;
    let spread_angle = (directions.iter().map(|d| (d.1 - mean).norm_squared()).sum::<f64>() / count).sqrt();
    let spread = (directions.iter().map(|d| (d.0 - center).norm_squared()).sum::<f64>() / count).sqrt();
    let reflected = mean.normalize() * (spread / spread_angle.max(1e-9));
    let board = camera_from_board.point(&center);
    let plane = crate::geometry::Plane::between(&Point3::from(board), &Point3::from(reflected)).ok()?;
    let plane = plane.facing_away_from_origin();
    (plane.offset_m() > 1e-3).then(|| plane.foot_point())
}
