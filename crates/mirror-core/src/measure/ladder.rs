//! View by view: mirrors, virtual rays, markers.

use super::options::MeasureOptions;
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::joint::{JointFrame, Via};
use crate::mirror::{Board, MirrorEstimate, Rig, Sphere, VirtualRay};
use crate::triangulate::{
    MarkerView, Triangulated, Triangulator, lee_civera_mid2, maximum_likelihood, midpoint, unbiased,
};
use nalgebra::{Point3, Vector2};
use rayon::prelude::*;

/// A marker of a posture: its position, or the reason why it is unknown.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasuredMarker {
    /// The posture's number.
    pub posture: i64,
    /// Which marker.
    pub marker: usize,
    /// Number of its views with a known mirror.
    pub views: usize,
    /// In the camera frame of the posture.
    pub result: Result<Triangulated>,
}

/// What one estimator makes of a session.
#[derive(Debug, Clone, PartialEq)]
pub struct LadderMeasurement {
    /// The mirror of each frame, or the reason why it is unknown.
    pub mirrors: Vec<Result<MirrorEstimate>>,
    /// The markers that any frame sees, by posture, then marker.
    pub markers: Vec<MeasuredMarker>,
}

struct Sighting {
    frame: usize,
    pixel: Vector2<f64>,
}

/// Measures a session by one estimator: the mirror of each frame, then each posture's markers from all its views.
///
/// A ball's pixels are first corrected for the ellipse's centre ([`Sphere::center_pixel`]), with the path's length from a first
/// triangulation. Markers seen without the mirror are left to [`crate::joint`].
///
/// # Errors
/// Of the options; [`Error::HeadMoved`] where the camera moved against the board between the views of one posture;
/// [`Error::OutOfRange`] for a marker that has no sphere. What concerns one frame or marker stands in its own result.
pub fn measure_ladder(
    camera: &Camera,
    board: &Board,
    spheres: &[Sphere],
    frames: &[JointFrame],
    options: &MeasureOptions,
) -> Result<LadderMeasurement> {
    let options = options.clone().validated()?;
    let groups = group(frames, spheres.len())?;
    let rig = |frame: &JointFrame| -> Result<Rig> {
        let rig =
            Rig::new(camera.clone(), *board, frame.nominal_camera_from_board).with_optics(options.optics);
        match options.triangulation.camera_from_board_covariance {
            Some(covariance) => rig.with_covariance(covariance),
            None => Ok(rig),
        }
    };
    let mirrors: Vec<_> = frames
        .par_iter()
        .map(|frame| {
            options.cancel.check()?;
            options.estimator.estimate(&rig(frame)?, &frame.corners, &options.corners)
        })
        .collect();
    let markers = groups
        .into_par_iter()
        .map(|(posture, marker, sightings)| {
            let views: Vec<(&MirrorEstimate, Vector2<f64>)> = sightings
                .iter()
                .filter_map(|s| mirrors[s.frame].as_ref().ok().map(|mirror| (mirror, s.pixel)))
                .collect();
            let result =
                options.cancel.check().and_then(|()| locate(camera, &spheres[marker], &views, &options));
            MeasuredMarker { posture, marker, views: views.len(), result }
        })
        .collect();
    options.cancel.check()?;
    Ok(LadderMeasurement { mirrors, markers })
}

/// Sightings in the mirror by (posture, marker), in that order.
fn group(frames: &[JointFrame], marker_count: usize) -> Result<Vec<(i64, usize, Vec<Sighting>)>> {
    let mut order: Vec<usize> = (0..frames.len()).collect();
    order.sort_by_key(|&index| frames[index].posture);
    let mut groups = Vec::new();
    for views in order.chunk_by(|&a, &b| frames[a].posture == frames[b].posture) {
        let first = &frames[views[0]];
        let mut slots: Vec<Vec<Sighting>> = Vec::new();
        slots.resize_with(marker_count, Vec::new);
        for &index in views {
            let frame = &frames[index];
            first.check_same_head(frame)?;
            for sight in frame.markers.iter().filter(|sight| sight.via == Via::Mirror) {
                let slot = slots.get_mut(sight.marker).ok_or_else(|| Error::OutOfRange {
                    what: format!("marker of frame {index}"),
                    got: sight.marker as f64,
                    needed: format!("below {marker_count}, the number of markers"),
                })?;
                slot.push(Sighting { frame: index, pixel: sight.pixel });
            }
        }
        let seen = slots.into_iter().enumerate().filter(|(_, sightings)| !sightings.is_empty());
        groups.extend(seen.map(|(marker, sightings)| (first.posture, marker, sightings)));
    }
    Ok(groups)
}

/// One marker from its views.
fn locate(
    camera: &Camera,
    sphere: &Sphere,
    views: &[(&MirrorEstimate, Vector2<f64>)],
    options: &MeasureOptions,
) -> Result<Triangulated> {
    let noise = options.marker_noise_px;
    let rays = |pixels: &[Vector2<f64>]| -> Result<Vec<VirtualRay>> {
        let both = views.iter().zip(pixels);
        both.map(|((mirror, _), pixel)| mirror.virtual_camera().ray(camera, pixel, noise)).collect()
    };
    let centroids: Vec<_> = views.iter().map(|(_, pixel)| *pixel).collect();
    let first = midpoint(&rays(&centroids)?, &options.triangulation)?;
    let centers: Vec<_> = views
        .iter()
        .map(|(mirror, pixel)| {
            if sphere.radius_m() == 0.0 {
                return Ok(*pixel);
            }
            sphere.center_pixel(camera, pixel, path_m(mirror, &first.point_in_camera))
        })
        .collect::<Result<_>>()?;
    match options.triangulator()? {
        Triangulator::Midpoint => midpoint(&rays(&centers)?, &options.triangulation),
        Triangulator::LeeCiveraMid2 => lee_civera_mid2(&rays(&centers)?, &options.triangulation),
        Triangulator::Unbiased => unbiased(&rays(&centers)?, &options.triangulation),
        Triangulator::MaximumLikelihood => {
            let seen = views.iter().zip(&centers);
            let seen: Vec<_> = seen
                .map(|((mirror, _), pixel)| MarkerView::new(mirror, *pixel, noise))
                .collect::<Result<_>>()?;
            maximum_likelihood(camera, &seen, &options.triangulation)
        }
    }
}

/// Length of the light's path from a point by the mirror to the camera, m.
fn path_m(mirror: &MirrorEstimate, point: &Point3<f64>) -> f64 {
    crate::geometry::Reflection::across(mirror.plane).point(point).coords.norm()
}
