//! One frame of the exact forward model: predictions, residuals and the rows of any column, the mirror projected out.
//!
//! For given deformation the frame's mirror plane is fitted to all that the frame shows (variable projection), then all is
//! linearised there. With rows whitened, plane rows D, `G = DᵀD = L Lᵀ`, a column x enters the reduced normal equations as
//! `⟨x, y⟩ = x·y − (L⁻¹Dᵀx)·(L⁻¹Dᵀy)`: each vector is stored as its rows followed by the three numbers `L⁻¹Dᵀx`.

use super::atoms::{Atom, body_twist, moves};
use super::body::NodeId;
use super::deformation::Deformation;
use super::kinematics::NodePoses;
use super::observations::Via;
use super::pose::Pose;
use super::problem::{BoardFit, Eye, Noise, Observation, Problem, Seen};
use super::robust::{Mixture, Robust};
use crate::geometry::Reflection;
use crate::mirror::MirrorOptics;
use nalgebra::{Matrix2x3, Matrix3, Point3, SMatrix, Vector2, Vector3};

/// Gauss–Newton steps for a board's plane; it starts within millimetres and converges quadratically.
const BOARD_STEPS: usize = 12;
/// Steps that a plane takes from the board's own optimum to that of the whole frame: a tiny way.
const PLANE_STEPS: usize = 2;
/// A board with fewer corners than this does not show a plane with a margin.
const FEWEST_CORNERS: usize = 4;
/// Extra numbers behind a column's rows: its projection on the plane's three parameters.
pub(crate) const PROJECTED: usize = 3;

/// How an image point depends on everything, px.
struct Sight {
    pixel: Vector2<f64>,
    by_point: Matrix2x3<f64>,
    by_foot: Matrix2x3<f64>,
    by_glass: Vector2<f64>,
    by_curvature: Vector2<f64>,
    by_lens: SMatrix<f64, 2, 4>,
}

/// The rows of one observation (two of an image point, three of a measured point), whitened.
#[derive(Debug, Clone)]
struct Rows {
    count: usize,
    node: Option<NodeId>,
    observer: Option<NodeId>,
    marker: Option<usize>,
    residual: Vector3<f64>,
    /// Square root of the weight, over the standard deviation.
    scale: f64,
    /// Rows by displacement of the point in the world.
    by_world: Matrix3<f64>,
    /// The point in the world.
    point: Vector3<f64>,
    plane: Matrix3<f64>,
    /// By camera mount (6), focal, cx, cy, k1, board scale, glass, curvature.
    optics: SMatrix<f64, 3, 13>,
    measured: bool,
}

/// Reusable memory for one frame.
pub(crate) struct FrameWork {
    frame: usize,
    pub poses: NodePoses,
    rows: Vec<Rows>,
    /// How many of `rows` are board corners (first).
    pub foot: Vector3<f64>,
    plane_inverse_factor: Matrix3<f64>,
    has_plane: bool,
    /// Negative twice the frame's log likelihood (0 at a perfect fit).
    pub cost: f64,
    /// Rows in all, without the projected ones.
    pub row_count: usize,
    board_gradient: Vector3<f64>,
    /// Whitened χ² of the board above that at its own best plane.
    pub board_excess: f64,
    root: Pose,
    unknown: Option<Pose>,
    pub residual: Vec<f64>,
}

/// How to evaluate a frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Task<'a> {
    pub deformation: &'a Deformation,
    pub eye: Option<&'a Eye>,
    pub noise: Noise,
    /// Whether the board's corners are rows of their own, rather than condensed: needed where a column moves them.
    pub with_board: bool,
    /// Whether every observation counts in full: needed where the model is known to be far off, so that nothing looks false.
    pub gaussian: bool,
}

impl FrameWork {
    pub fn new(problem: &Problem) -> Self {
        Self {
            frame: 0,
            poses: NodePoses::new(problem.scene.nodes()),
            rows: Vec::new(),
            foot: Vector3::zeros(),
            plane_inverse_factor: Matrix3::zeros(),
            has_plane: false,
            cost: 0.0,
            row_count: 0,
            board_gradient: Vector3::zeros(),
            board_excess: 0.0,
            root: Pose::identity(),
            unknown: None,
            residual: Vec::new(),
        }
    }

    fn pose(&mut self, problem: &Problem, deformation: &Deformation, frame: usize) {
        let nodes = problem.scene.nodes();
        let commanded = &problem.scene.commanded[frame * nodes..(frame + 1) * nodes];
        self.poses.update(&problem.scene.body, commanded, deformation, frame);
        self.frame = frame;
        self.root = self.poses.site(&problem.scene.body.root);
    }

    /// The world in the camera's (actual) optical frame.
    fn camera_from_world(&self, problem: &Problem, eye: &Eye) -> Pose {
        let world_from_mount = problem.camera_site.map_or_else(Pose::identity, |s| self.poses.site(&s));
        eye.camera_from_mount.then(&world_from_mount.inverse())
    }

    /// Fits the mirror to the frame's board alone, from a start or from the plane half-way to the board's depth.
    pub fn fit_board(
        &mut self,
        problem: &Problem,
        deformation: &Deformation,
        eye: Option<&Eye>,
        frame: usize,
        start: Option<Vector3<f64>>,
    ) -> Option<BoardFit> {
        let (eye, board) = (eye?, problem.board?);
        let corners = &problem.frames[frame].corners;
        if corners.len() < FEWEST_CORNERS {
            return None;
        }
        self.pose(problem, deformation, frame);
        let camera_from_board = self.camera_from_world(problem, eye).then(&self.poses.site(&board));
        let scale = 1.0 + deformation.board_scale_error;
        let mut foot = match start {
            Some(foot) => foot,
            None => start_of_plane(problem, eye, &camera_from_board, frame)?,
        };
        let evaluate = |foot: &Vector3<f64>| -> Option<(f64, Matrix3<f64>, Vector3<f64>)> {
            let (mut chi2, mut information, mut gradient) = (0.0, Matrix3::zeros(), Vector3::zeros());
            for (index, pixel) in corners {
                let point = camera_from_board.point(&(problem.corners[*index] * scale));
                let (at, by_foot) = mirrored_pixel(eye, foot, &point)?;
                let r = pixel - at;
                chi2 += r.norm_squared();
                information += by_foot.tr_mul(&by_foot);
                gradient += by_foot.tr_mul(&r);
            }
            Some((chi2, information, gradient))
        };
        let (mut chi2, mut information, mut gradient) = evaluate(&foot)?;
        let mut damping = 1e-6;
        for _ in 0..BOARD_STEPS {
            let mut damped = information;
            for i in 0..3 {
                damped[(i, i)] *= 1.0 + damping;
            }
            let step = damped.cholesky()?.solve(&gradient);
            match evaluate(&(foot + step)) {
                Some(next) if next.0 <= chi2 => {
                    let done = chi2 - next.0 < 1e-9 * chi2;
                    foot += step;
                    (chi2, information, gradient) = next;
                    damping *= 0.1;
                    if done {
                        break;
                    }
                }
                _ => damping = (damping * 10.0).max(1e-3),
            }
        }
        Some(BoardFit { foot, information, chi2_px2: chi2, corners: corners.len() })
    }

    /// Residuals (px) of a frame's board corners at its own best plane with nominal optics, and where the corners are seen.
    pub fn board_residuals(
        &mut self,
        problem: &Problem,
        nominal: &Deformation,
        eye: &Eye,
        frame: usize,
    ) -> Vec<(Vector2<f64>, Vector2<f64>)> {
        let (Some(Some(fit)), Some(board)) = (problem.boards.get(frame), problem.board) else {
            return Vec::new();
        };
        self.pose(problem, nominal, frame);
        let camera_from_board = self.camera_from_world(problem, eye).then(&self.poses.site(&board));
        problem.frames[frame]
            .corners
            .iter()
            .filter_map(|(index, pixel)| {
                let point = camera_from_board.point(&problem.corners[*index]);
                mirrored_pixel(eye, &fit.foot, &point).map(|(at, _)| (*pixel, pixel - at))
            })
            .collect()
    }

    /// Evaluates a frame: after it, [`FrameWork::cost`], [`FrameWork::residual`] and columns can be read.
    ///
    /// False where the frame shows nothing that the model can predict (no board for its mirror, say).
    pub fn evaluate(&mut self, problem: &Problem, task: &Task<'_>, frame: usize) -> bool {
        self.rows.clear();
        self.cost = 0.0;
        self.has_plane = false;
        self.pose(problem, task.deformation, frame);
        self.unknown = problem.unknown_frame.map(|start| moved(&start, &task.deformation.frame_pose));
        let data = &problem.frames[frame];
        let nominal_board = problem.boards.get(frame).copied().flatten();
        let mut board = None;
        if let (Some(eye), Some(start)) = (task.eye, nominal_board) {
            let fit = if task.with_board && problem.needs_fresh_board_in(task.deformation, frame) {
                self.fit_board(problem, task.deformation, Some(eye), frame, Some(start.foot))
            } else {
                Some(start)
            };
            if let Some(fit) = fit {
                self.has_plane = true;
                self.foot = fit.foot;
                board = Some(fit);
            }
        }
        let corner_variance = task.noise.corner_px * task.noise.corner_px;
        // The plane goes from the board's optimum to the whole frame's, weights as of the present residuals.
        for _ in 0..if self.has_plane { PLANE_STEPS } else { 0 } {
            let Some(fit) = &board else { break };
            self.rows.clear();
            let mut g = fit.information / corner_variance;
            let mut rhs = g * (fit.foot - self.foot);
            self.observe(problem, task, data, false);
            for row in &self.rows {
                g += row.plane.tr_mul(&row.plane);
                rhs += row.plane.tr_mul(&row.residual);
            }
            match g.cholesky() {
                Some(factor) => self.foot += factor.solve(&rhs),
                None => break,
            }
        }
        self.rows.clear();
        self.cost = 0.0;
        self.board_gradient = Vector3::zeros();
        self.board_excess = 0.0;
        let mut g = Matrix3::zeros();
        if let Some(fit) = &board {
            if task.with_board {
                self.observe_board(problem, task, data);
                for row in &self.rows {
                    g += row.plane.tr_mul(&row.plane);
                    self.board_gradient += row.plane.tr_mul(&row.residual);
                    self.board_excess += row.residual.norm_squared();
                }
                self.board_excess -= fit.chi2_px2 / corner_variance;
            } else {
                g = fit.information / corner_variance;
                let away = self.foot - fit.foot;
                self.board_gradient = -(g * away);
                self.board_excess = away.dot(&(g * away));
                self.cost += fit.chi2_px2 / corner_variance + self.board_excess;
            }
        }
        let first_other = self.rows.len();
        self.observe(problem, task, data, true);
        for row in &self.rows[first_other..] {
            g += row.plane.tr_mul(&row.plane);
        }
        if self.has_plane {
            match g.cholesky().and_then(|c| c.l().try_inverse()) {
                Some(inverse) => self.plane_inverse_factor = inverse,
                None => return false,
            }
        }
        self.row_count = self.rows.iter().map(|r| r.count).sum();
        let mut residual = core::mem::take(&mut self.residual);
        residual.clear();
        let mut gradient = if task.with_board { Vector3::zeros() } else { self.board_gradient };
        for row in &self.rows {
            residual.extend_from_slice(&row.residual.as_slice()[..row.count]);
            gradient += row.plane.tr_mul(&row.residual);
        }
        let projected = self.plane_inverse_factor * gradient;
        residual.extend_from_slice(if self.has_plane { projected.as_slice() } else { &[0.0; PROJECTED] });
        self.residual = residual;
        self.row_count > 0 || self.cost > 0.0
    }

    fn observe_board(&mut self, problem: &Problem, task: &Task<'_>, data: &super::problem::FrameData) {
        let (Some(eye), Some(board)) = (task.eye, problem.board) else { return };
        let camera_from_world = self.camera_from_world(problem, eye);
        let world_from_board = self.poses.site(&board);
        let mixture = pixel_mixture(eye, task.noise.corner_px);
        for (index, pixel) in &data.corners {
            let seen = Corner { index: *index, board: board.node };
            self.push_pixel(
                problem,
                task,
                eye,
                &camera_from_world,
                &world_from_board,
                Via::Mirror,
                SeenAt::Corner(seen),
                pixel,
                task.noise.corner_px,
                &mixture,
                true,
            );
        }
    }

    fn observe(&mut self, problem: &Problem, task: &Task<'_>, data: &super::problem::FrameData, full: bool) {
        for observation in &data.others {
            match observation {
                Observation::Pixel { seen, via, pixel } => {
                    let Some(eye) = task.eye else { continue };
                    if *via == Via::Mirror && !self.has_plane {
                        continue;
                    }
                    let camera_from_world = self.camera_from_world(problem, eye);
                    let (at, world_from, std) = match seen {
                        Seen::Marker(m) => (
                            SeenAt::Marker(*m),
                            self.marker_mount_pose(problem, task, *m),
                            task.noise.marker_px,
                        ),
                        Seen::Corner(index) => {
                            let Some(board) = problem.board else { continue };
                            let corner = Corner { index: *index, board: board.node };
                            (SeenAt::Corner(corner), self.poses.site(&board), task.noise.corner_px)
                        }
                    };
                    let mixture = pixel_mixture(eye, std);
                    self.push_pixel(
                        problem,
                        task,
                        eye,
                        &camera_from_world,
                        &world_from,
                        *via,
                        at,
                        pixel,
                        std,
                        &mixture,
                        full,
                    );
                }
                Observation::Point { marker, position } => self.push_point(problem, task, *marker, position),
            }
        }
    }

    /// Pose of the frame of a marker's centre, its shift included.
    fn marker_mount_pose(&self, problem: &Problem, task: &Task<'_>, marker: usize) -> Pose {
        let shift = task.deformation.marker_shift_in(self.frame, marker);
        let mut pose = self.poses.site(&problem.marker_sites[marker]);
        if shift != Vector3::zeros() {
            pose.t += self.poses.site(&problem.marker_mounts[marker]).r * shift;
        }
        pose
    }

    fn push_pixel(
        &mut self,
        problem: &Problem,
        task: &Task<'_>,
        eye: &Eye,
        camera_from_world: &Pose,
        world_from_target: &Pose,
        via: Via,
        seen: SeenAt,
        pixel: &Vector2<f64>,
        std: f64,
        mixture: &Mixture,
        full: bool,
    ) {
        let (local, node, marker) = match seen {
            SeenAt::Marker(m) => (Vector3::zeros(), problem.marker_sites[m].node, Some(m)),
            SeenAt::Corner(c) => {
                (problem.corners[c.index] * (1.0 + task.deformation.board_scale_error), c.board, None)
            }
        };
        let point = world_from_target.point(&local);
        let in_camera = camera_from_world.point(&point);
        let Some(sight) = sight_of(eye, via, &self.foot, &in_camera, full && task.with_board) else {
            // What cannot be predicted (behind the mirror, say) is as wrong as a false observation.
            self.cost += mixture.of(f64::INFINITY).cost;
            return;
        };
        let r = (pixel - sight.pixel - self.outline_offset(problem, eye, via, marker, &in_camera)) / std;
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
        let mut optics = SMatrix::<f64, 3, 13>::zeros();
        if full && task.with_board {
            // p_real = Exp(ω)ᵀ (p − v): ∂/∂ω = p̂ J_r(ω), ∂/∂v = −Exp(ω)ᵀ.
            let by_rotation = by_camera * in_camera.cross_matrix() * eye.mount_jacobian;
            let by_shift = -(by_camera * eye.camera_from_mount.r);
            optics.fixed_view_mut::<3, 3>(0, 0).copy_from(&by_rotation);
            optics.fixed_view_mut::<3, 3>(0, 3).copy_from(&by_shift);
            for k in 0..4 {
                optics.fixed_view_mut::<2, 1>(0, 6 + k).copy_from(&(sight.by_lens.column(k) * scale));
            }
            if marker.is_none() {
                let by_scale = camera_from_world.r
                    * (world_from_target.r
                        * problem.corners[match seen {
                            SeenAt::Corner(c) => c.index,
                            SeenAt::Marker(_) => 0,
                        }]);
                optics.set_column(10, &(by_camera * by_scale));
            }
            optics.fixed_view_mut::<2, 1>(0, 11).copy_from(&(sight.by_glass * scale));
            optics.fixed_view_mut::<2, 1>(0, 12).copy_from(&(sight.by_curvature * scale));
        }
        self.rows.push(Rows {
            count: 2,
            node,
            observer: problem.camera_site.and_then(|s| s.node),
            marker,
            residual: Vector3::new(r.x * root_weight, r.y * root_weight, 0.0),
            scale,
            by_world: by_camera * camera_from_world.r,
            point,
            plane,
            optics,
            measured: false,
        });
    }

    /// From the picture of a ball's centre to the centroid of its outline, px; 0 where the session's points are of centres.
    fn outline_offset(
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

    fn push_point(&mut self, problem: &Problem, task: &Task<'_>, marker: usize, position: &Vector3<f64>) {
        let Some(site) = problem.points_site else { return };
        let observer = self.poses.site(&site);
        let point = self.marker_mount_pose(problem, task, marker).t;
        let mut in_observer = observer.inverse_point(&point);
        let mut observed_from_world = observer.r.transpose();
        if let Some(unknown) = &self.unknown {
            in_observer = unknown.point(&in_observer);
            observed_from_world = unknown.r * observed_from_world;
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
        self.rows.push(Rows {
            count: 3,
            node: problem.marker_sites[marker].node,
            observer: site.node,
            marker: Some(marker),
            residual: r * root_weight,
            scale,
            by_world: observed_from_world * scale,
            point,
            plane: Matrix3::zeros(),
            optics: SMatrix::zeros(),
            measured: true,
        });
    }

    /// Writes a column's rows and its projection (`row_count + 3` numbers); false where the atom moves nothing here.
    pub fn column(
        &self,
        problem: &Problem,
        deformation: &Deformation,
        frame: usize,
        atom: Atom,
        out: &mut [f64],
    ) -> bool {
        self.column_in(problem, deformation, frame, atom, out).is_some()
    }

    /// As [`FrameWork::column`], and from where to where the rows are not 0: a limb moves its markers' rows, not the board's.
    pub fn column_in(
        &self,
        problem: &Problem,
        deformation: &Deformation,
        frame: usize,
        atom: Atom,
        out: &mut [f64],
    ) -> Option<Span> {
        out[..self.row_count + PROJECTED].fill(0.0);
        let mut span: Option<Span> = None;
        let mut gradient = Vector3::zeros();
        let twist = body_twist(atom, &problem.scene, &self.poses, deformation, frame);
        let mut at = 0;
        // Rows of one target follow each other: whether the atom moves it is asked once.
        let mut last = None;
        for row in &self.rows {
            let value = match &twist {
                Some(twist) => {
                    let sign = match last {
                        Some((node, observer, sign)) if node == row.node && observer == row.observer => sign,
                        _ => motion(problem, row, atom),
                    };
                    last = Some((row.node, row.observer, sign));
                    sign.map(|s| row.by_world * (twist.omega.cross(&row.point) + twist.shift) * s)
                }
                None => self.rows_of(problem, row, atom),
            };
            if let Some(value) = value {
                let end = at + row.count;
                span = Some(Span { start: span.map_or(at, |s| s.start), end });
                out[at..end].copy_from_slice(&value.as_slice()[..row.count]);
                gradient += row.plane.tr_mul(&value);
            }
            at += row.count;
        }
        if span.is_some() && self.has_plane {
            out[at..at + PROJECTED].copy_from_slice((self.plane_inverse_factor * gradient).as_slice());
        }
        span
    }

    #[inline]
    fn rows_of(&self, problem: &Problem, row: &Rows, atom: Atom) -> Option<Vector3<f64>> {
        match atom {
            Atom::MarkerShift(m, k) if row.marker == Some(m) => {
                let mount = self.poses.site(&problem.marker_mounts[m]).r;
                Some(row.by_world * mount.column(k))
            }
            Atom::FramePose(k) if row.measured => {
                let unknown = self.unknown?;
                let in_root = self.root.inverse_point(&row.point);
                let axis = Vector3::ith(k % 3, 1.0);
                let velocity = if k < 3 { axis.cross(&in_root) } else { axis };
                Some(unknown.r * velocity * row.scale)
            }
            _ if atom.is_optical() && !row.measured => {
                let k = match atom {
                    Atom::CameraMount(k) => k,
                    Atom::Focal => 6,
                    Atom::Center(k) => 7 + k,
                    Atom::Dk1 => 9,
                    Atom::BoardScale => 10,
                    Atom::Glass => 11,
                    _ => 12,
                };
                Some(row.optics.column(k).into_owned())
            }
            _ => None,
        }
    }

    /// The rows by the plane's foot point, one row each.
    #[cfg(test)]
    pub fn plane_rows(&self) -> nalgebra::DMatrix<f64> {
        let rows = self.rows.iter().flat_map(|r| (0..r.count).map(|i| r.plane.row(i).into_owned()));
        let rows: Vec<_> = rows.collect();
        nalgebra::DMatrix::from_fn(rows.len(), PROJECTED, |i, k| rows[i][k])
    }

    /// Unweighted residual (px or m) of each observation other than the mirrored corners, in the frame's order.
    pub fn raw_residuals(&self, with: impl FnMut(Option<usize>, bool, Vector3<f64>)) {
        let mut with = with;
        for row in &self.rows {
            if row.marker.is_some() && row.scale > 0.0 {
                with(row.marker, row.measured, row.residual / row.scale);
            }
        }
    }
}

/// The rows of a column that are not 0, from `start` to before `end`.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Span {
    pub start: usize,
    pub end: usize,
}

/// How an atom of the body moves a row's target against its observer: 1, −1 where it is the observer that moves, or not at all.
fn motion(problem: &Problem, row: &Rows, atom: Atom) -> Option<f64> {
    let target = moves(atom, &problem.scene, row.node);
    let observer = moves(atom, &problem.scene, row.observer);
    (target != observer).then_some(if target { 1.0 } else { -1.0 })
}

#[derive(Clone, Copy)]
struct Corner {
    index: usize,
    board: Option<NodeId>,
}

#[derive(Clone, Copy)]
enum SeenAt {
    Marker(usize),
    Corner(Corner),
}

fn pixel_mixture(eye: &Eye, std: f64) -> Mixture {
    let (w, h) = eye.camera.size_px();
    Mixture::new(std, 2, f64::from(w) * f64::from(h))
}

/// Moves a pose by the project's tangent: `pose ∘ (Exp ω, v)`.
fn moved(pose: &Pose, tangent: &nalgebra::Vector6<f64>) -> Pose {
    let omega = tangent.fixed_rows::<3>(0).into_owned();
    let shift = tangent.fixed_rows::<3>(3).into_owned();
    pose.then(&Pose { r: super::pose::exp(&omega), t: shift })
}

/// Pixel in the mirror and its derivative by the plane's foot point.
fn mirrored_pixel(
    eye: &Eye,
    foot: &Vector3<f64>,
    point: &Vector3<f64>,
) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
    let plane = Problem::plane(foot)?;
    if eye.mirror == MirrorOptics::IDEAL {
        return ideally_mirrored(eye, foot, point).map(|seen| (seen.0, seen.2));
    }
    let seen = eye.mirror.project_with_jacobians(&eye.camera, &plane, &Point3::from(*point)).ok()?;
    Some((seen.pixel, seen.by_foot_point))
}

/// Pixel in a flat front-surface mirror and its derivatives by the point and the foot point f:
/// `p′ = p + 2 (1 − f·p/f²) f`. The mirror that nearly all sessions have, without the general optics' ray tracing.
fn ideally_mirrored(
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

fn sight_of(eye: &Eye, via: Via, foot: &Vector3<f64>, point: &Vector3<f64>, lens: bool) -> Option<Sight> {
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
            })
        }
    }
}

/// A first plane: the board's reflection lies in the direction of the corners' mean, at the depth at which its picture has
/// the size that it has; the mirror is half-way to it (the paper's Eq. 2 with a crude position).
fn start_of_plane(
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
