//! Rows of a frame's markers in the mirror, computed together.

use super::mirror_and_lens::MirrorAndLens;
use super::observe::{SeenAt, pixel_mixture};
use super::plane_of_frame::{PlaneKnown, Pull};
use super::sight::Wanted;
use super::work::{FrameWork, Task};
use crate::diagnose::data::recording::Via;
use crate::diagnose::model::camera_and_mirror::Eye;
use crate::diagnose::model::pose::Pose;
use crate::diagnose::model::problem::{FrameData, Observation, Problem, Seen};
use crate::diagnose::model::robust::Mixture;
use nalgebra::{Matrix2x3, Vector2};

impl FrameWork {
    /// Computes the image points of all markers in the mirror at the present plane, in [`FrameWork::markers`]; false where
    /// they must be computed one by one.
    pub(super) fn see_markers(
        &mut self,
        problem: &Problem,
        task: &Task<'_>,
        data: &FrameData,
        (eye, camera_from_world): (&Eye, &Pose),
        wanted: Wanted,
    ) -> bool {
        let Some(mirror) = MirrorAndLens::of(eye, &self.foot).filter(|_| self.has_plane && !wanted.free)
        else {
            return false;
        };
        if !self.markers.posed {
            self.pose_markers(problem, task, data, camera_from_world);
        }
        self.markers.see(&mirror, self.foot);
        true
    }

    fn pose_markers(
        &mut self,
        problem: &Problem,
        task: &Task<'_>,
        data: &FrameData,
        camera_from_world: &Pose,
    ) {
        let mut markers = core::mem::take(&mut self.markers);
        markers.clear();
        for observation in &data.others {
            let Observation::Pixel { seen: Seen::Marker(m), via: Via::Mirror, .. } = observation else {
                continue;
            };
            let world = self.marker_mount_pose(problem, task, *m).t;
            let radius = if problem.outlines { problem.balls[*m].radius_m() } else { 0.0 };
            markers.push(world, camera_from_world.point(&world), radius);
        }
        markers.fill_up();
        self.markers = markers;
    }

    /// Information on the plane from the markers in the mirror; none where they must be computed one by one.
    pub(super) fn pull_of_markers(
        &mut self,
        problem: &Problem,
        task: &Task<'_>,
        data: &FrameData,
        known: &PlaneKnown,
    ) -> Option<Pull> {
        let eye = task.eye?;
        let camera_from_world = self.camera_from_world(problem, eye);
        if !self.see_markers(problem, task, data, (eye, &camera_from_world), Wanted::default()) {
            return None;
        }
        let (markers, std, by_pixel) = (&self.markers, task.noise.marker_px, &task.deformation.marker_image);
        let mixture = (!task.gaussian).then(|| pixel_mixture(eye, std));
        let mut pull = Pull::zero();
        let pixels = data.others.iter().filter_map(|observation| match observation {
            Observation::Pixel { seen: Seen::Marker(_), via: Via::Mirror, pixel } => Some(pixel),
            _ => None,
        });
        for (i, pixel) in pixels.enumerate() {
            let Some((picture, by_foot)) = markers.by_foot(i) else { continue };
            let shift = by_pixel * eye.in_picture(pixel);
            let r = (pixel - picture - markers.offset(i) - shift) / std;
            let [u, v] = by_foot.map(|row| row.transpose() / std);
            pull.add(mixture.as_ref(), known, &Matrix2x3::from_rows(&[u, v]), &r);
        }
        Some(pull)
    }

    /// As [`FrameWork::push_pixel`], of the i-th of [`FrameWork::markers`].
    pub(super) fn push_marker(
        &mut self,
        problem: &Problem,
        task: &Task<'_>,
        (eye, camera_from_world): (&Eye, &Pose),
        (i, marker): (usize, usize),
        pixel: &Vector2<f64>,
        mixture: &Mixture,
        wanted: Wanted,
    ) {
        let (world, camera) = (self.markers.world[i], self.markers.camera[i]);
        let offset = self.markers.offset(i) + task.deformation.marker_image * eye.in_picture(pixel);
        let sight = self.markers.sight(i, &eye.nominal_focal, wanted).map(|sight| (sight, offset));
        let from_world = (eye, camera_from_world);
        let at = (Via::Mirror, SeenAt::Marker(marker));
        // A marker's own pose in the world is asked for by corners alone.
        let place = (&Pose { t: world, ..Pose::identity() }, world, camera);
        self.push_seen(
            problem,
            task,
            from_world,
            at,
            place,
            sight,
            pixel,
            task.noise.marker_px,
            mixture,
            wanted,
        );
    }
}
