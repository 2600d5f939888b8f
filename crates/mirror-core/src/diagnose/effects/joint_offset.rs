//! A wrong zero: `θ = q + a`.

use super::about::{About, PlaceKind, WrittenTo};
use super::{Effect, Place, joint_error, joints, named};
use crate::diagnose::model::elementary::{Atom, Column, Weight};
use crate::diagnose::model::scene::Scene;
use crate::robot::JointTerm;

/// See the module.
pub(crate) struct JointOffset;

impl Effect for JointOffset {
    fn name(&self) -> &str {
        "joint_offset"
    }

    fn parameters(&self) -> Vec<String> {
        named(&["offset_rad"])
    }

    fn places(&self, scene: &Scene) -> Vec<Place> {
        joints(scene)
    }

    fn prior_std(&self, scene: &Scene, place: Place) -> Vec<f64> {
        place.node().map(|n| joint_error(scene, n, 0.05)).into_iter().collect()
    }

    fn columns(&self, _scene: &Scene, place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        let Some(n) = place.node() else { return Vec::new() };
        vec![Column { atom: Atom::Joint(n), weight: Weight::One }]
    }

    fn may_be_of_another_part(&self) -> bool {
        true
    }

    fn words(&self) -> &str {
        "the zero of the joint is wrong by a constant"
    }

    fn about(&self) -> Option<About> {
        Some(About {
            at: PlaceKind::Joint,
            law: "θ = q + o",
            remedy: "recalibrate the joint's zero, or write it into the URDF",
            written_to: WrittenTo::Urdf,
            joint_law: &[JointTerm::Offset],
            signature: "one height in all four panels",
            shown_by: "any posture; two markers beyond the joint's neighbours",
            confused_with: "of the last joint: `marker_mount`. With one region of postures only: everything else at that joint",
        })
    }
}
