//! Many views at once, on all cores.

use super::board::{Board, BoardView, DetectedCorner};
use super::estimate::{MirrorEstimate, MirrorEstimator};
use super::options::EstimatorOptions;
use super::planar::{PlanarPose, planar_pose};
use super::rig::Rig;
use crate::camera::Camera;
use crate::cancel::Cancel;
use crate::error::{Error, Result};
use nalgebra::Vector2;
use rayon::prelude::*;

/// With fewer views than this a thread is not worthwhile: 16 take some 0.2 ms.
const SMALLEST_SHARE: usize = 16;

/// A view from a row of pixels, one pair a corner in the order of its index: `u, v, u, v, …`; a pair that is not a
/// number is a corner that was not seen.
///
/// # Errors
/// [`Error::LengthMismatch`] for a row of other length, [`Error::NotFinite`] for half a pair or an infinite number,
/// and as [`BoardView::new`].
pub fn view_from_row(board: &Board, row: &[f64]) -> Result<BoardView> {
    let needed = 2 * board.corner_count();
    if row.len() != needed {
        return Err(Error::LengthMismatch {
            what: "numbers of a board's pixels".into(),
            got: row.len(),
            needed,
        });
    }
    let detections: Vec<_> = row
        .chunks_exact(2)
        .enumerate()
        .filter(|(_, pair)| !(pair[0].is_nan() && pair[1].is_nan()))
        .map(|(index, pair)| DetectedCorner { index, pixel: Vector2::new(pair[0], pair[1]) })
        .collect();
    BoardView::new(board, &detections)
}

/// The mirrors of many views, one result a row of pixels (see [`view_from_row`]), in their order, on all cores.
///
/// Rows that are not done when `cancel` says stop are [`Error::Cancelled`].
pub fn estimate_rows(
    estimator: MirrorEstimator,
    rig: &Rig,
    rows: &[f64],
    options: &EstimatorOptions,
    cancel: &Cancel,
) -> Vec<Result<MirrorEstimate>> {
    rows.par_chunks(2 * rig.board.corner_count())
        .with_min_len(SMALLEST_SHARE)
        .map(|row| {
            cancel.check()?;
            estimator.estimate(rig, &view_from_row(&rig.board, row)?, options)
        })
        .collect()
}

/// The poses of many views of a board, one result a row of pixels (see [`view_from_row`]), in their order, on all cores.
///
/// Rows that are not done when `cancel` says stop are [`Error::Cancelled`].
pub fn planar_pose_rows(
    camera: &Camera,
    board: &Board,
    rows: &[f64],
    options: &EstimatorOptions,
    cancel: &Cancel,
) -> Vec<Result<PlanarPose>> {
    rows.par_chunks(2 * board.corner_count())
        .with_min_len(SMALLEST_SHARE)
        .map(|row| {
            cancel.check()?;
            planar_pose(camera, &view_from_row(board, row)?, options)
        })
        .collect()
}
