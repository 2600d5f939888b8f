//! A compliant joint: its deflection is proportional to its gravity torque, `θ = q + c τ_g`.

use super::about::{About, PlaceKind, WrittenTo};
use super::{Effect, LawFreedom, Place, joint_error, loaded_joints, named};
use crate::diagnose::model::elementary::{Atom, Column, Weight};
use crate::diagnose::model::scene::Scene;
use crate::robot::JointTerm;

/// See the module.
pub(crate) struct JointCompliance;

impl Effect for JointCompliance {
    fn name(&self) -> &str {
        "joint_compliance"
    }

    fn parameters(&self) -> Vec<String> {
        named(&["compliance_rad_per_nm"])
    }

    fn places(&self, scene: &Scene) -> Vec<Place> {
        loaded_joints(scene)
    }

    fn prior_std(&self, scene: &Scene, place: Place) -> Vec<f64> {
        let Some(n) = place.node() else { return Vec::new() };
        vec![joint_error(scene, n, 0.04) / scene.largest_torque(n)]
    }

    fn columns(&self, _scene: &Scene, place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        let Some(n) = place.node() else { return Vec::new() };
        vec![Column { atom: Atom::Joint(n), weight: Weight::Torque(n) }]
    }

    fn is_positive(&self) -> bool {
        true
    }

    fn depends_on_load(&self) -> bool {
        true
    }

    fn law_freedom(&self) -> LawFreedom {
        LawFreedom::Load
    }

    fn words(&self) -> &str {
        "the joint yields under the load of gravity"
    }

    fn about(&self) -> Option<About> {
        Some(About {
            at: PlaceKind::Joint,
            law: "θ = q + c τ",
            remedy: "stiffen the joint, or feed it forward",
            written_to: WrittenTo::Mjcf,
            joint_law: &[JointTerm::Compliance],
            signature: "a line against load",
            shown_by: "arm out and arm hanging, the same q under different loads",
            confused_with: "`link_bending` of the link before, `gear_ratio`",
        })
    }
}
