//! All markers are found beside their place in the picture, against the board's corners.
//!
//! A colour that is stored at half the picture's resolution, one-sided light on the balls, or a detector's own rounding moves every
//! marker's image by about the same vector and no corner. Without a name for it a pane of glass or mounts fit it.

use super::about::{About, PlaceKind, WrittenTo};
use super::{Effect, Place, named};
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::scene::Scene;

/// See the module.
pub(crate) struct MarkerImage;

impl Effect for MarkerImage {
    fn name(&self) -> &str {
        "marker_image"
    }

    fn parameters(&self) -> Vec<String> {
        named(&["du_px", "dv_px"])
    }

    /// Where markers and a board are seen: without corners it is an error of the principal point.
    fn places(&self, scene: &Scene) -> Vec<Place> {
        if scene.has_camera && scene.has_board { vec![Place::Camera] } else { Vec::new() }
    }

    /// One pixel: half of a pixel of colour, where colour has half the resolution.
    fn prior_std(&self, _scene: &Scene, _place: Place) -> Vec<f64> {
        vec![1.0; 2]
    }

    fn columns(&self, _scene: &Scene, _place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        (0..2).map(|k| Column::constant(Atom::MarkerImage(k))).collect()
    }

    fn is_of_detection(&self) -> bool {
        true
    }

    fn words(&self) -> &str {
        "all markers are found beside their place in the picture"
    }

    fn about(&self) -> Option<About> {
        Some(About {
            at: PlaceKind::Camera,
            law: "pixel of a marker = image of the marker + (du, dv); corners as they are",
            remedy: "save pictures without compressed colour, light the markers from the camera, or subtract (du, dv) from the markers' pixels",
            written_to: WrittenTo::Nothing,
            joint_law: &[],
            signature: "all markers are off by one vector in the picture, at any distance; the board's corners are not",
            shown_by: "markers near and far from the mirror",
            confused_with: "`board_mount`, `camera_mount` where all markers are equally far away",
        })
    }
}
