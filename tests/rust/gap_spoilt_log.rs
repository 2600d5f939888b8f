//! Logs that are spoilt in ways for which there is no effect: the place is reported, and no cause that absorbs a part.

use crate::gap_world::resting::rest_elsewhere;
use crate::gap_world::{Plan, World, Wrong, draws};
use mirror_core::diagnose::{DependsOn, DiagnoseOptions, Diagnosis, Recording, Verdict, diagnose};
use mirror_core::robot::Robot;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Even odds: no cause is named with this probability or more.
const EVEN: f64 = 0.5;

fn robot(world: &World) -> Robot {
    Robot::from_urdf_str(&world.urdf()).unwrap()
}

fn diagnosed(world: &World, recording: &Recording) -> Diagnosis {
    diagnose(&robot(world), recording, &DiagnoseOptions::default(), &[]).unwrap()
}

fn column(world: &World, name: &str) -> usize {
    robot(world).position_index(name).unwrap()
}

/// A session of which one joint's column is spoilt.
fn spoilt(world: &World, seed: u64, name: &str, spoil: impl Fn(f64) -> f64) -> Recording {
    let mut recording = world.record(&Plan { postures: 61, seed, ..Plan::default() });
    let joint = column(world, name);
    recording.frames.iter_mut().for_each(|f| f.commanded[joint] = spoil(f.commanded[joint]));
    recording
}

/// The place is this joint, and no cause is named with confidence.
fn assert_only_place(told: &Diagnosis, name: &str) {
    assert!(matches!(told.verdict, Verdict::Unknown | Verdict::Partial), "{}", told.sentence);
    assert_eq!(told.r#where[0].at, format!("joint:{name}"), "{:?} {:#?}", told.r#where, told.trace);
    assert!(told.causes.iter().all(|c| c.probability < EVEN), "{:?} {:#?}", told.causes, told.trace);
}

/// Something is left, and the place is told, beside the mounts.
fn assert_among_places(told: &Diagnosis, name: &str) {
    let left = matches!(told.verdict, Verdict::Unknown | Verdict::Partial);
    assert!(left, "{} {:#?}", told.sentence, told.trace);
    assert!(told.r#where.iter().any(|w| w.at == format!("joint:{name}")), "{:?}", told.r#where);
}

#[test]
fn columns_moved_on_in_the_order_of_the_log_are_found() {
    let world = World::new(4, true);
    let robot = robot(&world);
    let count = robot.position_count();
    // Neighbours in the log are none in the robot: every second joint backwards, then the others.
    let order: Vec<usize> = (0..count).rev().step_by(2).chain((0..count).rev().skip(1).step_by(2)).collect();
    let mut recording = world.record(&Plan { postures: 41, seed: 31, ..Plan::default() });
    for frame in &mut recording.frames {
        let told = frame.commanded.clone();
        for (k, &joint) in order.iter().enumerate() {
            frame.commanded[joint] = told[order[(k + 1) % count]];
        }
    }
    // Without the log's order a rest stays.
    assert!(diagnosed(&world, &recording).verdict != Verdict::Explained);
    recording.columns.clone_from(&order);
    let told = diagnosed(&world, &recording);
    assert!(told.verdict == Verdict::Explained, "{} {:#?}", told.sentence, told.trace);
    assert!(told.causes.iter().all(|c| c.effect == "joints_swapped"), "{:?}", told.causes);
    // A circle of n columns is n − 1 exchanges.
    assert_eq!(told.causes.len(), count - 1);
}

#[test]
fn a_log_that_stops_at_a_limit_does_not_stand_still_several_times() {
    let world = World::new(4, true);
    for (name, seed) in draws(1, [("r_elbow", 32), ("l_shoulder_pitch", 33)]) {
        let clean = world.record(&Plan { postures: 61, seed, ..Plan::default() });
        let mut values: Vec<f64> = clean.frames.iter().map(|f| f.commanded[column(&world, name)]).collect();
        values.sort_by(f64::total_cmp);
        let (low, high) = (values[3 * values.len() / 10], values[7 * values.len() / 10]);
        let told = diagnosed(&world, &spoilt(&world, seed, name, |q| q.clamp(low, high)));
        assert_only_place(&told, name);
        assert!(
            told.warnings.iter().any(|w| w.contains("column") && w.contains(name)),
            "{:?}",
            told.warnings
        );
    }
}

#[test]
fn a_column_without_its_signs_is_no_axis_that_turns_the_other_way() {
    let world = World::new(4, true);
    for (name, seed) in draws(1, [("r_shoulder_yaw", 34), ("l_elbow", 35)]) {
        assert_only_place(&diagnosed(&world, &spoilt(&world, seed, name, f64::abs)), name);
    }
}

#[test]
fn a_column_of_zeros_is_told_at_its_joint() {
    let world = World::new(4, true);
    assert_only_place(
        &diagnosed(&world, &spoilt(&world, 36, "r_shoulder_pitch", |_| 0.0)),
        "r_shoulder_pitch",
    );
}

#[test]
fn a_zero_that_is_lost_in_the_middle_is_no_drift_and_is_told_from_its_row_on() {
    let world = World::new(4, true);
    for (name, seed, offset) in [("r_elbow", 37, 0.3), ("l_shoulder_roll", 38, -0.09)] {
        let mut recording = world.record(&Plan { postures: 41, seed, ..Plan::default() });
        let (joint, first) = (column(&world, name), recording.frames.len() * 2 / 5);
        recording.frames[first..].iter_mut().for_each(|f| f.commanded[joint] += offset);
        let told = diagnosed(&world, &recording);
        assert_only_place(&told, name);
        let row = recording.frames[first].number;
        assert_eq!(told.r#where[0].depends_on, Some(DependsOn::RowsFrom(row)), "{:#?}", told.trace);
        assert!(
            told.warnings.iter().any(|w| w.contains(&format!("from row {row} on"))),
            "{:?}",
            told.warnings
        );
        // What no simulator can be given is no gap closed.
        let (before, after) = (told.gap.before_px.unwrap(), told.gap.after_px.unwrap());
        assert!(after > 0.9 * before, "{before} {after}");
    }
}

/// How much of the squares of what is wrong lies at each place is told in one unit: of two elbows as of their angles.
#[test]
fn beside_a_lost_zero_each_place_has_its_share() {
    let world = World::new(4, true);
    let mut recording = world.record(&Plan { postures: 81, seed: 47, ..Plan::default() });
    let (stepped, other) = (column(&world, "r_elbow"), column(&world, "l_elbow"));
    let (by, first) = (column(&world, "l_shoulder_roll"), recording.frames.len() / 2);
    let (mut of_step, mut of_law) = (0.0, 0.0);
    for (f, frame) in recording.frames.iter_mut().enumerate() {
        let (law, step) = (0.1 * frame.commanded[by].powi(2), if f < first { 0.0 } else { 0.15 });
        frame.commanded[other] += law;
        frame.commanded[stepped] += step;
        of_law += law * law;
        of_step += step * step;
    }
    let told = diagnosed(&world, &recording);
    let share = |name: &str| {
        let of_it = told.r#where.iter().filter(|w| w.at == format!("joint:{name}"));
        of_it.map(|w| w.share).sum::<f64>()
    };
    let (found, truth) = (share("r_elbow"), of_step / (of_step + of_law));
    assert!(share("l_elbow") > 0.0, "{:?} {} {:#?}", told.r#where, told.sentence, told.trace);
    assert!((found - truth).abs() < 0.02, "{found} of {truth} {:?} {}", told.r#where, told.sentence);
}

#[test]
fn a_zero_that_is_lost_beside_a_cause_is_no_drift_of_its_joint() {
    let world = World::new(4, true);
    let wrong = vec![Wrong::Offset(world.bone("r_shoulder_yaw"), 0.06)];
    let mut recording = world.record(&Plan { postures: 61, seed: 13, wrong, ..Plan::default() });
    let (joint, first) = (column(&world, "l_elbow"), recording.frames.len() / 2);
    recording.frames[first..].iter_mut().for_each(|f| f.commanded[joint] += 0.1);
    let told = diagnosed(&world, &recording);
    let named: Vec<&str> = told.causes.iter().map(|c| c.effect.as_str()).collect();
    assert_eq!(named, ["joint_offset"], "{:?} {:#?}", told.causes, told.trace);
    assert_eq!(told.r#where[0].at, "joint:l_elbow", "{:?}", told.r#where);
}

#[test]
fn what_has_a_word_is_told_by_it() {
    let world = World::new(4, true);
    // What has a word is told by it, although free positions would leave as little.
    let mut recording = spoilt(&world, 39, "r_elbow", |q| -q);
    let told = diagnosed(&world, &recording);
    assert_eq!((told.causes[0].effect.as_str(), told.causes.len()), ("axis_sign", 1), "{:#?}", told.trace);
    let wrong = vec![Wrong::Ratio(world.bone("l_elbow"), 0.05)];
    recording = world.record(&Plan { postures: 61, seed: 40, wrong, ..Plan::default() });
    let told = diagnosed(&world, &recording);
    assert_eq!((told.causes[0].effect.as_str(), told.causes.len()), ("gear_ratio", 1), "{:#?}", told.trace);
}

/// What hands displace: board, camera and three markers.
fn mounts_by_hand() -> Vec<Wrong> {
    vec![
        Wrong::BoardMount([0.012, -0.018, 0.015, 0.003, -0.004, 0.002]),
        Wrong::CameraMount([-0.014, 0.02, 0.009, -0.003, 0.002, 0.004]),
        Wrong::Mount(0, [0.003, -0.002, 0.004]),
        Wrong::Mount(1, [-0.004, 0.003, 0.002]),
        Wrong::Mount(2, [0.002, 0.004, -0.003]),
    ]
}

#[test]
fn a_zero_that_is_lost_is_no_slip_beside_mounts_by_hand() {
    let world = World::new(4, true);
    let mut recording =
        world.record(&Plan { postures: 41, seed: 43, wrong: mounts_by_hand(), ..Plan::default() });
    let (joint, first) = (column(&world, "r_elbow"), recording.frames.len() / 2);
    recording.frames[first..].iter_mut().for_each(|f| f.commanded[joint] += 0.3);
    let told = diagnosed(&world, &recording);
    let row = recording.frames[first].number;
    let warned = |w: &String| w.contains(&format!("joint:r_elbow has another zero from row {row} on"));
    assert!(told.warnings.iter().any(warned), "{:?} {:#?}", told.warnings, told.trace);
    let others = told.causes.iter().filter(|c| c.kind != "setup");
    assert!(others.clone().all(|c| c.probability < EVEN), "{:?} {:#?}", told.causes, told.trace);
    // All figures are of the session as it was logged: no step of the gap is below the one that is left.
    let after = told.gap.after_px.unwrap();
    assert!(told.gap.steps.iter().all(|s| s.rms_px.is_some_and(|px| px > 0.9 * after)), "{:?}", told.gap);
    // And the joint's errors show the step.
    let signature = told.signatures.iter().find(|s| s.cause.is_none() && s.at == "joint:r_elbow").unwrap();
    let mean = |after: bool| {
        let own = signature.points.iter().filter(|p| (p.frame >= row) == after).map(|p| p.error);
        own.clone().sum::<f64>() / own.count() as f64
    };
    assert!((mean(true) - mean(false) + 0.3).abs() < 0.02, "{} {}", mean(true), mean(false));
}

#[test]
fn a_spoilt_column_is_found_beside_mounts_by_hand() {
    let world = World::new(4, true);
    let unsigned: fn(f64) -> f64 = f64::abs;
    for (name, seed, spoil) in [("r_shoulder_yaw", 41, unsigned), ("l_elbow", 42, |_| 0.0)] {
        let mut recording =
            world.record(&Plan { postures: 61, seed, wrong: mounts_by_hand(), ..Plan::default() });
        let joint = column(&world, name);
        recording.frames.iter_mut().for_each(|f| f.commanded[joint] = spoil(f.commanded[joint]));
        let told = diagnosed(&world, &recording);
        assert_among_places(&told, name);
        let warned = |w: &String| w.contains(&format!("column of joint:{name} is unrelated"));
        assert!(told.warnings.iter().any(warned), "{:?} {:#?}", told.warnings, told.trace);
        let others = told.causes.iter().filter(|c| c.kind != "setup");
        assert!(others.clone().all(|c| c.probability < EVEN), "{:?} {:#?}", told.causes, told.trace);
    }
}

#[test]
fn a_joint_that_rests_anywhere_is_found_beside_mounts_by_hand() {
    let world = World::new(4, true);
    for (name, seed) in draws(1, [("r_elbow", 44), ("l_shoulder_yaw", 45)]) {
        let mut recording =
            world.record(&Plan { postures: 61, seed, wrong: mounts_by_hand(), ..Plan::default() });
        let joint = column(&world, name);
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        rest_elsewhere(&mut recording, &[joint], || random.random_range(-0.015..0.015));
        let told = diagnosed(&world, &recording);
        assert_among_places(&told, name);
        let others = told.causes.iter().filter(|c| c.kind != "setup");
        assert!(others.clone().all(|c| c.probability < EVEN), "{:?} {:#?}", told.causes, told.trace);
    }
}

#[test]
fn positions_in_coarse_steps_are_warned_of() {
    let world = World::new(4, true);
    let clean = world.record(&Plan { postures: 41, seed: 46, ..Plan::default() });
    let about = |told: &Diagnosis| told.warnings.iter().find(|w| w.contains("in steps of")).cloned();
    assert_eq!(about(&diagnosed(&world, &clean)), None);
    let mut typed = clean;
    for q in typed.frames.iter_mut().flat_map(|f| &mut f.commanded) {
        *q = q.to_degrees().round().to_radians();
    }
    let told = diagnosed(&world, &typed);
    let warning = about(&told).unwrap_or_else(|| panic!("{:?}", told.warnings));
    assert!(warning.contains("steps of up to 1°") && warning.contains("more joints"), "{warning}");
}

#[test]
fn a_spoilt_column_is_found_where_the_measured_frame_is_unknown() {
    type Spoil = fn(f64) -> f64;
    let world = World::new(4, true);
    // All markers on one arm: no other joint shows the frame. First joints of a chain turn what the frame does.
    let unsigned: Spoil = f64::abs;
    let spoilt: [(&str, u64, Spoil); 3] =
        [("r_elbow", 51, |_| 0.0), ("r_shoulder_pitch", 52, |_| 0.4), ("r_shoulder_yaw", 53, unsigned)];
    for (name, seed, spoil) in spoilt {
        let plan = Plan { postures: 61, views: 1, seed, ..Plan::default() };
        let mut recording = world.record_points(&plan, 3e-4);
        let of_arm: Vec<bool> = recording.markers.iter().map(|m| m.name.starts_with("r_")).collect();
        recording.frames.iter_mut().for_each(|f| f.points.retain(|p| of_arm[p.marker]));
        recording.markers.iter_mut().for_each(|m| m.mount_known = false);
        let joint = column(&world, name);
        recording.frames.iter_mut().for_each(|f| f.commanded[joint] = spoil(f.commanded[joint]));
        assert_only_place(&diagnosed(&world, &recording), name);
    }
}

#[test]
fn a_few_false_rows_are_no_spoilt_column() {
    let world = World::new(4, true);
    let plan = Plan { postures: 41, views: 1, seed: 54, ..Plan::default() };
    let mut recording = world.record_points(&plan, 3e-4);
    let joint = column(&world, "r_elbow");
    // A digit in one row of eight.
    recording.frames.iter_mut().skip(3).step_by(8).for_each(|f| f.commanded[joint] += 1.0);
    let told = diagnosed(&world, &recording);
    assert!(
        told.warnings.iter().all(|w| !w.contains("is unrelated")),
        "{:?} {:#?}",
        told.warnings,
        told.trace
    );
    assert!(told.data.left_out.iter().any(|l| l.frame == recording.frames[3].number), "{:?}", told.data);
}

#[test]
fn beside_something_gross_nothing_is_told_with_confidence() {
    let world = World::new(4, true);
    // Two columns in another order, seen by one marker: free positions of one joint leave the other's errors.
    for seed in [61, 71, 72] {
        let mut recording =
            world.record_points(&Plan { postures: 61, views: 1, seed, ..Plan::default() }, 3e-4);
        let hand = recording.markers.iter().position(|m| m.name == "r_hand").unwrap();
        recording.frames.iter_mut().for_each(|f| f.points.retain(|p| p.marker == hand));
        for (name, step) in [("r_shoulder_pitch", 7), ("r_elbow", 16)] {
            let joint = column(&world, name);
            let told: Vec<f64> = recording.frames.iter().map(|f| f.commanded[joint]).collect();
            for (f, frame) in recording.frames.iter_mut().enumerate() {
                frame.commanded[joint] = told[(f * step + 3) % told.len()];
            }
        }
        let told = diagnosed(&world, &recording);
        assert!(!matches!(told.verdict, Verdict::Explained | Verdict::None), "{}", told.sentence);
        assert!(told.causes.iter().all(|c| c.probability < EVEN), "{:?} {:#?}", told.causes, told.trace);
    }
}

#[test]
fn a_joint_that_stops_before_its_target_is_no_row_of_digits() {
    let world = World::new(4, false);
    let mut recording = world.record(&Plan { postures: 60, seed: 91, ..Plan::default() });
    let joint = column(&world, "r_elbow");
    let stop = 0.3;
    let mut beyond = 0;
    for frame in &mut recording.frames {
        let q = &mut frame.commanded[joint];
        if *q > stop {
            *q = stop + 5.0 * (*q - stop);
            beyond += 1;
        }
    }
    assert!((6..=16).contains(&beyond), "{beyond} of {} rows", recording.frames.len());
    let told = diagnosed(&world, &recording);
    assert!(
        matches!(told.verdict, Verdict::Unknown | Verdict::Partial),
        "{} {:#?}",
        told.sentence,
        told.trace
    );
    assert!(told.sentence.contains("joint:r_elbow"), "{} {:#?}", told.sentence, told.trace);
    assert!(told.causes.iter().all(|c| c.probability < EVEN), "{:?}", told.causes);
}
