//! A proportional transmission error: `θ = (1 + e) q`.

use super::about::{About, PlaceKind, WrittenTo};
use super::{Effect, Place, moving_joints, named};
use crate::diagnose::model::elementary::{Atom, Column, Weight};
use crate::diagnose::model::scene::Scene;
use crate::robot::JointTerm;

/// See the module.
pub(crate) struct GearRatio;

impl Effect for GearRatio {
    fn name(&self) -> &str {
        "gear_ratio"
    }

    fn parameters(&self) -> Vec<String> {
        named(&["scale_error"])
    }

    fn places(&self, scene: &Scene) -> Vec<Place> {
        moving_joints(scene)
    }

    fn prior_std(&self, _scene: &Scene, _place: Place) -> Vec<f64> {
        vec![0.04]
    }

    fn columns(&self, _scene: &Scene, place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        let Some(n) = place.node() else { return Vec::new() };
        vec![Column { atom: Atom::Joint(n), weight: Weight::Position(n) }]
    }

    fn is_tolerance(&self) -> bool {
        true
    }

    fn may_be_of_another_part(&self) -> bool {
        true
    }

    fn words(&self) -> &str {
        "the joint turns by a fixed percentage too much or too little"
    }

    fn about(&self) -> Option<About> {
        Some(About {
            at: PlaceKind::Joint,
            law: "θ = (1 + e) q",
            remedy: "correct the transmission's ratio in the driver",
            written_to: WrittenTo::Mjcf,
            joint_law: &[JointTerm::Share],
            signature: "a line through zero against position",
            shown_by: "both ends of the range",
            confused_with: "`joint_compliance` where load grows with q; `joint_offset` where q stays on one side",
        })
    }
}
