//! Play of width b: the output lies on the side to which its load or, without load, its last motion pushes it.
//!
//! With the friction torque τ_f as the discrete unknown:
//!
//! * `|τ_g| > τ_f`: the load decides, `θ = q + sign(τ_g) b/2`;
//! * otherwise friction holds the output where the motor left it (the play operator): a motor that moves up pushes
//!   the output from below, so that it lags behind, `θ = q − b/2`; moving down, `θ = q + b/2`; within the play it
//!   stays.
//!
//! A joint that came through other postures between the rows has always crossed its play: it lies on the side of its last
//! motion, however small that is. The sign of the discrete unknown tells which: `τ_f` of a joint that comes straight from
//! the row before, `−τ_f` of one that comes from afar.
//!
//! Source: Nordin and Gutman, "Controlling mechanical systems with backlash: a survey" (2002), friction-controlled
//! and inertia-free model; the load's side by statics.

use super::about::{About, PlaceKind, WrittenTo};
use super::{Effect, LawFreedom, Place, joint_error, named};
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::elementary::{Atom, Column, Weight};
use crate::diagnose::model::scene::Scene;
use crate::diagnose::model::solver::NEGLIGIBLE;
use crate::diagnose::principles::Guard;
use crate::robot::JointTerm;

/// Friction torques that are tried, as shares of the joint's largest gravity torque; 0 is pure load, infinity pure motion.
const FRICTION_SHARES: [f64; 12] = [0.0, 0.03, 0.06, 0.1, 0.16, 0.23, 0.31, 0.4, 0.5, 0.62, 0.75, 0.9];
/// The play, or dead band (rad or m), at which the basis of one of no width is taken, and below which a dead band is none.
pub(super) const LEAST_PLAY_RAD: Guard = 1e-4;

/// A width as the law takes it: one of nothing has no side on which the output lies, so that its derivative is that of a small one.
pub(super) fn some_width(width: f64) -> f64 {
    if width > 0.0 { width } else { LEAST_PLAY_RAD }
}

/// Whether a joint was moved to `q`: what is held is written with rounding.
pub(super) fn is_moved(q: f64, last_q: f64) -> bool {
    (q - last_q).abs() > NEGLIGIBLE
}

/// See the module.
pub(crate) struct Backlash;

impl Backlash {
    /// The output's place in its play (rad, from the commanded position) in each frame, and its derivative by b.
    ///
    /// The path between the rows is followed: the load may push the output to the other side on the way, and
    /// friction then keeps it there. Position and torque are taken as linear between rows.
    fn followed(scene: &Scene, n: NodeId, variant: f64, width: f64) -> (Vec<f64>, Vec<f64>) {
        let half = some_width(width) / 2.0;
        if variant < 0.0 {
            return Self::from_afar(scene, n, -variant, half);
        }
        let friction_nm = variant;
        let (mut positions, mut slopes) =
            (Vec::with_capacity(scene.frames), Vec::with_capacity(scene.frames));
        // Before the first row the joint rests at its zero; its place in the play is unknown and taken as the middle.
        let at_rest = scene.body.nodes[n].at_rest();
        let (mut output, mut slope) = (at_rest, 0.0);
        let (mut last_q, mut last_torque) = (at_rest, scene.torque(0, n));
        for f in 0..scene.frames {
            let (q_end, torque_end) = (scene.q(f, n), scene.torque(f, n));
            // The path is split where load and friction exchange the control of the output.
            let change = torque_end - last_torque;
            let mut cuts = [1.0; 3];
            if change.abs() > NEGLIGIBLE {
                for (cut, level) in cuts.iter_mut().zip([friction_nm, -friction_nm]) {
                    let share = (level - last_torque) / change;
                    *cut = if share > 0.0 && share < 1.0 { share } else { 1.0 };
                }
            }
            cuts.sort_by(f64::total_cmp);
            let mut from = 0.0;
            for to in cuts {
                let q = last_q + (q_end - last_q) * to;
                let torque = last_torque + change * (from + to) / 2.0;
                if torque.abs() > friction_nm && torque.abs() > NEGLIGIBLE {
                    output = q + torque.signum() * half;
                    slope = torque.signum() / 2.0;
                } else if output > q + half {
                    output = q + half;
                    slope = 0.5;
                } else if output < q - half {
                    output = q - half;
                    slope = -0.5;
                }
                from = to;
            }
            (last_q, last_torque) = (q_end, torque_end);
            positions.push(output - q_end);
            slopes.push(slope);
        }
        (positions, slopes)
    }

    /// The same of a joint that comes from afar to each row.
    fn from_afar(scene: &Scene, n: NodeId, friction_nm: f64, half: f64) -> (Vec<f64>, Vec<f64>) {
        let (mut side, mut last_q) = (0.0_f64, scene.body.nodes[n].at_rest());
        let sides = (0..scene.frames).map(|f| {
            let (q, torque) = (scene.q(f, n), scene.torque(f, n));
            if torque.abs() > friction_nm && torque.abs() > NEGLIGIBLE {
                side = torque.signum();
            } else if is_moved(q, last_q) {
                side = (last_q - q).signum();
            }
            if is_moved(q, last_q) {
                last_q = q;
            }
            side
        });
        sides.map(|side| (side * half, side / 2.0)).unzip()
    }
}

impl Effect for Backlash {
    fn name(&self) -> &str {
        "backlash"
    }

    fn parameters(&self) -> Vec<String> {
        named(&["width_rad"])
    }

    /// Joints that move in order, or on which gravity pulls to both sides.
    fn places(&self, scene: &Scene) -> Vec<Place> {
        (0..scene.nodes())
            .filter(|&n| {
                scene.is_seen(n) && scene.moves(n) && !self.variants(scene, Place::Joint(n)).is_empty()
            })
            .map(Place::Joint)
            .collect()
    }

    fn prior_std(&self, scene: &Scene, place: Place) -> Vec<f64> {
        place.node().map(|n| joint_error(scene, n, 0.05)).into_iter().collect()
    }

    fn variants(&self, scene: &Scene, place: Place) -> Vec<f64> {
        let Some(n) = place.node() else { return Vec::new() };
        let largest = scene.largest_torque(n);
        let loaded = largest > NEGLIGIBLE;
        match (scene.ordered, loaded) {
            (true, true) => {
                FRICTION_SHARES.iter().map(|s| s * largest).chain(core::iter::once(f64::INFINITY)).collect()
            }
            (true, false) => vec![f64::INFINITY],
            (false, true) => vec![0.0],
            (false, false) => Vec::new(),
        }
    }

    fn variant_beside(&self, scene: &Scene, place: Place, variant: f64, parameters: &[f64]) -> Option<f64> {
        let n = place.node()?;
        let positions = |variant| Self::followed(scene, n, variant, parameters[0]).0;
        let some =
            positions(variant).iter().zip(&positions(-variant)).any(|(a, b)| (a - b).abs() > NEGLIGIBLE);
        some.then_some(-variant)
    }

    fn columns(&self, scene: &Scene, place: Place, variant: f64, parameters: &[f64]) -> Vec<Column> {
        let Some(n) = place.node() else { return Vec::new() };
        let (_, slope) = Self::followed(scene, n, variant, parameters[0]);
        vec![Column { atom: Atom::Joint(n), weight: Weight::Frames(slope) }]
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
        let (position, _) = Self::followed(scene, n, variant, parameters[0]);
        if parameters[0] <= 0.0 {
            return;
        }
        for (f, delta) in position.iter().enumerate() {
            deformation.add_joint_delta(f, n, *delta);
        }
    }

    fn is_positive(&self) -> bool {
        true
    }

    fn depends_on_load(&self) -> bool {
        true
    }

    /// A joint that lies on one side of its play in all postures has another zero.
    fn is_like_a_simpler_one(&self, scene: &Scene, place: Place, variant: f64) -> bool {
        place.node().is_some_and(|n| {
            let (_, slope) = Self::followed(scene, n, variant, LEAST_PLAY_RAD);
            slope.iter().all(|side| *side == slope[0])
        })
    }

    fn law_freedom(&self) -> LawFreedom {
        LawFreedom::LoadAndDirection
    }

    fn words(&self) -> &str {
        "the gear has play: the joint lies on the side to which its load or its last motion pushes it"
    }

    fn about(&self) -> Option<About> {
        Some(About {
            at: PlaceKind::Joint,
            law: "θ = q ± b/2, on the side of the load or of the last motion",
            remedy: "preload or replace the gear, or feed it forward",
            written_to: WrittenTo::Mjcf,
            joint_law: &[JointTerm::Play],
            signature: "two heights: by the sign of the load where it is large, by direction where it is small",
            shown_by: "load that changes its sign; each posture reached from both sides",
            confused_with: "`stiction` where friction decides the side; `joint_offset` where the load never changes sign",
        })
    }
}
