//! A displaced origin of the next link in the chain, in the link's frame.

use super::about::{About, PlaceKind, WrittenTo};
use super::{Effect, Place, named, place_error_m};
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::scene::Scene;

/// See the module.
pub(crate) struct LinkLength;

impl Effect for LinkLength {
    fn name(&self) -> &str {
        "link_length"
    }

    fn parameters(&self) -> Vec<String> {
        named(&["dx_m", "dy_m", "dz_m"])
    }

    /// Links that carry a relevant joint; what the last link of a chain carries is a marker, and its place is `marker_mount`.
    fn places(&self, scene: &Scene) -> Vec<Place> {
        let nodes = scene.nodes();
        (0..nodes)
            .map(Some)
            .chain(core::iter::once(None))
            .filter(|&parent| (0..nodes).any(|k| scene.relevant[k] && scene.body.nodes[k].parent == parent))
            .map(Place::Link)
            .collect()
    }

    fn prior_std(&self, scene: &Scene, _place: Place) -> Vec<f64> {
        vec![place_error_m(scene); 3]
    }

    fn columns(&self, _scene: &Scene, place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        (0..3).map(|k| Column::constant(Atom::LinkShift(place.node(), k))).collect()
    }

    fn may_be_of_another_part(&self) -> bool {
        true
    }

    fn words(&self) -> &str {
        "the link's length or shape differs from the model's: everything that it carries is displaced"
    }

    fn about(&self) -> Option<About> {
        Some(About {
            at: PlaceKind::Link,
            law: "what the link carries is shifted by (dx, dy, dz) in its frame",
            remedy: "write the link's length into the URDF",
            written_to: WrittenTo::Urdf,
            joint_law: &[],
            signature: "a constant shift in the link's frame, that turns with it",
            shown_by: "the link in several orientations",
            confused_with: "`marker_mount` of all markers beyond; `joint_offset` far out",
        })
    }
}
