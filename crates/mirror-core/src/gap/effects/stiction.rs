//! A servo of finite stiffness stops short of its target, on the side from which it came:
//! `θ = q − d sign(last motion) + c τ_g`.
//!
//! The same finite stiffness makes it droop under its load: c is the servo's own droop, a part of the effect.

use super::{Effect, LEAST_TORQUE_NM, Place, joint_error, joint_of, moving_joints, named};
use crate::gap::atoms::{Atom, Column, Weight};
use crate::gap::scene::Scene;

/// See the module.
pub(crate) struct Stiction;

impl Effect for Stiction {
    fn name(&self) -> &str {
        "stiction"
    }

    fn parameters(&self) -> Vec<String> {
        named(&["deadband_rad", "droop_rad_per_nm"])
    }

    fn places(&self, scene: &Scene) -> Vec<Place> {
        if scene.ordered { moving_joints(scene) } else { Vec::new() }
    }

    fn prior_std(&self, scene: &Scene, place: Place) -> Vec<f64> {
        let n = joint_of(place);
        let droop = joint_error(scene, n, 0.006) / scene.largest_torque(n).max(LEAST_TORQUE_NM);
        vec![joint_error(scene, n, 0.02), droop]
    }

    fn columns(&self, scene: &Scene, place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        let n = joint_of(place);
        let weights = (0..scene.frames).map(|f| -scene.direction(f, n)).collect();
        vec![
            Column { atom: Atom::Joint(n), weight: Weight::Frames(weights) },
            Column { atom: Atom::Joint(n), weight: Weight::Torque(n) },
        ]
    }

    fn depends_on_load(&self) -> bool {
        true
    }

    /// Friction scatters: where a servo stops within its dead band differs from motion to motion.
    fn law_uncertainty(&self) -> f64 {
        0.05
    }

    fn is_positive(&self) -> bool {
        true
    }

    fn words(&self) -> &str {
        "friction stops the joint short of its target, on the side from which it came"
    }
}
