//! The workspace of one frame: fits its mirror, evaluates its rows.

use super::condensed::{BoardSums, Condensed};
use super::marker_sights::Markers;
use super::mirror_and_lens::Points;
use super::pictures::Pictures;
use super::products::PROJECTED;
use super::rows::Rows;
use super::sight::Wanted;
use crate::diagnose::model::body::Site;
use crate::diagnose::model::camera_and_mirror::Eye;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::free_optics::FreeColumns;
use crate::diagnose::model::kinematics::{Before, NodePoses};
use crate::diagnose::model::pose::{Pose, exp};
use crate::diagnose::model::problem::{FrameData, Noise, Observation, Problem};
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::model::work_budget::Effort;
use nalgebra::{Matrix3, SMatrix, Vector3, Vector6};

/// Reusable memory for one frame.
pub(crate) struct FrameWork {
    pub(super) frame: usize,
    pub poses: NodePoses,
    pub(super) rows: Vec<Rows>,
    /// The foot point of the mirror's plane.
    pub foot: Vector3<f64>,
    pub(super) plane_inverse_factor: Matrix3<f64>,
    pub(super) has_plane: bool,
    /// Negative twice the frame's log likelihood (0 at a perfect fit).
    pub cost: f64,
    /// Rows in all, without the projected ones.
    pub row_count: usize,
    /// The last of these: of predicted observations other than the mirrored corners.
    pub other_rows: usize,
    board_gradient: Vector3<f64>,
    /// Whitened χ² of the board above that at its own best plane.
    pub board_excess: f64,
    /// Whitened χ² of the board at the plane, and of how many corners.
    pub board_square: (f64, usize),
    /// How the board's displaced mount moves it in the world; none where the mount is as modelled.
    board_moved: Option<Pose>,
    /// How the board has slipped on its mount.
    pub(super) board_slip: Option<Vector6<f64>>,
    /// The link in whose frame points are measured.
    pub(super) measured_from: Pose,
    /// Its pose in their frame; none where it is the identity.
    pub(super) points_from_link: Option<Pose>,
    pub residual: Vec<f64>,
    /// The rows by the optics, whitened.
    pub(super) optics: Vec<OpticsColumns>,
    /// Free-form columns of the rows, whitened.
    pub(super) free: Vec<FreeColumns>,
    /// Whether boards are fitted roughly.
    pub(super) rough: bool,
    /// The corners' rows, if a task requests them condensed.
    pub(super) condensed: Condensed,
    /// The corners before the camera, each so many-th, as posed last; 0 where they are not.
    pub(super) points: Points,
    pub(super) points_each: usize,
    pub(super) pictures: Pictures,
    pub(super) markers: Markers,
    /// The work on a frame that is not yet counted.
    pub(super) spent_ns: u64,
}

/// Two rows by camera mount (6), focal, cx, cy, k1, board scale, glass, curvature.
pub(super) type OpticsColumns = SMatrix<f64, 2, 13>;

/// How to evaluate a frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Task<'a> {
    pub deformation: &'a Deformation,
    pub eye: Option<&'a Eye>,
    pub noise: Noise,
    /// Whether the board's corners are separate rows instead of condensed ones: needed where a column moves them.
    pub with_board: bool,
    /// Whether every observation has full weight: needed where the model is known to be far off, so that nothing
    /// looks false.
    pub gaussian: bool,
    /// Which columns of the optics will be read.
    pub wanted: Wanted,
    /// Foot points from which the planes of frames with fresh boards start where they are nearly known. Boards are then not
    /// fitted by themselves first, and [`FrameWork::board_excess`] is not available.
    pub planes: Option<&'a [Option<Vector3<f64>>]>,
    /// Whether the corners' rows may be condensed to a few with the same products: rows and residual are then not
    /// those of observations. With free-form columns they are not condensed.
    pub condensed: bool,
}

impl<'a> Task<'a> {
    pub(super) fn condenses(&self) -> bool {
        self.condensed && !self.wanted.free
    }

    /// For the markers' residuals: as [`Task::of_residuals`], without rows of the corners.
    pub fn of_markers(
        problem: &Problem,
        deformation: &'a Deformation,
        eye: Option<&'a Eye>,
        noise: Noise,
    ) -> Self {
        Self { condensed: true, ..Self::of_residuals(problem, deformation, eye, noise) }
    }

    /// For residuals alone: every observation in full, no column, the board where the deformation changes how it is seen.
    pub fn of_residuals(
        problem: &Problem,
        deformation: &'a Deformation,
        eye: Option<&'a Eye>,
        noise: Noise,
    ) -> Self {
        Self {
            deformation,
            eye,
            noise,
            with_board: problem.needs_fresh_board(deformation),
            gaussian: true,
            wanted: Wanted::default(),
            planes: None,
            condensed: false,
        }
    }
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
            other_rows: 0,
            board_gradient: Vector3::zeros(),
            board_excess: 0.0,
            board_square: (0.0, 0),
            measured_from: Pose::identity(),
            points_from_link: None,
            board_moved: None,
            board_slip: None,
            residual: Vec::new(),
            optics: Vec::new(),
            free: Vec::new(),
            rough: false,
            condensed: Condensed::default(),
            points: Points::default(),
            points_each: 0,
            pictures: Pictures::default(),
            markers: Markers::default(),
            spent_ns: 0,
        }
    }

    /// As [`FrameWork::new`], for boards that are fitted roughly.
    pub fn rough(problem: &Problem) -> Self {
        Self { rough: true, ..Self::new(problem) }
    }

    pub(super) fn pose(&mut self, problem: &Problem, deformation: &Deformation, frame: usize) {
        let nodes = problem.scene.nodes();
        let commanded = &problem.scene.commanded[frame * nodes..(frame + 1) * nodes];
        self.pose_sites_as(problem, deformation, frame, commanded);
    }

    /// Poses a frame as if its nodes had been commanded to these positions.
    pub fn pose_as(&mut self, problem: &Problem, deformation: &Deformation, frame: usize, commanded: &[f64]) {
        self.poses.update(&problem.scene.body, commanded, deformation, frame);
        self.posed(problem, deformation, frame);
    }

    /// As [`FrameWork::pose_as`], only the nodes that the session's own sites ride on.
    pub fn pose_sites_as(
        &mut self,
        problem: &Problem,
        deformation: &Deformation,
        frame: usize,
        commanded: &[f64],
    ) {
        let posed = |n: usize| problem.scene.posed[n];
        self.poses.update_of(&problem.scene.body, posed, commanded, deformation, frame);
        self.posed(problem, deformation, frame);
    }

    /// As [`FrameWork::pose_sites_as`], or of all nodes, where [`FrameWork::poses`] are those of the same frame and deformation at
    /// other positions: only what moves is posed again.
    pub fn pose_again(
        &mut self,
        problem: &Problem,
        (deformation, frame): (&Deformation, usize),
        commanded: &[f64],
        all: bool,
        before: &mut Before,
    ) {
        let posed = |n: usize| all || problem.scene.posed[n];
        self.poses.update_changed(&problem.scene.body, posed, commanded, (deformation, frame), before);
        self.posed(problem, deformation, frame);
    }

    fn posed(&mut self, problem: &Problem, deformation: &Deformation, frame: usize) {
        self.frame = frame;
        self.points_each = 0;
        self.markers.posed = false;
        self.measured_from = self.poses.site(&problem.points_site.unwrap_or(problem.scene.body.root));
        let mount = &deformation.board_mount;
        // As it was mounted: a camera on the same body moved with it then, and stays where the board slips.
        self.board_moved = problem.board.filter(|_| *mount != Vector6::zeros()).map(|board| {
            let world_from_board = self.poses.site(&board);
            moved(&world_from_board, mount).then(&world_from_board.inverse())
        });
        self.board_slip = deformation.board_slip(frame);
    }

    /// The board's actual pose in the world.
    pub(super) fn world_from_board(&self, board: &Site) -> Pose {
        let mounted = self.world_from_mounted_board(board);
        self.board_slip.map_or(mounted, |slip| moved(&mounted, &slip))
    }

    /// The same before it slipped on its mount.
    pub(super) fn world_from_mounted_board(&self, board: &Site) -> Pose {
        let nominal = self.poses.site(board);
        self.board_moved.map_or(nominal, |moved| moved.then(&nominal))
    }

    /// A site as it was posed last, in the world.
    pub fn world_from_site(&self, site: &Site) -> Pose {
        self.poses.site(site)
    }

    /// The world in the camera's (actual) optical frame.
    pub fn camera_from_world(&self, problem: &Problem, eye: &Eye) -> Pose {
        let world_from_mount = self.world_from_mount(problem).unwrap_or_else(Pose::identity);
        eye.camera_from_mount.then(&world_from_mount.inverse())
    }

    /// Where the camera is mounted, as the model has its mount; none without a camera.
    pub(super) fn world_from_mount(&self, problem: &Problem) -> Option<Pose> {
        let nominal = self.poses.site(&problem.camera_in(self.frame)?);
        let moved = self.board_moved.filter(|_| problem.camera_beside_board());
        Some(moved.map_or(nominal, |moved| moved.then(&nominal)))
    }

    /// Evaluates a frame: afterwards [`FrameWork::cost`], [`FrameWork::residual`] and columns can be read.
    ///
    /// False where the frame shows nothing that a model could predict (for example no board for its mirror), and
    /// for all frames of a problem that was cancelled. If this model predicts nothing of it, the cost is that of
    /// false observations: losing a frame must not reduce the cost.
    pub fn evaluate(&mut self, problem: &Problem, task: &Task<'_>, frame: usize) -> bool {
        let predicted = self.evaluate_counted(problem, task, frame);
        problem.budget.spend_ns(core::mem::take(&mut self.spent_ns));
        predicted
    }

    fn evaluate_counted(&mut self, problem: &Problem, task: &Task<'_>, frame: usize) -> bool {
        self.rows.clear();
        self.condensed.used = false;
        self.condensed.corners = 0;
        self.cost = 0.0;
        self.has_plane = false;
        if problem.cancel.is_cancelled() {
            return false;
        }
        let varies = task.eye.filter(|_| task.deformation.eye_varies());
        let own = match varies.map(|eye| eye.in_frame(task.deformation, frame)).transpose() {
            Ok(own) => own,
            Err(_) => return false,
        };
        let task = &Task { eye: own.as_ref().or(task.eye), ..*task };
        self.pose(problem, task.deformation, frame);
        let away = task.deformation.frame_pose_in(frame);
        let start = problem.unknown_frame.or(away.map(|_| Pose::identity()));
        self.points_from_link = start.map(|start| away.map_or(start, |tangent| moved(&start, &tangent)));
        let data = &problem.frames[frame];
        let nominal_board = problem.boards.get(frame).copied().flatten();
        let mut board = None;
        if let (Some(eye), Some(start)) = (task.eye, nominal_board) {
            let fit = if task.with_board && problem.needs_fresh_board_in(task.deformation, frame) {
                let known = task.planes.and_then(|p| p[frame]);
                if let Some(foot) = known {
                    self.foot = foot;
                    self.has_plane = true;
                    if self.evaluate_nearby(problem, task, data) {
                        return self.row_count > 0;
                    }
                    self.has_plane = false;
                }
                let from = known.unwrap_or(start.foot);
                self.fit_posed_board(problem, task.deformation, eye, Some(from))
                    .or_else(|| self.fit_posed_board(problem, task.deformation, eye, Some(start.foot)))
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
        if let Some(fit) = &board {
            self.settle_plane(problem, task, data, fit);
        }
        self.rows.clear();
        self.optics.clear();
        self.free.clear();
        self.cost = 0.0;
        self.board_gradient = Vector3::zeros();
        self.board_excess = 0.0;
        self.board_square = (0.0, 0);
        let mut g = Matrix3::zeros();
        if let Some(fit) = &board {
            if task.with_board {
                let sums = self.observe_corners(problem, task, data);
                g += sums.information;
                self.board_gradient = sums.gradient;
                self.board_excess = sums.square - fit.chi2_px2 / corner_variance;
            } else {
                g = fit.information / corner_variance;
                let away = self.foot - fit.foot;
                self.board_gradient = -(g * away);
                self.board_excess = away.dot(&(g * away));
                self.board_square = (fit.chi2_px2 / corner_variance + self.board_excess, fit.corners);
                self.cost += self.board_square.0;
            }
        }
        // No mirror shows this board: all that was seen in it is as wrong as a false observation.
        let lost = match task.eye.filter(|_| nominal_board.is_some() && !self.has_plane) {
            Some(eye) => Self::unpredicted(eye, task, data),
            None => 0.0,
        };
        let first_other = self.rows.len();
        self.observe(problem, task, data, true);
        for row in &self.rows[first_other..] {
            g += row.plane.tr_mul(&row.plane);
        }
        if self.has_plane {
            match g.cholesky().and_then(|c| c.l().try_inverse()) {
                Some(inverse) => self.plane_inverse_factor = inverse,
                // Nothing here is probable enough to have a weight.
                None => return false,
            }
        }
        let has_rows = task.with_board && !self.condensed.used;
        self.collect_residual(first_other, if has_rows { Vector3::zeros() } else { self.board_gradient });
        self.condense_corners(problem, task, first_other);
        let predicted = self.row_count > 0 || self.cost > 0.0;
        self.cost += lost;
        predicted
    }

    /// The residual with its projection on the plane's parameters; before `first_other` are the corners, `gradient` is that of
    /// what has no rows.
    fn collect_residual(&mut self, first_other: usize, mut gradient: Vector3<f64>) {
        self.row_count = self.rows.iter().map(|r| r.count).sum();
        self.other_rows = self.rows[first_other..].iter().map(|r| r.count).sum();
        self.residual.clear();
        for row in &self.rows {
            self.residual.extend_from_slice(&row.residual.as_slice()[..row.count]);
            gradient += row.plane.tr_mul(&row.residual);
        }
        let projected = self.plane_inverse_factor * gradient;
        self.residual.extend_from_slice(if self.has_plane {
            projected.as_slice()
        } else {
            &[0.0; PROJECTED]
        });
    }

    /// Evaluates a frame with all its rows from a nearly optimal plane: Gauss–Newton on the whole frame, until the
    /// next step would gain almost nothing; the cost is that after it. False if the plane was not near.
    fn evaluate_nearby(&mut self, problem: &Problem, task: &Task<'_>, data: &FrameData) -> bool {
        for _ in 0..SOLVER.nearby_steps {
            self.rows.clear();
            self.optics.clear();
            self.free.clear();
            self.cost = 0.0;
            self.board_excess = 0.0;
            self.condensed.used = false;
            self.condensed.corners = 0;
            let sums = self.observe_corners(problem, task, data);
            if sums.counted < SOLVER.least_corners_counted * sums.corners as f64 {
                self.condensed.used = false;
                return false;
            }
            let corners = self.rows.len();
            self.observe(problem, task, data, true);
            let others: Matrix3<f64> = self.rows[corners..].iter().map(|r| r.plane.tr_mul(&r.plane)).sum();
            let g = sums.information + others;
            let Some(inverse) = g.cholesky().and_then(|c| c.l().try_inverse()) else { break };
            self.plane_inverse_factor = inverse;
            let without_rows = if self.condensed.used { sums.gradient } else { Vector3::zeros() };
            self.collect_residual(corners, without_rows);
            let projected = self.projected_residual();
            let gain = projected.norm_squared();
            if gain < SOLVER.last_plane_gain {
                self.cost -= gain;
                self.condense_corners(problem, task, corners);
                return true;
            }
            if !(gain < SOLVER.nearby_gain) {
                break;
            }
            self.foot = self.best_foot();
        }
        self.condensed.used = false;
        false
    }

    /// The board's corners at the present plane: as products where these are all that is read, or as rows.
    fn observe_corners(&mut self, problem: &Problem, task: &Task<'_>, data: &FrameData) -> BoardSums {
        self.spent_ns += Effort::Corners(data.corners.len()).nanoseconds();
        let many = self.observe_many(problem, task, data);
        let sums = many.unwrap_or_else(|| self.observe_each_corner(problem, task, data));
        self.board_square = (sums.square, sums.corners);
        sums
    }

    fn observe_each_corner(&mut self, problem: &Problem, task: &Task<'_>, data: &FrameData) -> BoardSums {
        self.observe_board(problem, task, data);
        let corner_px = task.noise.corner_px;
        let rows = || self.rows.iter();
        BoardSums {
            information: rows().map(|r| r.plane.tr_mul(&r.plane)).sum(),
            gradient: rows().map(|r| r.plane.tr_mul(&r.residual)).sum(),
            square: rows().map(|r| r.residual.norm_squared()).sum(),
            corners: self.rows.len(),
            counted: rows().map(|r| (r.scale * corner_px).powi(2)).sum(),
        }
    }

    /// Condenses the corners if the task requests it: those that are products already, or the first `rows`.
    fn condense_corners(&mut self, problem: &Problem, task: &Task<'_>, rows: usize) {
        if self.condensed.used {
            self.factorise_corners();
        } else if let Some(eye) = task.eye.filter(|_| task.condenses() && rows > 0) {
            self.condense(problem, eye, rows);
        }
    }

    fn projected_residual(&self) -> Vector3<f64> {
        Vector3::from_column_slice(&self.residual[self.row_count..])
    }

    /// The foot point of the plane after a last Gauss–Newton step from where the frame was evaluated, `f + L⁻ᵀ (L⁻¹Dᵀr)`.
    pub fn best_foot(&self) -> Vector3<f64> {
        self.foot + self.plane_inverse_factor.tr_mul(&self.projected_residual())
    }

    /// How the best foot point moves with a column's parameter, by the column's parts along the plane: `−L⁻ᵀ (L⁻¹Dᵀx)`.
    pub fn foot_by(&self, along: &Vector3<f64>) -> Vector3<f64> {
        -self.plane_inverse_factor.tr_mul(along)
    }

    /// Whether the mirror's plane was found in the frame that was evaluated.
    pub fn has_plane(&self) -> bool {
        self.has_plane
    }

    /// The rows by the plane's foot point, one row each.
    #[cfg(test)]
    pub fn plane_rows(&self) -> nalgebra::DMatrix<f64> {
        let rows = self.rows.iter().flat_map(|r| (0..r.count).map(|i| r.plane.row(i).into_owned()));
        let rows: Vec<_> = rows.collect();
        nalgebra::DMatrix::from_fn(rows.len(), PROJECTED, |i, k| rows[i][k])
    }

    /// Unweighted residual (px or m) of each predicted observation of a marker that has a weight, in the frame's order.
    pub fn raw_residuals(&self, with: impl FnMut(Option<usize>, bool, Vector3<f64>)) {
        let mut with = with;
        for row in &self.rows {
            if row.marker.is_some() && row.scale > 0.0 {
                with(row.marker, row.measured, row.residual / row.scale);
            }
        }
    }

    /// Unweighted residual (px or m) of each other observation of the evaluated frame; none of a corner, and of a
    /// marker that was not predicted or has zero weight.
    pub fn residuals_of(&self, others: &[Observation]) -> Vec<Option<Vector3<f64>>> {
        let mut predicted = Vec::new();
        self.raw_residuals(|marker, _, residual| predicted.push((marker, residual)));
        let mut predicted = predicted.into_iter().peekable();
        let of = |observation: &Observation| {
            let marker = observation.marker()?;
            Some(predicted.next_if(|(of, _)| *of == Some(marker))?.1)
        };
        others.iter().map(of).collect()
    }
}

/// Moves a pose by the project's tangent: `pose ∘ (Exp ω, v)`.
fn moved(pose: &Pose, tangent: &Vector6<f64>) -> Pose {
    let omega = tangent.fixed_rows::<3>(0).into_owned();
    let shift = tangent.fixed_rows::<3>(3).into_owned();
    pose.then(&Pose { r: exp(&omega), t: shift })
}
