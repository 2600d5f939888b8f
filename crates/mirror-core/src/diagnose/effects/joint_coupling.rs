//! A joint that moves together with another: `θ_J = q_J + c q_K`.

use super::about::{About, PlaceKind, WrittenTo};
use super::{Effect, Place, named};
use crate::diagnose::model::elementary::{Atom, Column, Weight};
use crate::diagnose::model::scene::Scene;
use crate::robot::JointTerm;

/// See the module.
pub(crate) struct JointCoupling;

impl Effect for JointCoupling {
    fn name(&self) -> &str {
        "joint_coupling"
    }

    fn parameters(&self) -> Vec<String> {
        named(&["coupling"])
    }

    /// All ordered pairs of joints of one limb (one carries the other): cables and gears run along a limb. A mimic joint
    /// stands for the joint that it follows, which is the one to name.
    fn places(&self, scene: &Scene) -> Vec<Place> {
        let nodes = scene.nodes();
        let mut places = Vec::new();
        for j in (0..nodes).filter(|&j| scene.is_seen(j)) {
            for k in (0..nodes).filter(|&k| k != j && scene.moves(k) && scene.body.nodes[k].follows.is_none())
            {
                if scene.body.share_a_limb(j, k) {
                    places.push(Place::JointPair(j, k));
                }
            }
        }
        places
    }

    fn prior_std(&self, _scene: &Scene, _place: Place) -> Vec<f64> {
        vec![0.05]
    }

    fn columns(&self, _scene: &Scene, place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        let Place::JointPair(n, driver) = place else { return Vec::new() };
        vec![Column { atom: Atom::Joint(n), weight: Weight::Position(driver) }]
    }

    fn is_tolerance(&self) -> bool {
        true
    }

    fn words(&self) -> &str {
        "the joint moves when another one moves"
    }

    fn about(&self) -> Option<About> {
        Some(About {
            at: PlaceKind::JointPair,
            law: "θ = q + c q_other",
            remedy: "feed it forward (`correct --feed-forward`), or repair the coupling",
            written_to: WrittenTo::Nothing,
            joint_law: &[JointTerm::Coupling],
            signature: "a cloud against its own position, a line against the other joint's",
            shown_by: "both joints moved independently of each other",
            confused_with: "`joint_compliance`, where the other joint makes the load",
        })
    }
}
