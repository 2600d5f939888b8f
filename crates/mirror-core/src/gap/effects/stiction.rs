//! A servo of finite stiffness stops short of its target, on the side from which it came: `θ = q − d sign(last motion)`.

use super::{Effect, Place, joint_error, joint_of, moving_joints, named};
use crate::gap::atoms::{Atom, Column, Weight};
use crate::gap::scene::Scene;

/// See the module.
pub(crate) struct Stiction;

impl Effect for Stiction {
    fn name(&self) -> &str {
        "stiction"
    }

    fn parameters(&self) -> Vec<String> {
        named(&["deadband_rad"])
    }

    fn places(&self, scene: &Scene) -> Vec<Place> {
        if scene.ordered { moving_joints(scene) } else { Vec::new() }
    }

    fn prior_std(&self, scene: &Scene, place: Place) -> Vec<f64> {
        vec![joint_error(scene, joint_of(place), 0.02)]
    }

    fn columns(&self, scene: &Scene, place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        let n = joint_of(place);
        let weights = (0..scene.frames).map(|f| -scene.direction(f, n)).collect();
        vec![Column { atom: Atom::Joint(n), weight: Weight::Frames(weights) }]
    }

    fn is_positive(&self) -> bool {
        true
    }

    fn words(&self) -> &str {
        "friction stops the joint short of its target, on the side from which it came"
    }
}
