//! A mistake in the public vocabulary: effect, place, parameters, and a sentence for the reader.

use super::alternatives::seen_in;
use super::mistake::{Mistake, is_unit};
use crate::diagnose::data::diagnosis::{Cause, Estimate};
use crate::diagnose::data::recording::Recording;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::model::slips::Slipped;
use crate::diagnose::prepare::row_slip::WHOLE_STD;
use crate::diagnose::principles::Prior;
use crate::robot::Robot;
use crate::statistics::median;
use core::f64::consts::FRAC_PI_2;
use std::collections::BTreeMap;

/// A motion's parameters.
pub(super) const MOTION: [&str; 6] = ["rx_rad", "ry_rad", "rz_rad", "dx_m", "dy_m", "dz_m"];
/// Numbers found by golden sections on a loss of many observations, relative.
const REFINED_STD: Prior = 0.01;

/// Name and words of a joint's wrong sign.
pub(crate) const REVERSED: (&str, &str) = ("axis_sign", "the joint turns the other way");

/// Causes of a mistake: one, or one for each pair of exchanged joints.
pub(super) fn reported(
    mistake: &Mistake,
    robot: &Robot,
    recording: &Recording,
    problem: &Problem,
    probability: f64,
) -> Vec<Cause> {
    let names: Vec<&str> = robot.position_names().collect();
    let joint = |j: usize| format!("joint:{}", names[j]);
    let marker = |m: usize| format!("marker:{}", problem.scene.marker_names[m]);
    let number = |f: usize| problem.frame_numbers[f];
    let cause = |effect: &str, at: String, parameters: &[(&str, f64, f64)], words: &str| Cause {
        effect: effect.to_owned(),
        at,
        kind: kind(effect).to_owned(),
        probability,
        parameters: parameters
            .iter()
            .map(|(name, value, std)| ((*name).to_owned(), Estimate { value: *value, std: *std }))
            .collect::<BTreeMap<_, _>>(),
        stability: None,
        alternatives: Vec::new(),
        words: words.to_owned(),
        rms_shift: 0.0,
        members: Vec::new(),
        frames: Vec::new(),
    };
    let whole_run = |effect: &str, j: usize, (first, std): (usize, f64), last: usize, words: &str| {
        let run =
            [("first_frame", number(first) as f64, std), ("last_frame", number(last) as f64, WHOLE_STD)];
        cause(effect, joint(j), &run, words)
    };
    let swapped = |(a, b): (usize, usize), words: &str| {
        cause("joints_swapped", format!("{}<->{}", joint(a), joint(b)), &[], words)
    };
    match mistake {
        Mistake::AxisSign { node } => vec![cause(
            REVERSED.0,
            format!("joint:{}", problem.scene.body.nodes[*node].joint),
            &[],
            REVERSED.1,
        )],
        Mistake::JointsSwapped { joints } => {
            vec![swapped(*joints, "two columns, or two servos' cables, changed places")]
        }
        // Of pairs that share a column the order counts: causes that move alike keep it.
        Mistake::ColumnsSwapped { pairs } => {
            let words = "several columns, or servos' cables, changed places: exchange them one after the other, as they are listed";
            pairs.iter().map(|pair| swapped(*pair, words)).collect()
        }
        Mistake::JointUnit { joint: j, factor } if is_unit(*factor) => {
            vec![cause("joint_unit", joint(*j), &[("factor", *factor, 0.0)], "the column is in another unit")]
        }
        Mistake::JointUnit { joint: j, factor } => vec![cause(
            "gear_ratio",
            joint(*j),
            &[("scale_error", factor - 1.0, REFINED_STD * factor)],
            "the joint turns by another ratio than the model has",
        )],
        Mistake::AllUnits { factor, .. } => vec![cause(
            "joint_unit",
            "robot".into(),
            &[("factor", *factor, 0.0)],
            "the columns of all joints that turn are in another unit",
        )],
        Mistake::Zero { joint: j, offset } => vec![cause(
            "joint_offset",
            joint(*j),
            &[("offset_rad", *offset, REFINED_STD)],
            "the joint's zero lies far from the model's",
        )],
        Mistake::Late { joint: j, rows, .. } => {
            let at = j.map_or_else(|| "robot".to_owned(), joint);
            let step = row_step_s(recording);
            let std = if rows.fract() == 0.0 { 0.1 } else { 2.0 * REFINED_STD };
            let parameter = match step {
                Some(step) => ("delay_s", rows * step, std * step),
                None => ("delay_rows", *rows, std),
            };
            let words = match j {
                Some(_) => "the column holds an earlier moment's position",
                None if *rows < 0.0 => {
                    "the joints' log holds a later moment's positions: pictures or measured points are late, or were taken before the joints had come to rest"
                }
                None => "the joints' log holds an earlier moment's positions",
            };
            vec![cause("joint_late", at, &[parameter], words)]
        }
        // The log's constant value is true of one posture: no row of that posture says whether the log stood
        // already.
        Mistake::LogFrozen { joint: j, first, last } => vec![whole_run(
            "joint_frozen",
            *j,
            (*first, WHOLE_STD.hypot(rows_of_posture(problem, *first) as f64 / 3f64.sqrt())),
            *last,
            "the log stands still over a run of rows while the joint moves; observations of what the joint carries were left out there",
        )],
        Mistake::JointFrozen { joint: j, first, last, .. } => {
            let first = (*first, WHOLE_STD);
            vec![whole_run("joint_frozen", *j, first, *last, "the joint does not move over a run of rows")]
        }
        // It is told where what is left is: there is no word for it.
        Mistake::ColumnLost { .. } | Mistake::ZeroLost { .. } => Vec::new(),
        Mistake::MarkersSwapped { markers: (a, b), frames, .. } => {
            let seen = seen_in(problem, *a, *b).max(1) as f64;
            let share = (frames.len() as f64 / seen).min(1.0);
            let std = (share * (1.0 - share) / seen).sqrt();
            let mut told = cause(
                "markers_swapped",
                format!("{}<->{}", marker(*a), marker(*b)),
                &[("share", share, std)],
                "two markers' names are exchanged",
            );
            if share < 1.0 {
                told.frames = frames.iter().map(|&f| number(f)).collect();
            }
            vec![told]
        }
        Mistake::Resolution { factor, offset_px } => vec![cause(
            "camera_resolution",
            "camera".into(),
            &[("factor", *factor, 0.0), ("du_px", offset_px.x, WHOLE_STD), ("dv_px", offset_px.y, WHOLE_STD)],
            if *factor == 1.0 {
                "the camera's parameters are of another crop of the picture"
            } else {
                "the camera's parameters are of another resolution"
            },
        )],
        Mistake::Flipped { flip } => vec![cause(
            "picture_flipped",
            "camera".into(),
            &[("flip", f64::from(*flip), 0.0)],
            "the pictures are mirrored or turned",
        )],
        // In an unknown frame no coordinate is wrong by itself.
        Mistake::PointsMirrored { axis } => {
            let which: &[_] =
                if problem.unknown_frame.is_some() { &[] } else { &[("axis", (axis + 1) as f64, 0.0)] };
            let words = "the measured points are in a left-handed frame: a coordinate has the wrong sign, or two are exchanged";
            vec![cause("points_mirrored", "data".into(), which, words)]
        }
        Mistake::BoardTurned { quarters } => vec![cause(
            "board_turned",
            "board".into(),
            &[("turn_rad", f64::from(*quarters) * FRAC_PI_2, 0.0)],
            "the board is mounted, or its corners are counted, turned in its plane",
        )],
        Mistake::MarkerParent { marker: m, node, place } => {
            let std = 0.001;
            vec![cause(
                "marker_parent",
                format!("{}<-link:{}", marker(*m), problem.scene.body.node_link_name(*node)),
                &[("dx_m", place.x, std), ("dy_m", place.y, std), ("dz_m", place.z, std)],
                "the marker is fixed to another link than the model says",
            )]
        }
        Mistake::Gravity { turn } => vec![cause(
            "gravity_direction",
            "robot".into(),
            &[("rx_rad", turn.x, 0.1), ("ry_rad", turn.y, 0.1), ("rz_rad", turn.z, 0.1)],
            "gravity has another direction than the session states",
        )],
        Mistake::Slip { slip, std } => {
            let first = number(slip.first) as f64;
            let mut parameters = vec![("first_frame", first, WHOLE_STD)];
            for k in slip.what.first_number()..6 {
                parameters.push((MOTION[k], slip.motion[k], std[k]));
            }
            let at = what_slipped(slip.what, problem);
            vec![cause("slip", at, &parameters, "from a row on it has another place")]
        }
        Mistake::Hung { first, last } => {
            let rows = (last + 1 - first) as f64;
            // Row i holds the measurement of the row before the first: the mean of the shifts, and their spread.
            let shift = ("shift_rows", -0.5 * (rows + 1.0), rows / 12f64.sqrt());
            let run = [
                ("first_frame", number(*first) as f64, 0.0),
                ("last_frame", number(*last) as f64, 0.0),
                shift,
            ];
            let words = "over these rows one measurement is repeated while the joints move: the camera or the tracker hung; the rows were left out";
            vec![cause("pairing", "data".into(), &run, words)]
        }
        // Found, and reported, by later stages.
        Mistake::Rows { .. } | Mistake::Squares { .. } => Vec::new(),
    }
}

/// The public name of what slipped.
pub(super) fn what_slipped(what: Slipped, problem: &Problem) -> String {
    match what {
        Slipped::Marker(m) => format!("marker:{}", problem.scene.marker_names[m]),
        Slipped::Board => "board".to_owned(),
        Slipped::Camera => "camera".to_owned(),
    }
}

/// How many rows show the posture of a frame, one after the other.
fn rows_of_posture(problem: &Problem, frame: usize) -> usize {
    let same = |f: &&i64| problem.posture.get(frame) == Some(f);
    problem.posture.iter().skip(frame).take_while(same).count()
}

/// Whom a mistake concerns: `robot`, `setup`, `camera` or `data`.
fn kind(effect: &str) -> &'static str {
    match effect {
        "axis_sign" | "gravity_direction" | "joint_offset" | "gear_ratio" => "robot",
        "marker_parent" | "board_turned" | "slip" => "setup",
        "camera_resolution" | "picture_flipped" => "camera",
        _ => "data",
    }
}

/// Time from row to row, s; none where no time was recorded.
pub(super) fn row_step_s(recording: &Recording) -> Option<f64> {
    let step = median(recording.frames.windows(2).map(|w| w[1].time_s - w[0].time_s).collect());
    (recording.timed && step > 0.0).then_some(step)
}
