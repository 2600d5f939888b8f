//! All markers are found beside their place in the picture, against the board's corners.
//!
//! `pixel = image + d + G (pixel − c)`, c the principal point that the session states.
//!
//! A colour that is stored at half the picture's resolution, one-sided light on the balls, or a detector's own rounding moves every
//! marker's image by about the same vector and no corner (d). A lens whose focal length differs from colour to colour moves the
//! coloured markers in proportion to their distance from the picture's centre, and no black corner; light from one side of the
//! room moves them more on that side (G). Without a name for it a pane of glass or mounts fit it.

use super::about::{About, PlaceKind, WrittenTo};
use super::{Effect, Place, named};
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::scene::Scene;
use crate::diagnose::principles::Prior;

/// Usual growth across the picture, px for each px.
const GROWTH: Prior = 1e-3;

/// See the module.
pub(crate) struct MarkerImage;

impl Effect for MarkerImage {
    fn name(&self) -> &str {
        "marker_image"
    }

    fn parameters(&self) -> Vec<String> {
        named(&["du_px", "dv_px", "du_by_u", "du_by_v", "dv_by_u", "dv_by_v"])
    }

    /// Where markers and a board are seen: without corners it is an error of the principal point.
    fn places(&self, scene: &Scene) -> Vec<Place> {
        if scene.has_camera && scene.has_board { vec![Place::Camera] } else { Vec::new() }
    }

    /// One pixel: half of a pixel of colour, where colour has half the resolution. A thousandth of the distance from the
    /// picture's centre: a lens without correction spreads colours by up to a pixel at the edge.
    fn prior_std(&self, _scene: &Scene, _place: Place) -> Vec<f64> {
        let mut std = vec![GROWTH; 6];
        std[..2].fill(1.0);
        std
    }

    fn columns(&self, _scene: &Scene, _place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        let constant = (0..2).map(|k| Atom::MarkerImage(k, 0));
        let growing = (0..2).flat_map(|k| (1..3).map(move |by| Atom::MarkerImage(k, by)));
        constant.chain(growing).map(Column::constant).collect()
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
            law: "pixel of a marker = image of the marker + (du, dv) + G · (pixel − principal point), G = ((du_by_u, du_by_v), (dv_by_u, dv_by_v)); corners as they are",
            remedy: "save pictures without compressed colour, light the markers from the camera, calibrate the camera in the markers' colours, or subtract the law from the markers' pixels",
            written_to: WrittenTo::Nothing,
            joint_law: &[],
            signature: "all markers are off in the picture by one vector, or by one that grows across it, at any distance; the board's corners are not",
            shown_by: "markers near and far from the mirror",
            confused_with: "`board_mount`, `camera_mount` where all markers are equally far away",
        })
    }
}
