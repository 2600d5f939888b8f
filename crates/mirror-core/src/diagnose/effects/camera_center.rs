//! An error of the principal point.

use super::about::{About, PlaceKind, WrittenTo};
use super::{Effect, Place, named};
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::scene::Scene;

/// See the module.
pub(crate) struct CameraCenter;

impl Effect for CameraCenter {
    fn name(&self) -> &str {
        "camera_center"
    }

    fn parameters(&self) -> Vec<String> {
        named(&["du_px", "dv_px"])
    }

    fn places(&self, scene: &Scene) -> Vec<Place> {
        if scene.has_camera { vec![Place::Camera] } else { Vec::new() }
    }

    fn prior_std(&self, _scene: &Scene, _place: Place) -> Vec<f64> {
        vec![8.0; 2]
    }

    fn columns(&self, _scene: &Scene, _place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        (0..2).map(|k| Column::constant(Atom::Center(k))).collect()
    }

    fn words(&self) -> &str {
        "the principal point is off"
    }

    fn about(&self) -> Option<About> {
        Some(About {
            at: PlaceKind::Camera,
            law: "c = c_nominal + (du, dv)",
            remedy: "calibrate the camera",
            written_to: WrittenTo::CameraFile,
            joint_law: &[],
            signature: "one shift in the picture",
            shown_by: "mirrors at different yaw and pitch",
            confused_with: "a rotation of `camera_mount`",
        })
    }
}
