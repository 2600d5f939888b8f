//! An error of the focal length, by a factor 1 + e.

use super::about::{About, PlaceKind, WrittenTo};
use super::{Effect, Place, named};
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::scene::Scene;

/// See the module.
pub(crate) struct CameraFocal;

impl Effect for CameraFocal {
    fn name(&self) -> &str {
        "camera_focal"
    }

    fn parameters(&self) -> Vec<String> {
        named(&["scale_error"])
    }

    fn places(&self, scene: &Scene) -> Vec<Place> {
        if scene.has_camera { vec![Place::Camera] } else { Vec::new() }
    }

    fn prior_std(&self, _scene: &Scene, _place: Place) -> Vec<f64> {
        vec![0.02]
    }

    fn columns(&self, _scene: &Scene, _place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        vec![Column::constant(Atom::Focal)]
    }

    fn words(&self) -> &str {
        "the focal length is off"
    }

    fn about(&self) -> Option<About> {
        Some(About {
            at: PlaceKind::Camera,
            law: "f = (1 + e) f_nominal",
            remedy: "calibrate the camera",
            written_to: WrittenTo::CameraFile,
            joint_law: &[],
            signature: "errors grow with the distance from the picture's centre",
            shown_by: "the board near and far, in the middle and at the edge",
            confused_with: "`board_scale` at one distance",
        })
    }
}
