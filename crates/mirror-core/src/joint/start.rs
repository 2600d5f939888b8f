//! Start values of the joint iteration: single-view planes, and the nearest point of each marker's rays.

use super::problem::{JointFrame, JointOptions, Layout, PointStatus, PointView};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::geometry::{Plane, Ray};
use crate::mirror::Via;
use crate::mirror::{Board, BoardView, EstimatorOptions, MirrorEstimator, Rig};
use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use rayon::prelude::*;

/// The start of everything that is unknown.
pub(crate) struct Start {
    /// `camera_from_nominal_camera`.
    pub correction: Isometry3<f64>,
    /// By frame.
    pub planes: Vec<Plane>,
    /// The points that are used, by posture, then marker.
    pub points: Vec<StartPoint>,
}

pub(crate) struct StartPoint {
    pub posture: usize,
    pub marker: usize,
    pub at: Point3<f64>,
    pub(super) views: Vec<PointView>,
}

/// Single-view plane of a frame: maximum likelihood with the nominal transform and the mirror's optics.
fn start_plane(rig: &Rig, view: &BoardView, options: &JointOptions) -> Result<Plane> {
    let single = EstimatorOptions { loss: options.loss, ..EstimatorOptions::default() };
    Ok(MirrorEstimator::MaximumLikelihood.estimate(rig, view, &single)?.plane)
}

/// The point nearest to all rays (least squares of the distances): `Σ (I − r rᵀ) (x − o) = 0`.
fn nearest_point(rays: &[Ray]) -> Option<Point3<f64>> {
    let mut matrix = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for ray in rays {
        let r = ray.direction.into_inner();
        let across = Matrix3::identity() - r * r.transpose();
        matrix += across;
        right += across * ray.origin.coords;
    }
    matrix.cholesky().map(|factor| Point3::from(factor.solve(&right)))
}

/// The widest angle between two of the lines, rad.
fn widest_angle_rad(rays: &[Ray]) -> f64 {
    let mut widest: f64 = 0.0;
    for (i, a) in rays.iter().enumerate() {
        for b in &rays[..i] {
            let sine = a.direction.cross(&b.direction).norm();
            widest = widest.max(sine.atan2(a.direction.dot(&b.direction).abs()));
        }
    }
    widest
}

/// The start values of all unknowns, and for each point of the layout whether it is used.
pub(super) fn start(
    camera: &Camera,
    board: &Board,
    frames: &[JointFrame],
    layout: Layout,
    options: &JointOptions,
) -> Result<(Start, Vec<PointStatus>)> {
    let planes: Vec<Plane> = frames
        .par_iter()
        .enumerate()
        .map(|(index, frame)| {
            let rig =
                Rig::new(camera.clone(), *board, frame.nominal_camera_from_board).with_optics(options.optics);
            start_plane(&rig, &frame.corners, options)
                .map_err(|source| Error::InView { view: index, source: Box::new(source) })
        })
        .collect::<Result<_>>()?;
    let mut statuses = Vec::with_capacity(layout.points.len());
    let mut points = Vec::with_capacity(layout.points.len());
    for point in layout.points {
        if point.views.len() < 2 {
            statuses.push(PointStatus::TooFewViews { views: point.views.len() });
            continue;
        }
        let ray = |view: &PointView| -> Result<Ray> {
            let direction = camera.unproject(&view.pixel)?;
            match view.via {
                Via::Direct => Ok(Ray { origin: Point3::origin(), direction }),
                Via::Mirror => options.optics.virtual_ray(&planes[view.frame], &direction),
            }
        };
        let rays = point.views.iter().map(|view| ray(view).map_err(|_| view.frame));
        let rays: Vec<Ray> = match rays.collect::<core::result::Result<_, _>>() {
            Ok(rays) => rays,
            Err(frame) => {
                statuses.push(PointStatus::NoRay { frame });
                continue;
            }
        };
        let got_rad = widest_angle_rad(&rays);
        let needed_rad = options.least_parallax_rad;
        let Some(at) = nearest_point(&rays).filter(|_| got_rad >= needed_rad) else {
            statuses.push(PointStatus::TooLittleParallax { got_rad, needed_rad });
            continue;
        };
        let visible = point.views.iter().all(|view| match view.via {
            Via::Direct => at.z > 0.0,
            Via::Mirror => {
                options.optics.apparent_point(&planes[view.frame], &at).is_ok_and(|seen| seen.z > 0.0)
            }
        });
        if !visible {
            statuses.push(PointStatus::WrongSide);
            continue;
        }
        statuses.push(PointStatus::Measured);
        points.push(StartPoint { posture: point.posture, marker: point.marker, at, views: point.views });
    }
    Ok((Start { correction: Isometry3::identity(), planes, points }, statuses))
}
