//! A tilted axis of rotation: the real axis is `unit(a + tan(tilt_1) u + tan(tilt_2) v)`.

use super::about::{About, PlaceKind, WrittenTo};
use super::{Effect, Place, named};
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::scene::Scene;

/// See the module.
pub(crate) struct AxisTilt;

impl Effect for AxisTilt {
    fn name(&self) -> &str {
        "axis_tilt"
    }

    fn parameters(&self) -> Vec<String> {
        named(&["tilt_1_rad", "tilt_2_rad"])
    }

    /// A joint that stands turned shows its tilt too, as a constant turn of what follows.
    fn places(&self, scene: &Scene) -> Vec<Place> {
        let turned = (0..scene.nodes()).filter(|&n| scene.relevant[n] && scene.leaves_zero(n));
        turned.map(Place::Joint).collect()
    }

    fn prior_std(&self, _scene: &Scene, _place: Place) -> Vec<f64> {
        vec![0.04; 2]
    }

    fn columns(&self, _scene: &Scene, place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        let axes = place.node().map(|n| [0, 1].map(|k| Column::constant(Atom::Tilt(n, k))));
        axes.into_iter().flatten().collect()
    }

    fn words(&self) -> &str {
        "the joint's axis is tilted"
    }

    fn about(&self) -> Option<About> {
        Some(About {
            at: PlaceKind::Joint,
            law: "the axis turned by (α₁, α₂) about two directions across it",
            remedy: "write the axis into the URDF",
            written_to: WrittenTo::Urdf,
            joint_law: &[],
            signature: "looks like an error of the neighbours that turns with q",
            shown_by: "a large range of q, markers far from the axis",
            confused_with: "`joint_offset` of a neighbour over a short range",
        })
    }
}
