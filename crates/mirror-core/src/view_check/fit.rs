//! How well a reading explains the views: the board's residual in the best mirrors, and the markers' distances in those.

use super::reading::{Labels, Pictures, Reading, Scale};
use super::views::{View, Views};
use crate::camera::Camera;
use crate::cancel::Cancel;
use crate::error::Result;
use crate::geometry::Plane;
use crate::mirror::{Board, BoardView, EstimatorOptions, MirrorEstimator, Rig, view_from_row};
use crate::statistics::median_of_both;
use rayon::prelude::*;
use std::borrow::Cow;

/// Residuals of markers below these are as good as none when two readings are compared, px.
pub(super) const LEAST_MARKER_PX: f64 = 2.0;
/// Stands for the residual where no mirror explains a view at all, px.
const NO_MIRROR_PX: f64 = 1000.0;
/// With fewer views than this a thread is not worthwhile: four take some 0.05 ms.
const SMALLEST_SHARE: usize = 4;

/// How well a reading explains the views.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    /// The median over the views of the corners' root mean square residual in the best mirror, px; infinite where fewer than
    /// half of them have one.
    pub board_rms_px: f64,
    /// The median distance of the markers from where the model's are seen in those mirrors, px; one that cannot be seen there
    /// counts a picture's width. None where no view with a mirror shows a marker.
    pub marker_px: Option<f64>,
}

impl Fit {
    /// How many times smaller this fit's residuals are, board times markers.
    pub(super) fn gain_over(&self, other: &Self, noise_px: f64) -> f64 {
        let board = other.board_rms_px.max(noise_px).min(NO_MIRROR_PX) / self.board_rms_px.max(noise_px);
        let markers = match (self.marker_px, other.marker_px) {
            (Some(own), Some(other)) => other.max(LEAST_MARKER_PX) / own.max(LEAST_MARKER_PX),
            _ => 1.0,
        };
        board * markers
    }
}

/// The mirror of a view and the corners' residual, px; none where no mirror explains it.
type Mirror = Option<(Plane, f64)>;

impl Views {
    /// A view's corners as a reading has them; none where they cannot be used.
    fn corners_of(&self, row: usize, reading: &Reading, board: &Board) -> Option<Cow<'_, BoardView>> {
        let view = &self.views[row];
        if reading.pictures == Pictures::AsTheyAre && reading.labels == Labels::AsTheyAre {
            if let Scale::Squares(_) = reading.scale {
                return view_from_row(board, &view.corners_px).ok().map(Cow::Owned);
            }
            return self.corners[row].as_ref().map(Cow::Borrowed);
        }
        let mut meant_px = Vec::with_capacity(view.corners_px.len());
        for index in 0..board.corner_count() {
            let given = 2 * reading.labels.given_as(index, board.corners());
            let pixel = [view.corners_px[given], view.corners_px[given + 1]];
            meant_px.extend(reading.pictures.meant_px(pixel, self.camera.size_px()));
        }
        view_from_row(board, &meant_px).ok().map(Cow::Owned)
    }

    /// The mirrors of all views as a reading has them, on all cores.
    fn mirrors(&self, reading: &Reading, cancel: &Cancel) -> Result<(Camera, Vec<Mirror>)> {
        let (camera, board) = (reading.scale.camera(&self.camera)?, reading.scale.board(&self.board)?);
        let mirror = |(row, view): (usize, &View)| {
            cancel.check()?;
            let Some(corners) = self.corners_of(row, reading, &board) else { return Ok(None) };
            let pose = reading.optical_from_modelled * view.camera_from_board * reading.board_from_meant;
            let rig = Rig::new(camera.clone(), board, pose).with_optics(self.optics);
            let options = EstimatorOptions::default();
            let found = MirrorEstimator::MaximumLikelihood.estimate(&rig, &corners, &options).ok();
            Ok(found.map(|mirror| (mirror.plane, mirror.rms_px)))
        };
        let all = self.views.par_iter().enumerate().with_min_len(SMALLEST_SHARE).map(mirror);
        let mirrors = all.collect::<Result<Vec<_>>>()?;
        Ok((camera, mirrors))
    }

    /// [`Fit::board_rms_px`] of a reading.
    ///
    /// # Errors
    /// As [`Views::fit`].
    pub(super) fn board_rms_px(&self, reading: &Reading, cancel: &Cancel) -> Result<f64> {
        Ok(median_rms_px(&self.mirrors(reading, cancel)?.1))
    }

    /// How well a reading explains the views.
    ///
    /// # Errors
    /// Numbers that make no camera or board ([`Scale::camera`], [`Scale::board`]), [`crate::Error::Cancelled`].
    pub(super) fn fit(&self, reading: &Reading, cancel: &Cancel) -> Result<Fit> {
        let (camera, mirrors) = self.mirrors(reading, cancel)?;
        let marker_px = self.markers_px(reading, &camera, &mirrors);
        Ok(Fit { board_rms_px: median_rms_px(&mirrors), marker_px })
    }

    fn markers_px(&self, reading: &Reading, camera: &Camera, mirrors: &[Mirror]) -> Option<f64> {
        let size = self.camera.size_px();
        let mut away_px = Vec::new();
        for (view, mirror) in self.views.iter().zip(mirrors) {
            let Some((plane, _)) = mirror else { continue };
            for seen in &view.markers {
                let [u, v] = reading.pictures.meant_px([seen.pixel.x, seen.pixel.y], size);
                let point = reading.optical_from_modelled * seen.point_in_camera;
                let expected = self.optics.project(camera, plane, &point);
                away_px.push(expected.map_or(f64::from(size.0), |at| (at.x - u).hypot(at.y - v)));
            }
        }
        (!away_px.is_empty()).then(|| median_of_both(away_px))
    }
}

fn median_rms_px(mirrors: &[Mirror]) -> f64 {
    median_of_both(mirrors.iter().map(|mirror| mirror.map_or(f64::INFINITY, |(_, rms_px)| rms_px)).collect())
}
