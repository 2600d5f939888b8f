//! The printed squares are larger by a factor 1 + e.

use super::about::{About, PlaceKind, WrittenTo};
use super::{Effect, Place, named};
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::scene::Scene;

/// See the module.
pub(crate) struct BoardScale;

impl Effect for BoardScale {
    fn name(&self) -> &str {
        "board_scale"
    }

    fn parameters(&self) -> Vec<String> {
        named(&["scale_error"])
    }

    fn places(&self, scene: &Scene) -> Vec<Place> {
        if scene.has_board { vec![Place::Board] } else { Vec::new() }
    }

    fn prior_std(&self, _scene: &Scene, _place: Place) -> Vec<f64> {
        vec![0.03]
    }

    fn columns(&self, _scene: &Scene, _place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        vec![Column::constant(Atom::BoardScale)]
    }

    fn words(&self) -> &str {
        "the printed squares are larger or smaller than the model says"
    }

    fn about(&self) -> Option<About> {
        Some(About {
            at: PlaceKind::Board,
            law: "squares (1 + e) times as large",
            remedy: "measure the board's squares again; if they are right, multiply all lengths of the robot's model by 1/(1 + e): it may be the file of another size",
            written_to: WrittenTo::Session,
            joint_law: &[],
            signature: "the mirror seems too near or too far; markers grow or shrink with it",
            shown_by: "several distances",
            confused_with: "`camera_focal`; a model all of whose lengths are off by one factor",
        })
    }
}
