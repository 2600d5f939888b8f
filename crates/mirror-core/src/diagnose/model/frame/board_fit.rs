//! The mirror of a frame, estimated from its board alone.

use super::mirror_and_lens::MirrorAndLens;
use super::products::PROJECTED;
use super::sight::{mirrored_pixel, start_of_plane};
use super::work::FrameWork;
use crate::diagnose::model::camera_and_mirror::Eye;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::free_optics::corner_point;
use crate::diagnose::model::problem::{BoardFit, Problem};
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::Count;
use nalgebra::{Matrix3, Vector2, Vector3};

/// A board with fewer corners than this does not show a plane with a margin: one more than the plane has numbers.
const FEWEST_CORNERS: Count = PROJECTED + 1;

impl FrameWork {
    /// Fits the mirror to the frame's board alone, from a start or from the plane half-way to the board's depth.
    pub fn fit_board(
        &mut self,
        problem: &Problem,
        deformation: &Deformation,
        eye: Option<&Eye>,
        frame: usize,
        start: Option<Vector3<f64>>,
    ) -> Option<BoardFit> {
        self.pose(problem, deformation, frame);
        self.fit_posed_board(problem, deformation, eye?, start)
    }

    /// As [`FrameWork::fit_board`], in the frame as it was posed last.
    pub(super) fn fit_posed_board(
        &mut self,
        problem: &Problem,
        deformation: &Deformation,
        eye: &Eye,
        start: Option<Vector3<f64>>,
    ) -> Option<BoardFit> {
        let frame = self.frame;
        let board = problem.board_in(frame)?;
        let corners = &problem.frames[frame].corners;
        if corners.len() < FEWEST_CORNERS {
            return None;
        }
        let (steps, each) = if self.rough {
            (SOLVER.rough_board_steps, corners.len().div_ceil(SOLVER.rough_corners))
        } else {
            (SOLVER.board_steps, 1)
        };
        let camera_from_board = self.camera_from_world(problem, eye).then(&self.world_from_board(&board));
        let scale = 1.0 + deformation.board_scale_error;
        let mut foot = match start {
            Some(foot) => foot,
            None => start_of_plane(problem, eye, &camera_from_board, frame)?,
        };
        let many = MirrorAndLens::of(eye, &foot).is_some();
        let points: Vec<Vector3<f64>> = if many {
            self.pose_corners(problem, eye, &problem.frames[frame], scale, each);
            Vec::new()
        } else {
            let of = |index| camera_from_board.point(&corner_point(problem, eye, index, scale));
            corners.iter().step_by(each).map(|(index, _)| of(*index)).collect()
        };
        let (flat, pictures) = (&self.points, &mut self.pictures);
        let mut evaluate = |foot: &Vector3<f64>| -> Option<(f64, Matrix3<f64>, Vector3<f64>)> {
            if many {
                return MirrorAndLens::of(eye, foot)?.plane_sums(flat, pictures);
            }
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
        let count = corners.len().div_ceil(each);
        problem.budget.spend_predicted(count);
        let (mut chi2, mut information, mut gradient) = evaluate(&foot)?;
        let mut damping = 1e-6;
        for _ in 0..steps {
            let mut damped = information;
            for i in 0..3 {
                damped[(i, i)] *= 1.0 + damping;
            }
            let step = damped.cholesky()?.solve(&gradient);
            // The remaining gain is negligible: the step is taken without another evaluation.
            if step.dot(&gradient) < SOLVER.board_gain * chi2 {
                foot += step;
                break;
            }
            problem.budget.spend_predicted(count);
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
}
