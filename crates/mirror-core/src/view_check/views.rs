//! Views of the reflected board, and of markers beside it, as a session states them.

use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::mirror::{Board, BoardView, MirrorOptics, view_from_row};
use nalgebra::{Isometry3, Point3, Vector2};

/// A marker that a view shows in the mirror.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenMarker {
    /// Where it is seen, (u, v), px.
    pub pixel: Vector2<f64>,
    /// Where the model places it, m.
    pub point_in_camera: Point3<f64>,
}

/// One picture of the reflected board.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Where the model places the board.
    pub camera_from_board: Isometry3<f64>,
    /// The corners, one pair each in the order of their index: `u, v, u, v, …`, px; a pair of NaN was not seen.
    pub corners_px: Vec<f64>,
    /// The markers that it shows. One whose pixel or place is not finite counts as not seen.
    pub markers: Vec<SeenMarker>,
}

/// Views of one camera and one board.
#[derive(Debug, Clone)]
pub struct Views {
    pub(super) camera: Camera,
    pub(super) board: Board,
    pub(super) optics: MirrorOptics,
    pub(super) views: Vec<View>,
    /// The corners of each view as they stand; none where it cannot be used.
    pub(super) corners: Vec<Option<BoardView>>,
}

impl Views {
    /// Views of the board as stated, before a mirror with known glass or curvature.
    ///
    /// # Errors
    /// [`Error::TooFew`] for none, [`Error::LengthMismatch`] where a view has not two numbers for each corner of the board.
    pub fn new(camera: Camera, board: Board, optics: MirrorOptics, mut views: Vec<View>) -> Result<Self> {
        if views.is_empty() {
            return Err(Error::TooFew { what: "views of the board".into(), got: 0, needed: 1 });
        }
        let needed = 2 * board.corner_count();
        if let Some(view) = views.iter().find(|view| view.corners_px.len() != needed) {
            let what = "numbers of a board's pixels".into();
            return Err(Error::LengthMismatch { what, got: view.corners_px.len(), needed });
        }
        for view in &mut views {
            view.markers.retain(|seen| {
                seen.pixel.iter().chain(seen.point_in_camera.iter()).all(|number| number.is_finite())
            });
        }
        let corners = views.iter().map(|view| view_from_row(&board, &view.corners_px).ok()).collect();
        Ok(Self { camera, board, optics, views, corners })
    }

    /// Whether a picture is as high as it is wide.
    pub fn square_picture(&self) -> bool {
        let (width, height) = self.camera.size_px();
        width == height
    }
}
