//! A displaced board: real board = nominal ∘ (Exp ω, v) on its link. A camera on the same body moves together with
//! it, so the reported displacement is that of both; the camera relative to the board is `camera_mount`.

use super::about::{About, PlaceKind, WrittenTo};
use super::{Concern, Effect, Place, named};
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::scene::Scene;

/// See the module.
pub(crate) struct BoardMount;

impl Effect for BoardMount {
    fn name(&self) -> &str {
        "board_mount"
    }

    fn parameters(&self) -> Vec<String> {
        named(&["rx_rad", "ry_rad", "rz_rad", "dx_m", "dy_m", "dz_m"])
    }

    fn places(&self, scene: &Scene) -> Vec<Place> {
        if scene.has_board { vec![Place::Board] } else { Vec::new() }
    }

    fn prior_std(&self, _scene: &Scene, _place: Place) -> Vec<f64> {
        vec![0.02, 0.02, 0.02, 0.004, 0.004, 0.004]
    }

    fn columns(&self, _scene: &Scene, _place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        (0..6).map(|k| Column::constant(Atom::BoardMount(k))).collect()
    }

    fn concern(&self, _place: Place) -> Concern {
        Concern::Setup
    }

    fn words(&self) -> &str {
        "the board is displaced on its link; a camera on the same link moves with it"
    }

    fn about(&self) -> Option<About> {
        Some(About {
            at: PlaceKind::Board,
            law: "board = nominal ∘ (Exp ω, v); a camera on the same body moves with it",
            remedy: "measure the board's place and write its mount into the URDF",
            written_to: WrittenTo::Urdf,
            joint_law: &[],
            signature: "all markers shift together in the board's frame",
            shown_by: "both arms in many postures",
            confused_with: "`joint_offset` of all joints next to the board's body together",
        })
    }
}
