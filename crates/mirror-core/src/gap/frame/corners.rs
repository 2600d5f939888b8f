//! The board's corners of an evaluated frame: what is left of each.

use super::*;

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

impl FrameWork {
    /// The corners of the frame that was evaluated last, with its board; none where one of them cannot be predicted.
    pub fn seen_corners<'a>(&'a self, problem: &'a Problem) -> impl Iterator<Item = SeenCorner> + 'a {
        let data = &problem.frames[self.frame];
        let mirrored = data.corners.len();
        let direct =
            data.others.iter().filter(|o| matches!(o, Observation::Pixel { seen: Seen::Corner(_), .. }));
        // A corner that cannot be predicted has no row: then rows and corners are not in step.
        let in_step = self.rows.iter().filter(|r| r.marker.is_none()).count() == mirrored + direct.count();
        let world_from_board =
            problem.board.map(|b| self.poses.site(&b).r).filter(|_| in_step && self.has_plane);
        let rows = self.rows.iter().take(mirrored);
        world_from_board.into_iter().flat_map(move |world_from_board| {
            rows.clone().zip(&data.corners).map(move |(row, (index, pixel))| SeenCorner {
                index: *index,
                pixel: *pixel,
                residual_px: row.residual.xy() / row.scale,
                by_board: (row.by_world * world_from_board).fixed_rows::<2>(0) / row.scale,
            })
        })
    }
}
