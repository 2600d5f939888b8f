//! The rows of a frame: every observation predicted, whitened, weighted.

use super::rows::Rows;
use super::sight::{Sight, Wanted, sight_of};
use super::work::{FrameWork, OpticsColumns, Task};
use crate::diagnose::data::recording::Via;
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::camera_and_mirror::Eye;
use crate::diagnose::model::free_optics::{board_columns, corner_point};
use crate::diagnose::model::pose::Pose;
use crate::diagnose::model::problem::{FrameData, Observation, Problem, Seen};
use crate::diagnose::model::robust::{Mixture, Robust};
use crate::diagnose::model::work_budget::Effort;
use crate::geometry::Reflection;
use nalgebra::{Matrix3, Point3, Vector2, Vector3};

#[derive(Clone, Copy)]
pub(super) struct Corner {
    index: usize,
    board: Option<NodeId>,
}

#[derive(Clone, Copy)]
pub(super) enum SeenAt {
    Marker(usize),
    Corner(Corner),
}

pub(super) fn pixel_mixture(eye: &Eye, std: f64) -> Mixture {
    let (w, h) = eye.camera.size_px();
    Mixture::new(std, 2, f64::from(w) * f64::from(h))
}

impl FrameWork {
    /// The cost of all that is seen in a mirror that the model does not find, −2 log likelihood.
    pub(super) fn unpredicted(eye: &Eye, task: &Task<'_>, data: &FrameData) -> f64 {
        let false_at = |std: f64| pixel_mixture(eye, std).of(f64::INFINITY).cost;
        let others = data.others.iter().map(|observation| match observation {
            Observation::Pixel { seen: Seen::Marker(_), via: Via::Mirror, .. } => {
                false_at(task.noise.marker_px)
            }
            Observation::Pixel { seen: Seen::Corner(_), via: Via::Mirror, .. } => {
                false_at(task.noise.corner_px)
            }
            Observation::Pixel { .. } | Observation::Point { .. } => 0.0,
        });
        data.corners.len() as f64 * false_at(task.noise.corner_px) + others.sum::<f64>()
    }

    pub(super) fn observe_board(&mut self, problem: &Problem, task: &Task<'_>, data: &FrameData) {
        let (Some(eye), Some(board)) = (task.eye, problem.board_in(self.frame)) else { return };
        let camera_from_world = self.camera_from_world(problem, eye);
        let world_from_board = self.world_from_board(&board);
        let mixture = pixel_mixture(eye, task.noise.corner_px);
        let wanted = if task.with_board { task.wanted } else { Wanted::default() };
        for (index, pixel) in &data.corners {
            let seen = Corner { index: *index, board: board.node };
            self.push_pixel(
                problem,
                task,
                (eye, &camera_from_world),
                &world_from_board,
                (Via::Mirror, SeenAt::Corner(seen)),
                pixel,
                task.noise.corner_px,
                &mixture,
                wanted,
            );
        }
    }

    pub(super) fn observe(&mut self, problem: &Problem, task: &Task<'_>, data: &FrameData, full: bool) {
        self.spent_ns += Effort::Frame { observations: data.others.len() }.nanoseconds();
        let before = task.eye.map(|eye| (eye, self.camera_from_world(problem, eye)));
        let wanted = if full && task.with_board { task.wanted } else { Wanted::default() };
        let together = before.as_ref().is_some_and(|(eye, camera_from_world)| {
            self.see_markers(problem, task, data, (eye, camera_from_world), wanted)
        });
        let of_markers = before.as_ref().map(|(eye, _)| pixel_mixture(eye, task.noise.marker_px));
        let mut in_mirror = 0;
        for observation in &data.others {
            match observation {
                Observation::Pixel { seen, via, pixel } => {
                    let (Some((eye, camera_from_world)), Some(of_markers)) = (&before, &of_markers) else {
                        continue;
                    };
                    if *via == Via::Mirror && !self.has_plane {
                        continue;
                    }
                    let from_world = (*eye, camera_from_world);
                    match seen {
                        Seen::Marker(m) if together && *via == Via::Mirror => {
                            let which = (in_mirror, *m);
                            in_mirror += 1;
                            self.push_marker(problem, task, from_world, which, pixel, of_markers, wanted);
                        }
                        Seen::Marker(m) => {
                            let pose = self.marker_mount_pose(problem, task, *m);
                            let (at, std) = ((*via, SeenAt::Marker(*m)), task.noise.marker_px);
                            self.push_pixel(
                                problem, task, from_world, &pose, at, pixel, std, of_markers, wanted,
                            );
                        }
                        Seen::Corner(index) => {
                            let Some(board) = problem.board_in(self.frame) else { continue };
                            let at = (*via, SeenAt::Corner(Corner { index: *index, board: board.node }));
                            let (pose, std) = (self.world_from_board(&board), task.noise.corner_px);
                            let mixture = pixel_mixture(eye, std);
                            self.push_pixel(
                                problem, task, from_world, &pose, at, pixel, std, &mixture, wanted,
                            );
                        }
                    }
                }
                Observation::Point { marker, position } => self.push_point(problem, task, *marker, position),
            }
        }
    }

    /// Pose of the frame of a marker's centre, its shift included.
    pub(super) fn marker_mount_pose(&self, problem: &Problem, task: &Task<'_>, marker: usize) -> Pose {
        let shift =
            task.deformation.marker_shift_in(self.frame, marker) + problem.marker_slip_in(self.frame, marker);
        let mut pose = self.poses.site(&problem.marker_sites[marker]);
        if shift != Vector3::zeros() {
            pose.t += self.poses.site(&problem.marker_mounts[marker]).r * shift;
        }
        pose
    }

    pub(super) fn push_pixel(
        &mut self,
        problem: &Problem,
        task: &Task<'_>,
        (eye, camera_from_world): (&Eye, &Pose),
        world_from_target: &Pose,
        (via, seen): (Via, SeenAt),
        pixel: &Vector2<f64>,
        std: f64,
        mixture: &Mixture,
        wanted: Wanted,
    ) {
        let (local, marker) = match seen {
            SeenAt::Marker(m) => (Vector3::zeros(), Some(m)),
            SeenAt::Corner(c) => {
                (corner_point(problem, eye, c.index, 1.0 + task.deformation.board_scale_error), None)
            }
        };
        let shift =
            marker.map_or_else(Vector2::zeros, |_| task.deformation.marker_image * eye.in_picture(pixel));
        let point = world_from_target.point(&local);
        let in_camera = camera_from_world.point(&point);
        let sight = sight_of(eye, via, &self.foot, &in_camera, wanted)
            .map(|sight| (sight, self.outline_offset(problem, eye, via, marker, &in_camera) + shift));
        let from_world = (eye, camera_from_world);
        let place = (world_from_target, point, in_camera);
        self.push_seen(problem, task, from_world, (via, seen), place, sight, pixel, std, mixture, wanted);
    }

    /// Adds the rows of an observation with a given sight and outline offset (none where it cannot be predicted).
    /// `place`: the pose of what it is of, and the point, in the world and in the camera's frame.
    pub(super) fn push_seen(
        &mut self,
        problem: &Problem,
        task: &Task<'_>,
        (eye, camera_from_world): (&Eye, &Pose),
        (via, seen): (Via, SeenAt),
        (world_from_target, point, in_camera): (&Pose, Vector3<f64>, Vector3<f64>),
        sight: Option<(Sight, Vector2<f64>)>,
        pixel: &Vector2<f64>,
        std: f64,
        mixture: &Mixture,
        wanted: Wanted,
    ) {
        let (node, marker) = match seen {
            SeenAt::Marker(m) => (problem.marker_sites[m].node, Some(m)),
            SeenAt::Corner(c) => (c.board, None),
        };
        let Some((sight, outline)) = sight else {
            // An observation that cannot be predicted (for example behind the mirror) costs as much as a false one.
            self.cost += mixture.of(f64::INFINITY).cost;
            return;
        };
        let r = (pixel - sight.pixel - outline) / std;
        let robust =
            if task.gaussian { Robust::gaussian(r.norm_squared()) } else { mixture.of(r.norm_squared()) };
        self.cost += robust.cost;
        let root_weight = robust.weight.sqrt();
        let scale = root_weight / std;
        let mut by_camera = Matrix3::zeros();
        by_camera.fixed_view_mut::<2, 3>(0, 0).copy_from(&(sight.by_point * scale));
        let mut plane = Matrix3::zeros();
        if via == Via::Mirror {
            plane.fixed_view_mut::<2, 3>(0, 0).copy_from(&(sight.by_foot * scale));
        }
        let optics = wanted.optics.then(|| {
            let by_camera = by_camera.fixed_rows::<2>(0);
            let mut optics = OpticsColumns::zeros();
            // p_real = Exp(ω)ᵀ (p − v): ∂/∂ω = p̂ J_r(ω), ∂/∂v = −Exp(ω)ᵀ.
            // Condensed corners have them by the board's motion.
            if !(task.condenses() && via == Via::Mirror && marker.is_none()) {
                optics
                    .fixed_columns_mut::<3>(0)
                    .copy_from(&(by_camera * (in_camera.cross_matrix() * eye.mount_jacobian)));
                optics.fixed_columns_mut::<3>(3).copy_from(&-(by_camera * eye.camera_from_mount.r));
            }
            optics.fixed_columns_mut::<4>(6).copy_from(&(sight.by_lens * scale));
            if let SeenAt::Corner(c) = seen {
                let by_scale = camera_from_world.r * (world_from_target.r * problem.corners[c.index]);
                optics.set_column(10, &(by_camera * by_scale));
            }
            optics.set_column(11, &(sight.by_glass * scale));
            optics.set_column(12, &(sight.by_curvature * scale));
            self.optics.push(optics);
            self.optics.len() - 1
        });
        let free = sight.free.filter(|_| wanted.free).map(|mut columns| {
            if let SeenAt::Corner(c) = seen {
                let by_board = sight.by_point * (camera_from_world.r * world_from_target.r);
                board_columns(problem, c.index, &by_board, &mut columns);
            }
            self.free.push(*columns * scale);
            self.free.len() - 1
        });
        let observer = problem.camera_site.and_then(|s| s.node);
        self.rows.push(Rows {
            count: 2,
            continues: self.rows.last().is_some_and(|last| last.is_of(node, observer, marker)),
            node,
            observer,
            marker,
            residual: Vector3::new(r.x * root_weight, r.y * root_weight, 0.0),
            scale,
            in_picture: eye.in_picture(pixel),
            by_world: by_camera * camera_from_world.r,
            point,
            plane,
            optics,
            free,
            measured: false,
        });
    }

    /// From the picture of a ball's centre to the centroid of its outline, px; 0 where the session's points are of centres.
    pub(super) fn outline_offset(
        &self,
        problem: &Problem,
        eye: &Eye,
        via: Via,
        marker: Option<usize>,
        in_camera: &Vector3<f64>,
    ) -> Vector2<f64> {
        let Some(ball) = marker.filter(|_| problem.outlines).map(|m| problem.balls[m]) else {
            return Vector2::zeros();
        };
        if ball.radius_m() == 0.0 {
            return Vector2::zeros();
        }
        let seen = match (via, Problem::plane(&self.foot)) {
            (Via::Mirror, Some(plane)) => Reflection::across(plane).point(&Point3::from(*in_camera)),
            _ => Point3::from(*in_camera),
        };
        match (ball.project(&eye.camera, &seen), eye.camera.project(&seen)) {
            (Ok(centroid), Ok(center)) => centroid - center,
            _ => Vector2::zeros(),
        }
    }

    pub(super) fn push_point(
        &mut self,
        problem: &Problem,
        task: &Task<'_>,
        marker: usize,
        position: &Vector3<f64>,
    ) {
        let Some(site) = problem.points_site else { return };
        let observer = self.poses.site(&site);
        let point = self.marker_mount_pose(problem, task, marker).t;
        let mut in_observer = observer.inverse_point(&point);
        let mut observed_from_world = observer.r.transpose();
        if let Some(pose) = &self.points_from_link {
            in_observer = pose.point(&in_observer);
            observed_from_world = pose.r * observed_from_world;
        }
        let std = task.noise.point_m;
        let r = (position - in_observer) / std;
        // False points fill a cube of a metre.
        let squared = r.norm_squared();
        let robust =
            if task.gaussian { Robust::gaussian(squared) } else { Mixture::new(std, 3, 1.0).of(squared) };
        self.cost += robust.cost;
        let root_weight = robust.weight.sqrt();
        let scale = root_weight / std;
        let node = problem.marker_sites[marker].node;
        self.rows.push(Rows {
            count: 3,
            continues: self.rows.last().is_some_and(|last| last.is_of(node, site.node, Some(marker))),
            node,
            observer: site.node,
            marker: Some(marker),
            residual: r * root_weight,
            scale,
            in_picture: Vector3::zeros(),
            by_world: observed_from_world * scale,
            point,
            plane: Matrix3::zeros(),
            optics: None,
            free: None,
            measured: true,
        });
    }
}
