//! A periodic transmission error, once a turn of the output: `θ = q + s sin q + c cos q − c`.

use super::about::{About, PlaceKind, WrittenTo};
use super::{Effect, Place, joint_error, moving_joints, named};
use crate::diagnose::model::elementary::{Atom, Column, Weight};
use crate::diagnose::model::scene::Scene;
use crate::robot::JointTerm;

/// See the module.
pub(crate) struct GearEccentricity;

impl Effect for GearEccentricity {
    fn name(&self) -> &str {
        "gear_eccentricity"
    }

    fn parameters(&self) -> Vec<String> {
        named(&["sin_rad", "cos_rad"])
    }

    /// Joints that turn: what slides has no turn of its output.
    fn places(&self, scene: &Scene) -> Vec<Place> {
        let turns = |place: &Place| place.node().is_some_and(|n| !scene.body.nodes[n].prismatic);
        moving_joints(scene).into_iter().filter(turns).collect()
    }

    fn prior_std(&self, scene: &Scene, place: Place) -> Vec<f64> {
        place.node().map_or_else(Vec::new, |n| vec![joint_error(scene, n, 0.03); 2])
    }

    fn columns(&self, _scene: &Scene, place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        let Some(n) = place.node() else { return Vec::new() };
        vec![
            Column { atom: Atom::Joint(n), weight: Weight::Sine(n) },
            Column { atom: Atom::Joint(n), weight: Weight::CosineLessOne(n) },
        ]
    }

    fn is_tolerance(&self) -> bool {
        true
    }

    fn words(&self) -> &str {
        "the gear is eccentric: the error repeats once a turn"
    }

    fn about(&self) -> Option<About> {
        Some(About {
            at: PlaceKind::Joint,
            law: "θ = q + s sin q + c (cos q − 1)",
            remedy: "feed it forward (`correct --feed-forward`), or correct the encoder's reading",
            written_to: WrittenTo::Nothing,
            joint_law: &[JointTerm::Sine, JointTerm::CosineLessOne],
            signature: "one wave a turn against position, zero at q = 0",
            shown_by: "a range of 90° or more",
            confused_with: "over a short range `gear_ratio` or `joint_offset`",
        })
    }
}
