//! Residuals of the corners and markers of an evaluated frame, in the picture.

use super::work::FrameWork;
use crate::diagnose::data::recording::Via;
use crate::diagnose::model::problem::{Observation, Problem, Seen};
use nalgebra::{Matrix2x3, Vector2};

/// A corner of the board, seen in the mirror.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SeenCorner {
    /// Its index on the board.
    pub index: usize,
    /// Where it was seen, px.
    pub pixel: Vector2<f64>,
    /// Seen less predicted, px.
    pub residual_px: Vector2<f64>,
    /// How its picture moves with it in the board's frame, px/m.
    pub by_board: Matrix2x3<f64>,
}

/// A marker in the picture.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PicturedMarker {
    /// Where it was seen, px.
    pub pixel: Vector2<f64>,
    /// Seen less predicted, px.
    pub residual_px: Vector2<f64>,
}

impl FrameWork {
    /// Whether each observation of the frame evaluated last, board included, has its row: one that cannot be
    /// predicted has none.
    fn in_step(&self, problem: &Problem) -> bool {
        let data = &problem.frames[self.frame];
        self.has_plane && self.rows.len() == data.corners.len() + data.others.len()
    }

    /// The mirrored corners of the frame that was evaluated last, with its board; none where rows and corners are not in step.
    pub fn seen_corners<'a>(&'a self, problem: &'a Problem) -> impl Iterator<Item = SeenCorner> + 'a {
        let corners = &problem.frames[self.frame].corners;
        let world_from_board = problem
            .board_in(self.frame)
            .map(|b| self.world_from_board(&b).r)
            .filter(|_| self.in_step(problem));
        world_from_board.into_iter().flat_map(move |world_from_board| {
            self.rows.iter().zip(corners).map(move |(row, (index, pixel))| SeenCorner {
                index: *index,
                pixel: *pixel,
                residual_px: row.residual.xy() / row.scale,
                by_board: (row.by_world * world_from_board).fixed_rows::<2>(0) / row.scale,
            })
        })
    }

    /// The mirrored markers of the frame that was evaluated last, with its board.
    pub fn pictured_markers<'a>(&'a self, problem: &'a Problem) -> impl Iterator<Item = PicturedMarker> + 'a {
        let data = &problem.frames[self.frame];
        let first = if self.in_step(problem) { data.corners.len() } else { self.rows.len() };
        self.rows[first..].iter().zip(&data.others).filter_map(|(row, observation)| match observation {
            Observation::Pixel { seen: Seen::Marker(_), via: Via::Mirror, pixel } => {
                Some(PicturedMarker { pixel: *pixel, residual_px: row.residual.xy() / row.scale })
            }
            _ => None,
        })
    }
}
