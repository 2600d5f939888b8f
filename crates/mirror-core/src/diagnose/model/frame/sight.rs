//! Derivatives of an image point by the point, by the mirror's plane and by the lens.

use crate::diagnose::data::recording::Via;
use crate::diagnose::model::camera_and_mirror::Eye;
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::free_optics::{FreeColumns, SeenPoint};
use crate::diagnose::model::problem::Problem;
use crate::mirror::ApparentPoint;
use nalgebra::{Matrix2x3, Matrix3, Point3, SMatrix, Vector2, Vector3};

/// Which columns of the optics will be read: the others are not computed.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Wanted {
    /// Of the optics at all.
    pub optics: bool,
    pub lens: bool,
    pub mirror: bool,
    /// Of the free-form errors.
    pub free: bool,
}

impl Wanted {
    /// What these columns need.
    pub fn by(columns: &[Column]) -> Self {
        let any = |what: fn(Atom) -> bool| columns.iter().any(|c| what(c.atom));
        Self {
            optics: any(Atom::is_optical),
            lens: any(|a| matches!(a, Atom::Focal | Atom::Center(_) | Atom::Dk1)),
            mirror: any(|a| matches!(a, Atom::Glass | Atom::Curvature)),
            free: any(|a| matches!(a, Atom::FreeOptics(_))),
        }
    }
}

/// How an image point depends on everything, px.
pub(super) struct Sight {
    pub pixel: Vector2<f64>,
    pub by_point: Matrix2x3<f64>,
    pub by_foot: Matrix2x3<f64>,
    pub by_glass: Vector2<f64>,
    pub by_curvature: Vector2<f64>,
    pub by_lens: SMatrix<f64, 2, 4>,
    /// By the optics' free-form errors except the board's shape, if requested.
    pub free: Option<Box<FreeColumns>>,
}

/// Where a point is seen, camera frame, and how that depends on the point and on the mirror.
fn apparent(eye: &Eye, foot: &Vector3<f64>, point: &Vector3<f64>, by_mirror: bool) -> Option<ApparentPoint> {
    if eye.mirror.is_ideal() {
        let index = by_mirror.then(|| eye.mirror.pane.refractive_index());
        return ideally_reflected(foot, point, index);
    }
    let (plane, point) = (Problem::plane(foot)?, Point3::from(*point));
    if by_mirror {
        eye.mirror.apparent_point_with_jacobians(&plane, &point).ok()
    } else {
        eye.mirror.apparent_point_in_loop(&plane, &point).ok()
    }
}

/// In a flat front-surface mirror of foot point f: `p′ = p + 2 (1 − f·p/f²) f`. The mirror of nearly all sessions,
/// without the general optics. With the glass's refractive index its derivatives by a pane's thickness and by a
/// curvature, both where they are 0: `2 (n² + (n² − 1) P/E²)^(−½)` and `−P σ (2 − σ) − 2 d (d − h)` along the
/// normal, d being the mirror's distance, h the point's height, P the square of its distance from the axis, `E = 2
/// d − h`, σ = d/E.
fn ideally_reflected(
    foot: &Vector3<f64>,
    point: &Vector3<f64>,
    refractive_index: Option<f64>,
) -> Option<ApparentPoint> {
    let square = foot.norm_squared();
    let share = foot.dot(point) / square;
    // Behind the mirror nothing is seen; written so that NaN fails.
    if !(share < 1.0) {
        return None;
    }
    let by_mirror = refractive_index.map_or([0.0; 2], |index| {
        let distance = square.sqrt();
        let height = share * distance;
        let lateral = point.norm_squared() - height * height;
        let (depth, n2) = (2.0 * distance - height, index * index);
        let sigma = distance / depth;
        let by_thickness = 2.0 / (n2 + (n2 - 1.0) * lateral / (depth * depth)).sqrt();
        let by_curvature = -lateral * sigma * (2.0 - sigma) - 2.0 * distance * (distance - height);
        [by_thickness / distance, by_curvature / distance]
    });
    let share_by_foot = (point - foot * (2.0 * share)) / square;
    Some(ApparentPoint {
        point: Point3::from(point + foot * (2.0 * (1.0 - share))),
        by_point: Matrix3::identity() - foot * foot.transpose() * (2.0 / square),
        by_foot_point: Matrix3::identity() * (2.0 * (1.0 - share)) - foot * share_by_foot.transpose() * 2.0,
        by_thickness: foot * by_mirror[0],
        by_curvature: foot * by_mirror[1],
    })
}

/// Pixel in the mirror and its derivative by the plane's foot point.
pub(super) fn mirrored_pixel(
    eye: &Eye,
    foot: &Vector3<f64>,
    point: &Vector3<f64>,
) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
    let seen = apparent(eye, foot, point, false)?;
    let (mut pixel, by_seen) = eye.camera.project_with_point_jacobian(&seen.point).ok()?;
    if let Some(free) = &eye.free {
        let at =
            SeenPoint { eye, seen: &seen.point.coords, pixel: &pixel, by_seen: &by_seen, foot: Some(foot) };
        pixel += at.columns() * free;
    }
    Some((pixel, by_seen * seen.by_foot_point))
}

/// Where a point is seen in the image, with the columns that are wanted.
pub(super) fn sight_of(
    eye: &Eye,
    via: Via,
    foot: &Vector3<f64>,
    point: &Vector3<f64>,
    wanted: Wanted,
) -> Option<Sight> {
    let seen = match via {
        Via::Mirror => apparent(eye, foot, point, wanted.mirror)?,
        Via::Direct => ApparentPoint {
            point: Point3::from(*point),
            by_point: Matrix3::identity(),
            by_foot_point: Matrix3::zeros(),
            by_thickness: Vector3::zeros(),
            by_curvature: Vector3::zeros(),
        },
    };
    let mut by_lens = SMatrix::<f64, 2, 4>::zeros();
    if wanted.lens {
        let projection = eye.camera.project_with_jacobians(&seen.point).ok()?;
        let focal = projection.by_intrinsics.column(0).component_mul(&Vector2::new(eye.nominal_focal.x, 0.0))
            + projection.by_intrinsics.column(1).component_mul(&Vector2::new(0.0, eye.nominal_focal.y));
        by_lens.set_column(0, &focal);
        by_lens.set_column(1, &projection.by_intrinsics.column(2));
        by_lens.set_column(2, &projection.by_intrinsics.column(3));
        by_lens.set_column(3, &projection.by_distortion.column(0));
    }
    let (mut pixel, by_seen) = eye.camera.project_with_point_jacobian(&seen.point).ok()?;
    let mut free = None;
    if wanted.free || eye.free.is_some() {
        let foot = (via == Via::Mirror).then_some(foot);
        let at = SeenPoint { eye, seen: &seen.point.coords, pixel: &pixel, by_seen: &by_seen, foot };
        let columns = at.columns();
        if let Some(values) = &eye.free {
            pixel += columns * values;
        }
        free = wanted.free.then(|| Box::new(columns));
    }
    Some(Sight {
        pixel,
        by_point: by_seen * seen.by_point,
        by_foot: by_seen * seen.by_foot_point,
        by_glass: by_seen * seen.by_thickness,
        by_curvature: by_seen * seen.by_curvature,
        by_lens,
        free,
    })
}
