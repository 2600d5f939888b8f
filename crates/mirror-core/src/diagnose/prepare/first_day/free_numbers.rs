//! The numbers of a mistake that are found beside the causes once more: a zero, a ratio, a delay.

use super::alternatives::UNITS;
use super::mistake::{Mistake, in_time};
use super::told::row_step_s;
use super::variant::{Variant, seen_joints};
use crate::diagnose::data::recording::Recording;
use crate::diagnose::model::elementary::{Atom, Column, Weight};
use crate::diagnose::model::loose::Loose;
use crate::diagnose::model::problem::Problem;

/// What the first estimate, made before any cause was known, is off by: a zero (rad), a ratio (relative), a delay (rows).
const ZERO_STD: f64 = 0.03;
const RATIO_STD: f64 = 0.03;
const ROWS_STD: f64 = 0.03;
/// Rows over which the speed of a column is told.
const STEP_ROWS: f64 = 1e-3;

impl Mistake {
    /// Its numbers as further parameters of every model; the recording is that before it is undone.
    pub(super) fn loose(&self, recording: &Recording, problem: &Problem, names: &[String]) -> Vec<Loose> {
        let body = &problem.scene.body;
        let joints = seen_joints(body, &problem.scene.relevant);
        let node_of = |joint: usize| joints.iter().find(|(j, _)| *j == joint).map(|(_, node)| *node);
        let of = |joint: usize, weight: Weight, std: f64, effect: &str, parameter: &str, unit: f64| {
            node_of(joint).map(|node| Loose {
                column: Column { atom: Atom::Joint(node), weight },
                std,
                effect: effect.into(),
                at: format!("joint:{}", names[joint]),
                parameter: parameter.into(),
                unit,
            })
        };
        match *self {
            Self::Zero { joint, .. } => {
                of(joint, Weight::One, ZERO_STD, "joint_offset", "offset_rad", 1.0).into_iter().collect()
            }
            Self::JointUnit { joint, factor } if !UNITS.contains(&factor) => node_of(joint)
                .and_then(|node| {
                    of(joint, Weight::Position(node), RATIO_STD, "gear_ratio", "scale_error", factor)
                })
                .into_iter()
                .collect(),
            Self::Late { joint, rows, kind } if rows.fract() != 0.0 => {
                let before = Variant::of(recording, problem);
                let (unit, parameter) = match row_step_s(recording) {
                    Some(step_s) => (step_s, "delay_s"),
                    None => (1.0, "delay_rows"),
                };
                let late = joints.iter().filter(|(j, _)| joint.is_none_or(|one| one == *j));
                late.filter_map(|&(j, node)| {
                    let column = before.column(j);
                    let ends = [rows - STEP_ROWS, rows + STEP_ROWS].map(|r| in_time(&column, r, kind));
                    let multiplier = body.nodes[node].command.1;
                    let speed =
                        ends[0].iter().zip(&ends[1]).map(|(a, b)| multiplier * (b - a) / (2.0 * STEP_ROWS));
                    let mut loose =
                        of(j, Weight::Frames(speed.collect()), ROWS_STD, "joint_late", parameter, unit)?;
                    if joint.is_none() {
                        loose.at = "robot".into();
                    }
                    Some(loose)
                })
                .collect()
            }
            _ => Vec::new(),
        }
    }
}
