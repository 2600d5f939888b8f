//! The axis of rotation is tilted: the real axis is `unit(a + tan(tilt_1) u + tan(tilt_2) v)`.

use super::{Effect, Place, joint_of, moving_joints, named};
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

    fn places(&self, scene: &Scene) -> Vec<Place> {
        moving_joints(scene)
    }

    fn prior_std(&self, _scene: &Scene, _place: Place) -> Vec<f64> {
        vec![0.04; 2]
    }

    fn columns(&self, _scene: &Scene, place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        (0..2).map(|k| Column::constant(Atom::Tilt(joint_of(place), k))).collect()
    }

    fn words(&self) -> &str {
        "the joint's axis is tilted"
    }
}
