//! A twisted link: the joint that it carries is turned against the model, as by a wrong `rpy` of its origin,
//! `T = T_origin · exp(ω₁ u + ω₂ v) · Rot(a, q)` with the directions u, v of `axis_tilt` in that joint's frame.
//!
//! The turn about a itself is that joint's `joint_offset`. With `exp(ω) Rot(a, q) = Rot(exp(ω) a, q) exp(ω)` a twist is
//! a tilted axis and a constant turn of all that follows; `axis_tilt` alone keeps its orientation at q = 0. What a link
//! without a next joint carries are mounts.

use super::about::{About, PlaceKind, WrittenTo};
use super::{Effect, Place, named};
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::scene::Scene;
use crate::diagnose::principles::{LOG_PRIOR_FREE, Prior};

/// See the module.
pub(crate) struct LinkTwist;

/// The joint that a link (none: the base) carries; none where it carries several, of which the link's name tells none.
fn carried(scene: &Scene, link: Option<NodeId>) -> Option<NodeId> {
    let mut all = (0..scene.nodes()).filter(|&k| scene.body.nodes[k].parent == link);
    let next = all.next()?;
    (all.next().is_none() && scene.relevant[next]).then_some(next)
}

impl Effect for LinkTwist {
    fn name(&self) -> &str {
        "link_twist"
    }

    fn parameters(&self) -> Vec<String> {
        named(&["twist_1_rad", "twist_2_rad"])
    }

    fn places(&self, scene: &Scene) -> Vec<Place> {
        let links = (0..scene.nodes()).map(Some).chain(core::iter::once(None));
        links.filter(|&link| carried(scene, link).is_some()).map(Place::Link).collect()
    }

    fn prior_std(&self, _scene: &Scene, _place: Place) -> Vec<f64> {
        vec![0.04; 2]
    }

    /// The turn of what follows is of no joint: without a law, as a free-form error, it may absorb a part of a remainder.
    /// About an axis of the joint before it is that one's zero, which is the simpler word.
    fn log_prior(&self) -> Prior {
        LOG_PRIOR_FREE
    }

    fn columns(&self, scene: &Scene, place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        let next = carried(scene, place.node());
        let about = next.map(|n| [0, 1].map(|k| Column::constant(Atom::Rock(n, k))));
        about.into_iter().flatten().collect()
    }

    fn words(&self) -> &str {
        "the link is twisted: the joint that it carries is turned against the model"
    }

    fn about(&self) -> Option<About> {
        Some(About {
            at: PlaceKind::Link,
            law: "the joint that the link carries is turned by (ω₁, ω₂) about two directions across its axis, before its motion",
            remedy: "write the turned origin (rpy) of the joint that the link carries into the URDF",
            written_to: WrittenTo::Urdf,
            joint_law: &[],
            signature: "a constant turn in the link's frame, that turns with it: the farther out, the more",
            shown_by: "markers near and far beyond the next joint, a large range of its q",
            confused_with: "`axis_tilt` of the next joint over a short range; `joint_offset` of the joint before",
        })
    }
}
