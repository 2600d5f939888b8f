//! Radial distortion that the camera's model lacks.

use super::about::{About, PlaceKind, WrittenTo};
use super::{Effect, Place, named};
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::scene::Scene;

/// See the module.
pub(crate) struct LensDistortion;

impl Effect for LensDistortion {
    fn name(&self) -> &str {
        "lens_distortion"
    }

    fn parameters(&self) -> Vec<String> {
        named(&["dk1"])
    }

    fn places(&self, scene: &Scene) -> Vec<Place> {
        if scene.has_camera { vec![Place::Camera] } else { Vec::new() }
    }

    fn prior_std(&self, _scene: &Scene, _place: Place) -> Vec<f64> {
        vec![0.05]
    }

    fn columns(&self, _scene: &Scene, _place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        vec![Column::constant(Atom::Dk1)]
    }

    fn words(&self) -> &str {
        "the lens distortion differs from the model's"
    }

    fn about(&self) -> Option<About> {
        Some(About {
            at: PlaceKind::Camera,
            law: "k₁ = k₁_nominal + dk₁",
            remedy: "calibrate the camera",
            written_to: WrittenTo::CameraFile,
            joint_law: &[],
            signature: "grows with the cube of the distance from the centre",
            shown_by: "corners and markers at the edge",
            confused_with: "`camera_focal`, where the edge is not used",
        })
    }
}
