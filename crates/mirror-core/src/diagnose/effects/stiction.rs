//! A servo of finite stiffness stops short of its target, on the side from which it came: `θ = q − d sign(last
//! motion) + c τ_g`.
//!
//! The same finite stiffness makes it droop under its load: c is the servo's droop, a parameter of the effect. Whether
//! each row's motion began far enough away to overcome friction is the discrete unknown:
//!
//! * [`DIRECTLY`]: the joint comes straight from the row before; a motion too small to overcome friction leaves it where it was;
//! * [`FROM_AFAR`]: it came through other postures between the rows, and always stops short by the whole dead band.

use super::about::{About, PlaceKind, WrittenTo};
use super::backlash::{LEAST_PLAY_RAD, is_moved, some_width};
use super::{Effect, LawFreedom, Place, joint_error, moving_joints, named};
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::elementary::{Atom, Column, Weight};
use crate::diagnose::model::scene::Scene;
use crate::diagnose::model::solver::NEGLIGIBLE;
use crate::diagnose::principles::Grid;
use crate::robot::JointTerm;

/// Values of the discrete unknown: how a joint comes from one row's posture to the next.
const DIRECTLY: Grid = 0.0;
const FROM_AFAR: Grid = 1.0;

/// See the module.
pub(crate) struct Stiction {
    /// Whether it droops under its load. Not if compliance is left out of the vocabulary: droop is the same at a
    /// servo.
    pub droops: bool,
}

/// The joint's rest position in a frame, and its derivatives by dead band and droop.
struct Rest {
    error: f64,
    by_band: f64,
    by_droop: f64,
}

impl Stiction {
    /// Follows the joint from row to row: it moves only as far as the servo's torque exceeds friction. So it stops
    /// within `± d` of where the drooping servo would hold it without friction, and stays there while it can.
    fn followed(scene: &Scene, n: NodeId, variant: f64, band: f64, droop: f64) -> Vec<Rest> {
        // Before the first row the joint rests at its zero.
        let at_rest = scene.body.nodes[n].at_rest();
        let (mut theta, mut by_band, mut by_droop, mut last_q) = (at_rest, 0.0, 0.0, at_rest);
        (0..scene.frames)
            .map(|f| {
                let (q, torque) = (scene.q(f, n), scene.torque(f, n));
                let hold = q + droop * torque;
                // The side from which it comes; of a joint that did not move the one on which it rests.
                let mut side = by_band;
                if is_moved(q, last_q) {
                    side = (last_q - q).signum();
                    last_q = q;
                }
                if variant == FROM_AFAR && side != 0.0 {
                    (theta, by_band, by_droop) = (hold + side * band, side, torque);
                } else if theta > hold + band {
                    (theta, by_band, by_droop) = (hold + band, 1.0, torque);
                } else if theta < hold - band {
                    (theta, by_band, by_droop) = (hold - band, -1.0, torque);
                }
                Rest { error: theta - q, by_band, by_droop }
            })
            .collect()
    }
}

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

    /// The other, unless all motions are large.
    fn variant_beside(&self, scene: &Scene, place: Place, variant: f64, parameters: &[f64]) -> Option<f64> {
        let n = place.node()?;
        let band = some_width(parameters[0]);
        let rests = |variant| Self::followed(scene, n, variant, band, parameters[1]);
        let other = if variant == FROM_AFAR { DIRECTLY } else { FROM_AFAR };
        let differs = |(a, b): (&Rest, &Rest)| (a.error - b.error).abs() > NEGLIGIBLE;
        let some = rests(variant).iter().zip(&rests(other)).any(differs);
        some.then_some(other)
    }

    fn prior_std(&self, scene: &Scene, place: Place) -> Vec<f64> {
        let Some(n) = place.node() else { return Vec::new() };
        let load = scene.largest_torque(n);
        let droop =
            if self.droops && load > NEGLIGIBLE { joint_error(scene, n, 0.006) / load } else { NEGLIGIBLE };
        vec![joint_error(scene, n, 0.02), droop]
    }

    fn columns(&self, scene: &Scene, place: Place, variant: f64, parameters: &[f64]) -> Vec<Column> {
        let Some(n) = place.node() else { return Vec::new() };
        let rests = Self::followed(scene, n, variant, some_width(parameters[0]), parameters[1]);
        let (mut by_band, mut by_droop) = (Vec::new(), Vec::new());
        for rest in rests {
            by_band.push(rest.by_band);
            by_droop.push(rest.by_droop);
        }
        vec![
            Column { atom: Atom::Joint(n), weight: Weight::Frames(by_band) },
            Column { atom: Atom::Joint(n), weight: Weight::Frames(by_droop) },
        ]
    }

    fn deform(
        &self,
        scene: &Scene,
        place: Place,
        variant: f64,
        parameters: &[f64],
        deformation: &mut Deformation,
    ) {
        let Some(n) = place.node() else { return };
        if parameters[0] <= 0.0 && parameters[1] == 0.0 {
            return;
        }
        let band = parameters[0].max(0.0);
        for (f, rest) in Self::followed(scene, n, variant, band, parameters[1]).iter().enumerate() {
            deformation.add_joint_delta(f, n, rest.error);
        }
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

    fn comes_down_to(&self, parameters: &[f64]) -> Option<(&'static str, Vec<f64>)> {
        let droop = parameters.get(1).copied().filter(|droop| *droop > NEGLIGIBLE)?;
        (parameters[0] <= LEAST_PLAY_RAD).then(|| ("joint_compliance", vec![droop]))
    }

    fn law_freedom(&self) -> LawFreedom {
        LawFreedom::LoadAndDirection
    }

    fn words(&self) -> &str {
        "friction stops the joint short of its target, on the side from which it came"
    }

    fn about(&self) -> Option<About> {
        Some(About {
            at: PlaceKind::Joint,
            law: "θ = q − d sign(last motion) + c τ",
            remedy: "raise the servo's stiffness, or feed it forward",
            written_to: WrittenTo::Mjcf,
            joint_law: &[JointTerm::DeadBand, JointTerm::Compliance],
            signature: "two heights by direction alone, short of the target: low after moving up",
            shown_by: "each posture reached from both sides; rows in the order of execution",
            confused_with: "`backlash`; nothing to see where `ordered = false`",
        })
    }
}
