//! The mirror of a frame, estimated from its board alone.

use super::mirror_and_lens::{MirrorAndLens, Points};
use super::pictures::Pictures;
use super::plane_start::{by_closed_form, by_size};
use super::products::PROJECTED;
use super::sight::mirrored_pixel;
use super::work::FrameWork;
use crate::diagnose::model::camera_and_mirror::Eye;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::free_optics::corner_point;
use crate::diagnose::model::problem::{BoardFit, Problem};
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::model::work_budget::Effort;
use crate::diagnose::principles::Count;
use crate::error::{Error, Result};
use crate::least_squares::{Damping, LeastSquares, Normal, Stop, descend};
use core::cell::RefCell;
use nalgebra::{Vector2, Vector3};

/// A board with fewer corners than this does not show a plane with a margin: one more than the plane has numbers.
pub(crate) const FEWEST_CORNERS: Count = PROJECTED + 1;

/// A frame's corners as functions of the mirror's foot point.
struct BoardView<'a> {
    problem: &'a Problem,
    eye: &'a Eye,
    corners: &'a [(usize, Vector2<f64>)],
    /// Of the corners every so many-th is used.
    each: usize,
    /// Where these are, in the camera's frame; for `flat` they are not needed.
    camera_from_corners: &'a [Vector3<f64>],
    /// The same for vectors, where the eye allows them.
    flat: Option<&'a Points>,
    pictures: RefCell<&'a mut Pictures>,
}

impl LeastSquares for BoardView<'_> {
    type State = Vector3<f64>;
    type Equations = Normal<3>;
    type Step = Vector3<f64>;
    const WHAT: &'static str = "mirror of a frame";
    const DAMPING: Damping = Damping { least: 0.0, first: 1e-3, rise: 10.0, fall: 10.0 };
    const LAST_STEP_UNSEEN: bool = true;

    fn evaluate(&self, foot: &Vector3<f64>, normal: &mut Normal<3>) -> Result<f64> {
        let unseen = || Error::Undetermined { what: Self::WHAT };
        self.problem.budget.spend(Effort::Predicted(self.corners.len().div_ceil(self.each)));
        *normal = Normal::zero();
        if let Some(flat) = self.flat {
            let mut pictures = self.pictures.borrow_mut();
            let sums =
                MirrorAndLens::of(self.eye, foot).and_then(|optics| optics.plane_sums(flat, &mut pictures));
            let (chi2, information, by_residual) = sums.ok_or_else(unseen)?;
            *normal = Normal { cost: chi2, gradient: -by_residual, information };
        } else {
            for ((_, pixel), point) in self.corners.iter().step_by(self.each).zip(self.camera_from_corners) {
                let (at, by_foot) = mirrored_pixel(self.eye, foot, point).ok_or_else(unseen)?;
                let r = at - pixel;
                normal.cost += r.norm_squared();
                normal.information += by_foot.tr_mul(&by_foot);
                normal.gradient += by_foot.tr_mul(&r);
            }
        }
        Ok(normal.cost)
    }

    fn step(
        &self,
        _: &Vector3<f64>,
        normal: &Normal<3>,
        damping: f64,
    ) -> Result<Option<(Vector3<f64>, f64)>> {
        normal.step(damping).map(Some).ok_or(Error::Undetermined { what: Self::WHAT })
    }

    fn moved(&self, foot: &Vector3<f64>, step: &Vector3<f64>) -> Result<Vector3<f64>> {
        Ok(foot + step)
    }
}

impl FrameWork {
    /// Fits the mirror to the frame's board alone, from a start or from the plane half-way to its reflection.
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
        if let Some(foot) = start {
            return self.fit_board_from(problem, deformation, eye, foot);
        }
        let frame = self.frame;
        let board = problem.board_in(frame)?;
        if problem.frames[frame].corners.len() < FEWEST_CORNERS {
            return None;
        }
        let camera_from_board = self.camera_from_world(problem, eye).then(&self.world_from_board(&board));
        problem.budget.spend(Effort::Posed(problem.frames[frame].corners.len()));
        [by_closed_form, by_size].into_iter().find_map(|starts| {
            let foot = starts(problem, eye, &camera_from_board, frame)?;
            self.fit_board_from(problem, deformation, eye, foot)
        })
    }

    /// Gauss–Newton on the corners from a foot point.
    fn fit_board_from(
        &mut self,
        problem: &Problem,
        deformation: &Deformation,
        eye: &Eye,
        foot: Vector3<f64>,
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
        let many = MirrorAndLens::of(eye, &foot).is_some();
        let points: Vec<Vector3<f64>> = if many {
            self.pose_corners(problem, eye, &problem.frames[frame], scale, each);
            Vec::new()
        } else {
            let of = |index| camera_from_board.point(&corner_point(problem, eye, index, scale));
            corners.iter().step_by(each).map(|(index, _)| of(*index)).collect()
        };
        let view = BoardView {
            problem,
            eye,
            corners,
            each,
            camera_from_corners: &points,
            flat: many.then_some(&self.points),
            pictures: RefCell::new(&mut self.pictures),
        };
        let stop = Stop { steps, decrease: 0.0, share: SOLVER.board_gain };
        let found = descend(&view, foot, [Normal::zero(), Normal::zero()], stop).ok()?;
        let information = found.equations.information;
        Some(BoardFit { foot: found.state, information, chi2_px2: found.cost, corners: corners.len() })
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
