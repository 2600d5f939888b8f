//! The reflecting coat lies behind a pane of glass, which refracts. The parameter is how much thicker the pane is
//! than the session states.

use super::about::{About, PlaceKind, WrittenTo};
use super::{Effect, Place, named};
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::scene::Scene;

/// See the module.
pub(crate) struct MirrorGlass;

impl Effect for MirrorGlass {
    fn name(&self) -> &str {
        "mirror_glass"
    }

    fn parameters(&self) -> Vec<String> {
        named(&["thickness_m"])
    }

    fn places(&self, scene: &Scene) -> Vec<Place> {
        if scene.has_board { vec![Place::Mirror] } else { Vec::new() }
    }

    fn prior_std(&self, _scene: &Scene, _place: Place) -> Vec<f64> {
        vec![0.005]
    }

    fn columns(&self, _scene: &Scene, _place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        vec![Column::constant(Atom::Glass)]
    }

    fn words(&self) -> &str {
        "the silver is behind a pane of refracting glass"
    }

    fn about(&self) -> Option<About> {
        Some(About {
            at: PlaceKind::Mirror,
            law: "the glass is thicker by t",
            remedy: "measure the thickness of the glass",
            written_to: WrittenTo::Session,
            joint_law: &[],
            signature: "grows with the obliqueness of the rays",
            shown_by: "mirrors at 15° and more beside straight ones",
            confused_with: "`board_scale`, at one angle",
        })
    }
}
