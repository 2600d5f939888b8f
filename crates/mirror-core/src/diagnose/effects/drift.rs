//! A zero that drifts with time: `θ = q + r t`, t from the first frame.

use super::about::{About, PlaceKind, WrittenTo};
use super::{Effect, LawFreedom, Place, joint_error, joints, named};
use crate::diagnose::model::elementary::{Atom, Column, Weight};
use crate::diagnose::model::scene::Scene;
use crate::robot::JointTerm;

/// See the module.
pub(crate) struct Drift;

impl Effect for Drift {
    fn name(&self) -> &str {
        "drift"
    }

    fn parameters(&self) -> Vec<String> {
        named(&["rate_rad_per_s"])
    }

    fn places(&self, scene: &Scene) -> Vec<Place> {
        joints(scene)
    }

    fn prior_std(&self, scene: &Scene, place: Place) -> Vec<f64> {
        let duration =
            scene.time_s.last().zip(scene.time_s.first()).map_or(1.0, |(b, a)| (b - a).abs().max(1e-9));
        place.node().map(|n| joint_error(scene, n, 0.04) / duration).into_iter().collect()
    }

    fn columns(&self, _scene: &Scene, place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        let Some(n) = place.node() else { return Vec::new() };
        vec![Column { atom: Atom::Joint(n), weight: Weight::Time }]
    }

    fn law_freedom(&self) -> LawFreedom {
        LawFreedom::Time
    }

    fn words(&self) -> &str {
        "the zero of the joint drifts with time"
    }

    fn about(&self) -> Option<About> {
        Some(About {
            at: PlaceKind::Joint,
            law: "θ = q + r t",
            remedy: "home the joint, or warm the robot up before use",
            written_to: WrittenTo::Nothing,
            joint_law: &[JointTerm::Rate],
            signature: "a line against time",
            shown_by: "the same postures early and late",
            confused_with: "whatever was changed slowly in the session; visit postures in random order",
        })
    }
}
