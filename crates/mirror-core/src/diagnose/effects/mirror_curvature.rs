//! The mirror is slightly spherical; positive is concave as the camera sees it.

use super::about::{About, PlaceKind, WrittenTo};
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
        if scene.has_board { vec![Place::Mirror] } else { Vec::new() }
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

    fn about(&self) -> Option<About> {
        Some(About {
            at: PlaceKind::Mirror,
            law: "curvature κ instead of a plane",
            remedy: "use a flatter mirror",
            written_to: WrittenTo::Nothing,
            joint_law: &[],
            signature: "the board's reflection is magnified more than the distance says",
            shown_by: "markers and board on different parts of the mirror",
            confused_with: "`camera_focal`, `board_scale`",
        })
    }
}
