//! Friction in every joint, the neighbour of a log that is late.
//!
//! Both leave a joint short of where it was sent, behind its last motion. A delay is short by a share of the way, one share for all
//! joints; friction by a width of the joint's own, however far it came. So a delay is named only where it is more probable than
//! friction: `δ_j = −w_j sign(q_j − q_j before)`, each width with its usual prior.

use super::variant::{Variant, seen_joints};
use crate::diagnose::effects::joint_error;
use crate::diagnose::model::elementary::{Atom, Column, Weight};
use crate::diagnose::model::problem::Problem;
use crate::diagnose::principles::Prior;

/// Usual width of the friction or play of a joint, rad, as that of the effects.
pub(super) const USUAL_WIDTH: Prior = 0.02;

/// A column for the friction of each joint that moves: the sign of its last motion, times the reach where it slides.
pub(super) fn friction_columns(problem: &Problem, log: &Variant) -> Vec<Column> {
    let body = &problem.scene.body;
    let joints = seen_joints(body, &problem.scene.relevant).into_iter();
    let column = |(joint, node): (usize, usize)| {
        let multiplier = body.nodes[node].command.1;
        let size = joint_error(&problem.scene, node, 1.0);
        let (mut before, mut last) = (None, 0.0_f64);
        let signs = log.column(joint).into_iter().map(|q| {
            let moved = before.replace(q).map_or(0.0, |before| multiplier * (q - before));
            if moved != 0.0 {
                last = size.copysign(moved);
            }
            last
        });
        let signs: Vec<f64> = signs.collect();
        signs
            .iter()
            .any(|s| *s != 0.0)
            .then_some(Column { atom: Atom::Joint(node), weight: Weight::Frames(signs) })
    };
    joints.filter_map(column).collect()
}
