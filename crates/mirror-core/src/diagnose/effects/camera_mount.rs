//! A displaced camera: real camera = nominal ∘ (Exp ω, v), relative to the board.

use super::about::{About, PlaceKind, WrittenTo};
use super::{Concern, Effect, Place, named};
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::scene::Scene;

/// See the module.
pub(crate) struct CameraMount;

impl Effect for CameraMount {
    fn name(&self) -> &str {
        "camera_mount"
    }

    fn parameters(&self) -> Vec<String> {
        named(&["rx_rad", "ry_rad", "rz_rad", "dx_m", "dy_m", "dz_m"])
    }

    fn places(&self, scene: &Scene) -> Vec<Place> {
        if scene.has_camera { vec![Place::Camera] } else { Vec::new() }
    }

    fn prior_std(&self, _scene: &Scene, _place: Place) -> Vec<f64> {
        vec![0.02, 0.02, 0.02, 0.004, 0.004, 0.004]
    }

    fn columns(&self, _scene: &Scene, _place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        (0..6).map(|k| Column::constant(Atom::CameraMount(k))).collect()
    }

    fn concern(&self, _place: Place) -> Concern {
        Concern::Setup
    }

    fn words(&self) -> &str {
        "the camera is displaced relative to the board"
    }

    fn about(&self) -> Option<About> {
        Some(About {
            at: PlaceKind::Camera,
            law: "camera = nominal ∘ (Exp ω, v)",
            remedy: "write the camera's mount into the URDF",
            written_to: WrittenTo::Urdf,
            joint_law: &[],
            signature: "all markers shift together in the camera's frame",
            shown_by: "mirrors that yaw and pitch: with yaw only a direction stays unseen",
            confused_with: "errors of the neck's joints, where the head stands still",
        })
    }
}
