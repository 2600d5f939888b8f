//! The parameters of a mistake that are estimated again together with the causes: a zero, a ratio, a delay, a crop, a
//! slip's motion.

use super::mistake::{Mistake, in_time, is_unit};
use super::reported::{MOTION, row_step_s, what_slipped};
use super::variant::{Variant, seen_joints};
use crate::diagnose::data::recording::Recording;
use crate::diagnose::effects::camera_center::CameraCenter;
use crate::diagnose::effects::{Effect, Place};
use crate::diagnose::likelihood::saturated::FREE_STD;
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::elementary::{Atom, Column, Weight};
use crate::diagnose::model::mistake_parameters::MistakeParameter;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::model::slips::Slipped;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::Prior;

/// Error of the first estimate, made before any cause was known: of a zero (rad), a ratio (relative), a delay
/// (rows).
const FIRST_ESTIMATE_STD: Prior = 0.03;

impl Mistake {
    /// Its numbers as further parameters of every model; the recording is that before it is undone.
    pub(super) fn free_parameters(
        &self,
        recording: &Recording,
        problem: &Problem,
        names: &[String],
    ) -> Vec<MistakeParameter> {
        let body = &problem.scene.body;
        let joints = seen_joints(body, &problem.scene.relevant);
        let of_joints = |joint: Option<usize>| {
            joints.iter().copied().filter(move |(j, _)| joint.is_none_or(|one| one == *j))
        };
        let of =
            |(joint, node): (usize, NodeId), weight: Weight, std, effect: &str, parameter: &str, unit| {
                MistakeParameter {
                    column: Column { atom: Atom::Joint(node), weight },
                    std,
                    effect: effect.into(),
                    at: format!("joint:{}", names[joint]),
                    parameter: parameter.into(),
                    unit,
                }
            };
        match *self {
            Self::Zero { joint, .. } => of_joints(Some(joint))
                .map(|one| of(one, Weight::One, FIRST_ESTIMATE_STD, "joint_offset", "offset_rad", 1.0))
                .collect(),
            // Estimated before any cause was known: what it is off by would look like a drift of the same joint.
            Self::ZeroLost { joint, first, .. } => {
                let since = (0..problem.frames.len()).map(|f| f64::from(u8::from(f >= first)));
                let weight = Weight::Frames(since.collect());
                of_joints(Some(joint))
                    .map(|one| of(one, weight.clone(), FIRST_ESTIMATE_STD, self.effect(), "offset_rad", 1.0))
                    .collect()
            }
            Self::JointUnit { joint, factor } if !is_unit(factor) => of_joints(Some(joint))
                .map(|one| {
                    of(one, Weight::Position(one.1), FIRST_ESTIMATE_STD, "gear_ratio", "scale_error", factor)
                })
                .collect(),
            Self::Resolution { factor: 1.0, .. } => {
                let part = |(k, parameter): (usize, &str)| MistakeParameter {
                    column: Column::constant(Atom::Center(k)),
                    std: CameraCenter.prior_std(&problem.scene, Place::Camera)[k],
                    effect: self.effect().into(),
                    at: "camera".into(),
                    parameter: parameter.into(),
                    unit: 1.0,
                };
                ["du_px", "dv_px"].into_iter().enumerate().map(part).collect()
            }
            Self::Late { joint, rows, kind } if rows.fract() != 0.0 => {
                let before = Variant::of(recording, problem);
                let (unit, parameter) = match row_step_s(recording) {
                    Some(step_s) => (step_s, "delay_s"),
                    None => (1.0, "delay_rows"),
                };
                let [less, more] = on_one_side(rows, SOLVER.difference);
                let loose = |one: (usize, NodeId)| {
                    let column = before.column(one.0);
                    let [early, late] = [less, more].map(|r| in_time(&column, r, kind));
                    let per_row = body.nodes[one.1].command.1 / (more - less);
                    let speed = early.iter().zip(&late).map(|(a, b)| per_row * (b - a)).collect();
                    of(one, Weight::Frames(speed), FIRST_ESTIMATE_STD, "joint_late", parameter, unit)
                };
                let all = of_joints(joint).map(loose);
                if joint.is_some() {
                    return all.collect();
                }
                all.map(|one| MistakeParameter { at: "robot".into(), ..one }).collect()
            }
            // To first order: what is added here turns and shifts the part where it slipped to.
            Self::Slip { slip, .. } => {
                let after = (0..problem.frames.len()).map(|f| f64::from(u8::from(f >= slip.first)));
                let weight = Weight::Frames(after.collect());
                let part = |k: usize| MistakeParameter {
                    column: Column {
                        atom: match slip.what {
                            Slipped::Marker(m) => Atom::MarkerShift(m, k - 3),
                            Slipped::Board => Atom::BoardSlip(k),
                            Slipped::Camera => Atom::CameraMount(k),
                        },
                        weight: weight.clone(),
                    },
                    std: FREE_STD,
                    effect: self.effect().into(),
                    at: what_slipped(slip.what, problem),
                    parameter: MOTION[k].into(),
                    unit: 1.0,
                };
                (slip.what.first_number()..6).map(part).collect()
            }
            _ => Vec::new(),
        }
    }
}

/// Delays on both sides of one, between which the log's positions change steadily: from half a row on they are found from
/// the other end of the log.
fn on_one_side(rows: f64, step: f64) -> [f64; 2] {
    let half = rows.floor() + 0.5;
    match rows - half {
        past if past.abs() > step => [rows - step, rows + step],
        past if past > 0.0 => [rows, rows + step],
        _ => [rows - step, rows],
    }
}

#[cfg(test)]
mod tests {
    use crate::diagnose::prepare::first_day::free_numbers::on_one_side;
    use crate::diagnose::prepare::first_day::mistake::{LateKind, in_time};

    #[test]
    fn the_speed_of_a_delay_of_half_a_row_is_that_of_its_own_side() {
        let column: Vec<f64> = (0..40).map(|row| f64::from(row * row % 17)).collect();
        for rows in [0.2, 0.499_95, 0.5, 0.500_05, 0.8, 2.5] {
            let [less, more] = on_one_side(rows, 1e-4);
            let [early, late] = [less, more].map(|rows| in_time(&column, rows, LateKind::Blend));
            let largest = early.iter().zip(&late).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
            assert!(largest < 0.5, "{rows}: {largest}");
        }
    }
}
