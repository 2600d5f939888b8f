//! Bending of a link, proportional to gravity's moment about its two transverse axes: a rotation `c m_⟂` about the
//! middle of the link. m is the moment there of all that the link carries and of its own mass.

use super::about::{About, PlaceKind, WrittenTo};
use super::{Effect, LawFreedom, Place, joint_of, named};
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::elementary::{Atom, Column, Weight, transverse_moment};
use crate::diagnose::model::scene::Scene;
use crate::diagnose::model::solver::NEGLIGIBLE;

/// See the module.
pub(crate) struct LinkBending;

fn largest_moment(scene: &Scene, n: NodeId) -> f64 {
    (0..scene.frames).map(|f| transverse_moment(scene, f, n).norm()).fold(0.0, f64::max)
}

impl Effect for LinkBending {
    fn name(&self) -> &str {
        "link_bending"
    }

    fn parameters(&self) -> Vec<String> {
        named(&["compliance_rad_per_nm"])
    }

    fn places(&self, scene: &Scene) -> Vec<Place> {
        (0..scene.nodes())
            .filter(|&n| scene.relevant[n] && largest_moment(scene, n) > NEGLIGIBLE)
            .map(|n| Place::Link(Some(n)))
            .collect()
    }

    fn prior_std(&self, scene: &Scene, place: Place) -> Vec<f64> {
        joint_of(place).map(|n| 0.03 / largest_moment(scene, n)).into_iter().collect()
    }

    fn columns(&self, _scene: &Scene, place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        joint_of(place).map(|n| Column { atom: Atom::Bend(n), weight: Weight::One }).into_iter().collect()
    }

    fn is_positive(&self) -> bool {
        true
    }

    fn depends_on_load(&self) -> bool {
        true
    }

    fn law_freedom(&self) -> LawFreedom {
        LawFreedom::Moment
    }

    fn words(&self) -> &str {
        "the link bends under the load of gravity"
    }

    fn about(&self) -> Option<About> {
        Some(About {
            at: PlaceKind::Link,
            law: "the link turns about its middle by c times the moment across it",
            remedy: "stiffen the link, or model it as flexible",
            written_to: WrittenTo::Mjcf,
            joint_law: &[],
            signature: "a line against load, across the link",
            shown_by: "loads that change",
            confused_with: "`joint_compliance` of the joint before: the lever arms differ by half the link only",
        })
    }
}
