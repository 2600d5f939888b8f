//! The mirror is slightly spherical; positive is concave as the camera sees it.

use super::{Effect, Place, named};
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::scene::Scene;

/// See the module.
pub(crate) struct MirrorCurvature;

impl Effect for MirrorCurvature {
    fn name(&self) -> &str {
        "mirror_curvature"
    }

    fn parameters(&self) -> Vec<String> {
        named(&["curvature_per_m"])
    }

    fn places(&self, scene: &Scene) -> Vec<Place> {
        if scene.has_mirror { vec![Place::Mirror] } else { Vec::new() }
    }

    fn prior_std(&self, _scene: &Scene, _place: Place) -> Vec<f64> {
        vec![0.08]
    }

    fn columns(&self, _scene: &Scene, _place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        vec![Column::constant(Atom::Curvature)]
    }

    fn words(&self) -> &str {
        "the mirror is slightly curved"
    }
}
