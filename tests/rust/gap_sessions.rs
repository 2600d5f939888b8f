//! Sessions that show too little, or show it badly: a clear answer or a clear error, no panic, no number that is none.

use crate::gap_world::{Plan, World, Wrong};
use mirror_core::Error;
use mirror_core::diagnose::{DiagnoseOptions, Diagnosis, MarkerSpec, Recording, Target, diagnose};
use mirror_core::robot::Robot;
use nalgebra::Vector2;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn world() -> World {
    World::new(4, false)
}

fn elbow_off(plan: Plan) -> Plan {
    Plan { wrong: vec![Wrong::Offset(world().bone("r_shoulder_roll"), 0.03)], ..plan }
}

fn robot() -> Robot {
    Robot::from_urdf_str(&world().urdf()).unwrap()
}

/// serde_json writes `null` for what is not a number: the only ones allowed are those of an absent gap and plain JSON options.
fn is_finite(diagnosis: &Diagnosis) {
    let g = &diagnosis.gap;
    let mut numbers: Vec<f64> =
        [g.before_m, g.after_m, g.noise_floor_m, g.closed, g.before_px, g.after_px, g.noise_floor_px]
            .into_iter()
            .flatten()
            .collect();
    numbers.extend(g.steps.iter().flat_map(|s| [s.rms_m, s.rms_px]).flatten());
    numbers.extend(diagnosis.limits.iter().flat_map(|l| l.parameters.values().copied()).flatten());
    numbers.extend(g.closed_ci95.into_iter().flatten());
    for c in &diagnosis.causes {
        numbers.extend([c.probability, c.rms_shift]);
        numbers.extend(c.stability);
        numbers.extend(c.parameters.values().flat_map(|e| [e.value, e.std]));
        numbers.extend(c.alternatives.iter().map(|a| a.probability));
    }
    numbers.extend(diagnosis.r#where.iter().map(|w| w.share));
    numbers.extend(diagnosis.noise.values());
    numbers.extend(diagnosis.ranking.iter().map(|r| r.log_bayes));
    numbers.extend(diagnosis.next_postures.iter().flat_map(|p| p.values().copied()));
    for p in diagnosis.signatures.iter().flat_map(|s| &s.points) {
        numbers.extend([p.position, p.torque_nm, p.direction, p.time_s, p.error, p.std, p.fitted]);
    }
    for p in diagnosis.tracks.iter().flat_map(|t| &t.points) {
        numbers.extend([&p.against, &p.error, &p.std, &p.fitted].into_iter().flatten());
    }
    for p in diagnosis.fields.iter().flat_map(|f| &f.points) {
        numbers.extend(p.without.iter().chain(p.with.iter().flatten()).chain(&p.std));
    }
    assert!(numbers.iter().all(|x| x.is_finite()), "{diagnosis:?}");
}

fn run(recording: &Recording) -> Diagnosis {
    let diagnosis = diagnose(&robot(), recording, &DiagnoseOptions::default(), &[]).unwrap();
    is_finite(&diagnosis);
    diagnosis
}

/// Too little to diagnose is an error with a message, or no cause and a warning.
fn refused_or_told(recording: &Recording) {
    match diagnose(&robot(), recording, &DiagnoseOptions::default(), &[]) {
        Err(error) => assert!(!error.to_string().is_empty()),
        Ok(diagnosis) => {
            is_finite(&diagnosis);
            assert!(diagnosis.causes.is_empty() && !diagnosis.warnings.is_empty(), "{diagnosis:?}");
        }
    }
}

fn causes(diagnosis: &Diagnosis) -> Vec<(&str, &str)> {
    diagnosis.causes.iter().map(|c| (c.effect.as_str(), c.at.as_str())).collect()
}

#[test]
fn a_few_postures_give_an_answer_with_a_warning() {
    for postures in [1, 2, 3, 6] {
        let diagnosis = run(&world().record(&elbow_off(Plan { postures, ..Plan::default() })));
        assert!(!diagnosis.warnings.is_empty(), "{postures} postures: {diagnosis:?}");
    }
}

/// Where nothing is stated, no figure is that of causes which are not named.
#[test]
fn what_is_too_little_for_a_statement_closes_no_gap() {
    for (postures, views) in [(1, 2), (2, 2), (2, 3)] {
        let diagnosis = run(&world().record(&elbow_off(Plan { postures, views, ..Plan::default() })));
        let gap = &diagnosis.gap;
        assert_eq!(diagnosis.verdict.as_str(), "insufficient");
        assert_eq!((gap.after_m, gap.after_px), (gap.before_m, gap.before_px), "{postures}");
        assert!(gap.closed.is_none_or(|closed| closed == 0.0) && gap.chosen_anew.is_none(), "{gap:?}");
        assert_eq!(gap.held_out_postures, 0);
    }
    let told = run(&world().record(&elbow_off(Plan { postures: 1, ..Plan::default() }))).warnings;
    assert!(told.iter().any(|w| w.starts_with("only 1 posture:")), "{told:?}");
}

/// Three postures are the fewest for a statement, and too few to hold some out: the sentence does not claim it.
#[test]
fn of_three_postures_none_is_said_to_be_held_out() {
    let of =
        |postures: usize| run(&world().record(&elbow_off(Plan { postures, views: 3, ..Plan::default() })));
    let (three, four) = (of(3), of(4));
    assert_eq!((three.gap.held_out_postures, four.gap.held_out_postures), (0, 4));
    for told in [three, four] {
        let claims = told.sentence.contains("on postures that the fit did not see");
        assert_eq!(claims, told.gap.held_out_postures == 4, "{}", told.sentence);
    }
}

#[test]
fn one_frame_gives_an_answer_with_a_warning() {
    let diagnosis = run(&world().record(&elbow_off(Plan { postures: 1, views: 1, ..Plan::default() })));
    assert!(!diagnosis.warnings.is_empty(), "{diagnosis:?}");
}

#[test]
fn one_marker_is_not_blamed_on_the_other_arm() {
    let mut recording = world().record(&elbow_off(Plan::default()));
    recording.markers = vec![recording.markers[5].clone()];
    for frame in &mut recording.frames {
        frame.sightings.retain(|s| !matches!(s.target, Target::Marker(m) if m != 5));
        frame.sightings.iter_mut().for_each(|s| {
            if let Target::Marker(m) = &mut s.target {
                *m = 0;
            }
        });
    }
    let diagnosis = run(&recording);
    assert!(causes(&diagnosis).iter().all(|(_, at)| !at.contains("l_")), "{diagnosis:?}");
}

#[test]
fn perfect_measurements_neither_divide_by_zero_nor_invent() {
    let diagnosis = run(&world().record(&Plan { noise_px: 0.0, ..Plan::default() }));
    assert_eq!((diagnosis.verdict.as_str(), diagnosis.causes.len()), ("none", 0), "{diagnosis:?}");
    let diagnosis = run(&world().record(&elbow_off(Plan { noise_px: 0.0, ..Plan::default() })));
    assert_eq!(causes(&diagnosis), [("joint_offset", "joint:r_shoulder_roll")]);
}

#[test]
fn joints_that_never_move_are_not_called_by_their_position() {
    // All rows hold the zero posture but for one arm: constant columns.
    let world = world();
    let mut recording = world.record(&Plan { postures: 30, ..Plan::default() });
    let held = robot();
    let constant: Vec<usize> =
        held.position_names().enumerate().filter_map(|(i, n)| n.starts_with("l_").then_some(i)).collect();
    for frame in &mut recording.frames {
        constant.iter().for_each(|&i| frame.commanded[i] = 0.0);
        frame.sightings.retain(|s| !matches!(s.target, Target::Marker(m) if m < 3));
    }
    let diagnosis = run(&recording);
    let by_position = ["gear_ratio", "gear_eccentricity", "stiction", "backlash"];
    for ranked in diagnosis.ranking.iter().filter(|r| by_position.contains(&r.effect.as_str())) {
        assert!(!ranked.at.starts_with("joint:l_"), "{ranked:?}");
    }
    assert_eq!(diagnosis.causes.len(), 0, "{diagnosis:?}");
}

/// Rows that are left out whole are left out, too: the warning counts all that is far from the model.
#[test]
fn rows_with_typed_digits_are_warned_of() {
    let mut recording = world().record(&Plan { postures: 40, views: 1, ..Plan::default() });
    for f in [5, 17, 29] {
        recording.frames[f].commanded[1] += 0.4;
        recording.frames[f].commanded[2] -= 0.5;
        recording.frames[f].commanded[5] += 0.4;
        recording.frames[f].commanded[6] -= 0.6;
    }
    let told = run(&recording);
    assert!(told.data.points_given - told.data.points_used > 10, "{:?}", told.data);
    let warned = |w: &String| w.contains("far from the best model and were left out as false");
    assert!(told.warnings.iter().any(warned), "{:?} {:?}", told.warnings, told.data.left_out);
}

#[test]
fn a_third_of_false_markers_does_not_change_the_cause() {
    let mut recording = world().record(&elbow_off(Plan::default()));
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for sighting in recording.frames.iter_mut().flat_map(|f| &mut f.sightings) {
        if matches!(sighting.target, Target::Marker(_)) && rng.random_range(0.0..1.0) < 0.3 {
            sighting.pixel = Vector2::new(rng.random_range(0.0..799.0), rng.random_range(0.0..599.0));
        }
    }
    let diagnosis = run(&recording);
    // Never a confident wrong cause: the true one, or none, or one that is not sure.
    for cause in &diagnosis.causes {
        let right = cause.at == "joint:r_shoulder_roll" || cause.at == "data";
        assert!(right || cause.probability < 0.9, "{cause:?} {:?}", diagnosis.trace);
    }
}

/// Whatever is told as all but certain is true.
fn nothing_false_is_certain(diagnosis: &Diagnosis, truth: &[(&str, &str)]) {
    for cause in diagnosis.causes.iter().filter(|c| c.probability >= 0.9) {
        assert!(truth.contains(&(cause.effect.as_str(), cause.at.as_str())), "{cause:?}");
    }
}

#[test]
fn two_causes_that_cancel_are_both_found_or_neither_is_certain() {
    let world = world();
    let offset = |name: &str, a| Wrong::Offset(world.bone(name), a);
    // The forearm is parallel to where it should be; the hand is off by the upper arm's part alone.
    let elbow = vec![offset("r_shoulder_pitch", 0.02), offset("r_elbow", -0.02)];
    let diagnosis = run(&world.record(&Plan { wrong: elbow, ..Plan::default() }));
    let truth = [("joint_offset", "joint:r_shoulder_pitch"), ("joint_offset", "joint:r_elbow")];
    nothing_false_is_certain(&diagnosis, &truth);
    assert!(truth.iter().all(|t| causes(&diagnosis).contains(t)), "{diagnosis:?}");
    // At one distance of the mirror a larger board looks like a longer focal length.
    let optics = vec![Wrong::Focal(0.01), Wrong::BoardScale(0.01)];
    let diagnosis = run(&world.record(&Plan { wrong: optics, ..Plan::default() }));
    nothing_false_is_certain(&diagnosis, &[("camera_focal", "camera"), ("board_scale", "board")]);
}

#[test]
fn postures_all_from_one_side_make_no_false_cause_certain() {
    let truth = [("joint_offset", "joint:r_shoulder_roll")];
    let mut recording = world().record(&elbow_off(Plan { postures: 500, views: 1, ..Plan::default() }));
    let names: Vec<String> = robot().position_names().map(String::from).collect();
    let at = |name: &str| names.iter().position(|n| n == name).unwrap();
    let (roll, elbow) = (at("r_shoulder_roll"), at("r_elbow"));
    recording.frames.retain(|f| f.commanded[roll] > 0.3 && f.commanded[elbow] > 0.0);
    assert!(recording.frames.len() > 20);
    let diagnosis = run(&recording);
    nothing_false_is_certain(&diagnosis, &truth);
    let cause = diagnosis.causes.first();
    let told = cause.is_some_and(|c| {
        (c.effect.as_str(), c.at.as_str()) == truth[0]
            || c.alternatives.iter().any(|a| (a.effect.as_str(), a.at.as_str()) == truth[0])
    });
    assert!(told, "{diagnosis:?}");
}

#[test]
fn a_mirror_session_without_a_board_is_refused_or_says_what_is_missing() {
    let mut recording = world().record(&Plan { postures: 10, ..Plan::default() });
    recording.sight.as_mut().unwrap().board = None;
    recording.frames.iter_mut().for_each(|f| f.sightings.retain(|s| matches!(s.target, Target::Marker(_))));
    refused_or_told(&recording);
}

#[test]
fn points_in_an_unknown_frame_alone_show_the_cause() {
    let world = world();
    let plan = elbow_off(Plan { views: 1, ..Plan::default() });
    let diagnosis = run(&world.record_points(&plan, 3e-4));
    assert_eq!(causes(&diagnosis), [("joint_offset", "joint:r_shoulder_roll")], "{diagnosis:?}");
    let found = diagnosis.causes[0].parameters["offset_rad"];
    assert!((found.value - 0.03).abs() < 4.0 * found.std, "{found:?}");
}

#[test]
fn empty_frames_count_for_nothing() {
    let mut recording = world().record(&elbow_off(Plan::default()));
    for frame in recording.frames.iter_mut().step_by(5) {
        frame.sightings.clear();
    }
    assert_eq!(causes(&run(&recording)), [("joint_offset", "joint:r_shoulder_roll")]);
    recording.frames.iter_mut().for_each(|f| f.sightings.clear());
    refused_or_told(&recording);
}

#[test]
fn what_cannot_be_is_refused_by_name() {
    let good = world().record(&Plan { postures: 2, ..Plan::default() });
    let validated = |recording: &Recording| recording.clone().validated(robot().position_count());
    let mut bad = good.clone();
    bad.frames.clear();
    assert!(matches!(validated(&bad), Err(Error::TooFew { .. })));
    let mut bad = good.clone();
    bad.frames[1].sightings[0].pixel.x = f64::NAN;
    assert!(validated(&bad).unwrap_err().to_string().contains("frame 1"));
    let mut bad = good.clone();
    bad.frames[0].commanded.pop();
    assert!(matches!(validated(&bad), Err(Error::LengthMismatch { .. })));
    let mut bad = good;
    bad.markers.push(MarkerSpec { link: "no_such_link".into(), ..bad.markers[0].clone() });
    let error = diagnose(&robot(), &bad, &DiagnoseOptions::default(), &[]).unwrap_err();
    assert!(error.to_string().contains("no_such_link"), "{error}");
}

#[test]
fn an_unknown_name_among_the_effects_to_leave_out_is_refused_with_the_valid_ones() {
    let (robot, recording) = (robot(), world().record(&elbow_off(Plan::default())));
    let without =
        |name: &str| DiagnoseOptions { without: vec![name.to_owned()], ..DiagnoseOptions::default() };
    let error = diagnose(&robot, &recording, &without("compliance"), &[]).unwrap_err().to_string();
    for name in ["compliance", "joint_compliance", "backlash", "mirror_curvature", "geometry", "pairing"] {
        assert!(error.contains(name), "{error}");
    }
    assert!(diagnose(&robot, &recording, &without("joint_compliance"), &[]).is_ok());
}
