//! A displaced marker on its link.

use super::about::{About, PlaceKind, WrittenTo};
use super::{Effect, Place, named, place_error_m};
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::scene::Scene;

/// See the module.
pub(crate) struct MarkerMount;

impl Effect for MarkerMount {
    fn name(&self) -> &str {
        "marker_mount"
    }

    fn parameters(&self) -> Vec<String> {
        named(&["dx_m", "dy_m", "dz_m"])
    }

    /// Markers whose mount the session knows; an unknown mount is a nuisance, not a cause.
    fn places(&self, scene: &Scene) -> Vec<Place> {
        (0..scene.marker_names.len()).filter(|&m| scene.mount_known[m]).map(Place::Marker).collect()
    }

    fn prior_std(&self, scene: &Scene, _place: Place) -> Vec<f64> {
        vec![place_error_m(scene); 3]
    }

    fn columns(&self, _scene: &Scene, place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        match place {
            Place::Marker(m) => (0..3).map(|k| Column::constant(Atom::MarkerShift(m, k))).collect(),
            _ => Vec::new(),
        }
    }

    fn words(&self) -> &str {
        "the marker is displaced on its link"
    }

    fn about(&self) -> Option<About> {
        Some(About {
            at: PlaceKind::Marker,
            law: "the marker is shifted by (dx, dy, dz) in its link's frame",
            remedy: "write the marker's place into the URDF",
            written_to: WrittenTo::Urdf,
            joint_law: &[],
            signature: "one marker alone is off, by one vector in its link's frame",
            shown_by: "the link in several orientations",
            confused_with: "of the last link: that joint's `joint_offset`",
        })
    }
}
