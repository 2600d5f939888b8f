//! The workspace of one frame: its mirror fitted, its rows evaluated.

use super::condensed::Condensed;
use super::products::PROJECTED;
use super::sight::{Wanted, mirrored_pixel, start_of_plane};
use crate::diagnose::model::body::{NodeId, Site};
use crate::diagnose::model::camera_and_mirror::Eye;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::free_optics::{FreeColumns, corner_point};
use crate::diagnose::model::kinematics::NodePoses;
use crate::diagnose::model::pose::{Pose, exp};
use crate::diagnose::model::problem::{BoardFit, FrameData, Noise, Problem};
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::Count;
use nalgebra::{Matrix3, SMatrix, Vector2, Vector3, Vector6};

/// A board with fewer corners than this does not show a plane with a margin: one more than the plane has numbers.
const FEWEST_CORNERS: Count = PROJECTED + 1;

/// The rows of one observation (two of an image point, three of a measured point), whitened.
#[derive(Debug, Clone)]
pub(super) struct Rows {
    pub(super) count: usize,
    pub(super) node: Option<NodeId>,
    pub(super) observer: Option<NodeId>,
    pub(super) marker: Option<usize>,
    pub(super) residual: Vector3<f64>,
    /// Square root of the weight, over the standard deviation.
    pub(super) scale: f64,
    /// Rows by displacement of the point in the world.
    pub(super) by_world: Matrix3<f64>,
    /// The point in the world.
    pub(super) point: Vector3<f64>,
    pub(super) plane: Matrix3<f64>,
    /// Where its columns by the optics stand in [`FrameWork::optics`], if they were asked for.
    pub(super) optics: Option<usize>,
    /// Where its free-form columns stand in [`FrameWork::free`], if they were asked for.
    pub(super) free: Option<usize>,
    pub(super) measured: bool,
}

/// Reusable memory for one frame.
pub(crate) struct FrameWork {
    pub(super) frame: usize,
    pub poses: NodePoses,
    pub(super) rows: Vec<Rows>,
    /// How many of `rows` are board corners (first).
    pub foot: Vector3<f64>,
    pub(super) plane_inverse_factor: Matrix3<f64>,
    pub(super) has_plane: bool,
    /// Negative twice the frame's log likelihood (0 at a perfect fit).
    pub cost: f64,
    /// Rows in all, without the projected ones.
    pub row_count: usize,
    board_gradient: Vector3<f64>,
    /// Whitened χ² of the board above that at its own best plane.
    pub board_excess: f64,
    /// How the board's displaced mount moves it in the world; none where it sits as the model has it.
    board_moved: Option<Pose>,
    pub(super) root: Pose,
    pub(super) unknown: Option<Pose>,
    pub residual: Vec<f64>,
    /// The rows by the optics, whitened.
    pub(super) optics: Vec<OpticsColumns>,
    /// Free-form columns of the rows, whitened.
    pub(super) free: Vec<FreeColumns>,
    /// Whether boards are fitted roughly.
    rough: bool,
    /// The corners' rows, where a task asks for them condensed.
    pub(super) condensed: Condensed,
}

/// Two rows by camera mount (6), focal, cx, cy, k1, board scale, glass, curvature.
pub(super) type OpticsColumns = SMatrix<f64, 2, 13>;

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
    /// Which columns of the optics will be read.
    pub wanted: Wanted,
    /// Foot points from which the planes of frames with fresh boards start, where they are nearly known: boards are not fitted
    /// by themselves first then, and [`FrameWork::board_excess`] is not told.
    pub planes: Option<&'a [Option<Vector3<f64>>]>,
    /// Whether the corners' rows may be condensed to a few of the same products: rows and residual are then not those of
    /// observations. Where free-form columns are wanted they are not.
    pub condensed: bool,
}

impl<'a> Task<'a> {
    pub(super) fn condenses(&self) -> bool {
        self.condensed && !self.wanted.free
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
            board_gradient: Vector3::zeros(),
            board_excess: 0.0,
            root: Pose::identity(),
            unknown: None,
            board_moved: None,
            residual: Vec::new(),
            optics: Vec::new(),
            free: Vec::new(),
            rough: false,
            condensed: Condensed::default(),
        }
    }

    /// As [`FrameWork::new`], for boards that are fitted roughly.
    pub fn rough(problem: &Problem) -> Self {
        Self { rough: true, ..Self::new(problem) }
    }

    fn pose(&mut self, problem: &Problem, deformation: &Deformation, frame: usize) {
        let nodes = problem.scene.nodes();
        let commanded = &problem.scene.commanded[frame * nodes..(frame + 1) * nodes];
        self.poses.update(&problem.scene.body, commanded, deformation, frame);
        self.frame = frame;
        self.root = self.poses.site(&problem.scene.body.root);
        self.board_moved = problem
            .board_in(self.frame)
            .filter(|_| deformation.board_mount != Vector6::zeros())
            .map(|board| {
                let world_from_board = self.poses.site(&board);
                moved(&world_from_board, &deformation.board_mount).then(&world_from_board.inverse())
            });
    }

    /// The board's actual pose in the world.
    pub(super) fn world_from_board(&self, board: &Site) -> Pose {
        let nominal = self.poses.site(board);
        self.board_moved.map_or(nominal, |moved| moved.then(&nominal))
    }

    /// The world in the camera's (actual) optical frame.
    pub(super) fn camera_from_world(&self, problem: &Problem, eye: &Eye) -> Pose {
        let mut world_from_mount =
            problem.camera_in(self.frame).map_or_else(Pose::identity, |s| self.poses.site(&s));
        if let Some(moved) = self.board_moved.filter(|_| problem.camera_beside_board()) {
            world_from_mount = moved.then(&world_from_mount);
        }
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
        let (eye, board) = (eye?, problem.board_in(frame)?);
        let corners = &problem.frames[frame].corners;
        if corners.len() < FEWEST_CORNERS {
            return None;
        }
        let (steps, each) = if self.rough {
            (SOLVER.rough_board_steps, corners.len().div_ceil(SOLVER.rough_corners))
        } else {
            (SOLVER.board_steps, 1)
        };
        self.pose(problem, deformation, frame);
        let camera_from_board = self.camera_from_world(problem, eye).then(&self.world_from_board(&board));
        let scale = 1.0 + deformation.board_scale_error;
        let points: Vec<Vector3<f64>> = corners
            .iter()
            .step_by(each)
            .map(|(index, _)| camera_from_board.point(&corner_point(problem, eye, *index, scale)))
            .collect();
        let mut foot = match start {
            Some(foot) => foot,
            None => start_of_plane(problem, eye, &camera_from_board, frame)?,
        };
        let evaluate = |foot: &Vector3<f64>| -> Option<(f64, Matrix3<f64>, Vector3<f64>)> {
            let (mut chi2, mut information, mut gradient) = (0.0, Matrix3::zeros(), Vector3::zeros());
            for ((_, pixel), point) in corners.iter().step_by(each).zip(&points) {
                let (at, by_foot) = mirrored_pixel(eye, foot, point)?;
                let r = pixel - at;
                chi2 += r.norm_squared();
                information += by_foot.tr_mul(&by_foot);
                gradient += by_foot.tr_mul(&r);
            }
            Some((chi2, information, gradient))
        };
        problem.budget.spend_predicted(points.len());
        let (mut chi2, mut information, mut gradient) = evaluate(&foot)?;
        let mut damping = 1e-6;
        for _ in 0..steps {
            let mut damped = information;
            for i in 0..3 {
                damped[(i, i)] *= 1.0 + damping;
            }
            let step = damped.cholesky()?.solve(&gradient);
            // What is left to gain is next to nothing: the step is taken, its result not looked at.
            if step.dot(&gradient) < SOLVER.board_gain * chi2 {
                foot += step;
                break;
            }
            problem.budget.spend_predicted(points.len());
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
        let (Some(Some(fit)), Some(board)) = (problem.boards.get(frame), problem.board_in(frame)) else {
            return Vec::new();
        };
        self.pose(problem, nominal, frame);
        let camera_from_board = self.camera_from_world(problem, eye).then(&self.world_from_board(&board));
        problem.frames[frame]
            .corners
            .iter()
            .filter_map(|(index, pixel)| {
                let point = camera_from_board.point(&corner_point(problem, eye, *index, 1.0));
                mirrored_pixel(eye, &fit.foot, &point).map(|(at, _)| (*pixel, pixel - at))
            })
            .collect()
    }

    /// Evaluates a frame: after it, [`FrameWork::cost`], [`FrameWork::residual`] and columns can be read.
    ///
    /// False where the frame shows nothing that a model could predict (no board for its mirror, say), and for all frames of
    /// a problem that was cancelled. Where it is this model that
    /// predicts nothing of it, the cost is that of false observations: to lose a frame must not pay.
    pub fn evaluate(&mut self, problem: &Problem, task: &Task<'_>, frame: usize) -> bool {
        self.rows.clear();
        self.condensed.corners = 0;
        self.cost = 0.0;
        self.has_plane = false;
        if problem.cancel.is_cancelled() {
            return false;
        }
        // A camera that is not the same in all frames is made anew for this one.
        let own = if task.deformation.eye_varies() {
            match problem.eye_in(task.deformation, frame) {
                Ok(eye) => eye,
                Err(_) => return false,
            }
        } else {
            None
        };
        let task = &Task { eye: own.as_ref().or(task.eye), ..*task };
        self.pose(problem, task.deformation, frame);
        self.unknown = problem.unknown_frame.map(|start| moved(&start, &task.deformation.frame_pose));
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
                self.fit_board(problem, task.deformation, Some(eye), frame, Some(from))
                    .or_else(|| self.fit_board(problem, task.deformation, Some(eye), frame, Some(start.foot)))
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
        for _ in 0..if self.has_plane { SOLVER.plane_steps } else { 0 } {
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
        self.optics.clear();
        self.free.clear();
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
                // Nothing here is likely enough to weigh anything.
                None => return false,
            }
        }
        self.collect_residual(if task.with_board { Vector3::zeros() } else { self.board_gradient });
        if let Some(eye) = task.eye.filter(|_| task.condenses() && first_other > 0) {
            self.condense(problem, eye, first_other);
        }
        let predicted = self.row_count > 0 || self.cost > 0.0;
        self.cost += lost;
        predicted
    }

    /// The residual with its projection on the plane's parameters; `gradient` is that of what has no rows.
    fn collect_residual(&mut self, mut gradient: Vector3<f64>) {
        self.row_count = self.rows.iter().map(|r| r.count).sum();
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

    /// Evaluates a frame with all its rows from a plane that is nearly the best: Gauss–Newton on the whole frame, until the next
    /// step would gain next to nothing; the cost is that after it. False where the plane was not near.
    fn evaluate_nearby(&mut self, problem: &Problem, task: &Task<'_>, data: &FrameData) -> bool {
        for _ in 0..SOLVER.nearby_steps {
            self.rows.clear();
            self.optics.clear();
            self.free.clear();
            self.cost = 0.0;
            self.board_excess = 0.0;
            self.observe_board(problem, task, data);
            let counted: f64 = self.rows.iter().map(|r| (r.scale * task.noise.corner_px).powi(2)).sum();
            if counted < SOLVER.least_corners_counted * self.rows.len() as f64 {
                return false;
            }
            let corners = self.rows.len();
            self.observe(problem, task, data, true);
            let g: Matrix3<f64> = self.rows.iter().map(|r| r.plane.tr_mul(&r.plane)).sum();
            let Some(inverse) = g.cholesky().and_then(|c| c.l().try_inverse()) else { return false };
            self.plane_inverse_factor = inverse;
            self.collect_residual(Vector3::zeros());
            let projected = self.projected_residual();
            let gain = projected.norm_squared();
            if gain < SOLVER.last_plane_gain {
                self.cost -= gain;
                if let Some(eye) = task.eye.filter(|_| task.condenses() && corners > 0) {
                    self.condense(problem, eye, corners);
                }
                return true;
            }
            if !(gain < SOLVER.nearby_gain) {
                return false;
            }
            self.foot = self.best_foot();
        }
        false
    }

    fn projected_residual(&self) -> Vector3<f64> {
        Vector3::from_column_slice(&self.residual[self.row_count..])
    }

    /// The foot point of the plane after a last Gauss–Newton step from where the frame was evaluated, `f + L⁻ᵀ (L⁻¹Dᵀr)`.
    pub fn best_foot(&self) -> Vector3<f64> {
        self.foot + self.plane_inverse_factor.tr_mul(&self.projected_residual())
    }

    /// How the best foot point moves with a column's parameter: `−L⁻ᵀ (L⁻¹Dᵀx)`.
    pub fn foot_by(&self, column: &[f64]) -> Vector3<f64> {
        -self.plane_inverse_factor.tr_mul(&Vector3::from_column_slice(&column[self.row_count..]))
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

/// Moves a pose by the project's tangent: `pose ∘ (Exp ω, v)`.
fn moved(pose: &Pose, tangent: &Vector6<f64>) -> Pose {
    let omega = tangent.fixed_rows::<3>(0).into_owned();
    let shift = tangent.fixed_rows::<3>(3).into_owned();
    pose.then(&Pose { r: exp(&omega), t: shift })
}
