//! Bending of a link, proportional to gravity's moment about its two transverse axes: a rotation `c m_⟂` about the
//! middle of the link. m is the moment there of all that the link carries and of its own mass.
//!
//! Real links bend all along their length. So the law is tried in a second form as well, that of a uniform beam: the same turn under
//! what the link carries, another one under its own mass, and an end that sags farther than the turn about the middle tells
//! ([`BeamLoad`](crate::diagnose::model::kinematics::BeamLoad)).

use super::about::{About, PlaceKind, WrittenTo};
use super::{Effect, LawFreedom, Place, named};
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::elementary::{Atom, Column, transverse_load, transverse_moment};
use crate::diagnose::model::scene::Scene;
use crate::diagnose::model::solver::NEGLIGIBLE;
use crate::diagnose::principles::Grid;

/// See the module.
pub(crate) struct LinkBending;

/// The forms of the law: a hinge in the link's middle, a uniform beam.
const HINGE: Grid = 0.0;
const BEAM: Grid = 1.0;

fn largest_moment(scene: &Scene, n: NodeId) -> f64 {
    let of_hinge = scene.largest_moment(n, |f| transverse_moment(scene, f, n).norm());
    if bends_as_a_beam(scene, n) { of_hinge.max(largest_of_beam(scene, n)) } else { of_hinge }
}

fn largest_of_beam(scene: &Scene, n: NodeId) -> f64 {
    scene.largest_moment(n, |f| transverse_load(scene, f, n).moment.norm())
}

/// Whether the second form is another one than the first: the link has a length, and its moment turns its end.
fn bends_as_a_beam(scene: &Scene, n: NodeId) -> bool {
    let sags = |f: usize| transverse_load(scene, f, n).sag.norm() > NEGLIGIBLE;
    largest_of_beam(scene, n) > NEGLIGIBLE && (0..scene.frames).any(sags)
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
        place.node().map(|n| 0.03 / largest_moment(scene, n)).into_iter().collect()
    }

    fn variants(&self, scene: &Scene, place: Place) -> Vec<f64> {
        match place.node() {
            Some(n) if bends_as_a_beam(scene, n) => vec![HINGE, BEAM],
            _ => vec![HINGE],
        }
    }

    fn variants_near(&self, scene: &Scene, place: Place, _variant: f64) -> Vec<f64> {
        self.variants(scene, place)
    }

    fn columns(&self, _scene: &Scene, place: Place, variant: f64, _parameters: &[f64]) -> Vec<Column> {
        let atom = if variant == BEAM { Atom::Beam } else { Atom::Bend };
        place.node().map(|n| Column::constant(atom(n))).into_iter().collect()
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
            law: "the link turns about its middle by c times the moment across it, or bends as a uniform beam of compliance c",
            remedy: "stiffen the link, or model it as flexible",
            written_to: WrittenTo::Mjcf,
            joint_law: &[],
            signature: "a line against load, across the link",
            shown_by: "loads that change",
            confused_with: "`joint_compliance` of the joint before: the lever arms differ by half the link only",
        })
    }
}
