//! The result checked on another session of the same robot: of another length, and with the mistakes of the log in both.

use crate::gap_world::{Plan, World, Wrong};
use mirror_core::diagnose::{DiagnoseOptions, Diagnosis, OtherSession, Recording, diagnose};
use mirror_core::robot::Robot;
use nalgebra::{Isometry3, Vector3};

const NOISE_M: f64 = 4e-4;

fn checked(world: &World, session: &Recording, other: Recording) -> Diagnosis {
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let other =
        OtherSession { name: "other".into(), robot: robot.clone(), recording: other, own: Vec::new() };
    diagnose(&robot, session, &DiagnoseOptions::default(), &[other]).unwrap()
}

fn recorded(world: &World, (postures, seed): (usize, u64), wrong: &[Wrong]) -> Recording {
    let plan = Plan { postures, views: 1, seed, wrong: wrong.to_vec(), ..Plan::default() };
    world.record_points(&plan, NOISE_M)
}

fn reverse(recording: &mut Recording, joint: usize) {
    recording.frames.iter_mut().for_each(|frame| frame.commanded[joint] = -frame.commanded[joint]);
}

#[test]
fn a_column_of_the_wrong_sign_is_undone_in_the_other_session_too() {
    let world = World::new(4, false);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let joint = robot.position_names().position(|name| name == "r_elbow").unwrap();
    let (mut session, mut other) = (recorded(&world, (40, 51), &[]), recorded(&world, (60, 52), &[]));
    reverse(&mut session, joint);
    reverse(&mut other, joint);
    let told = checked(&world, &session, other);
    assert_eq!(told.causes[0].effect, "axis_sign", "{}", told.sentence);
    let check = &told.gap.checked[0];
    let (before, after) = (check.before_m.unwrap(), check.after_m.unwrap());
    assert!(before > 0.04 && after < 3.0 * NOISE_M, "{before} {after}");
}

/// Each row of the log lies between its own positions and those of the row before.
fn late(recording: &mut Recording, rows: f64) {
    let true_rows: Vec<Vec<f64>> = recording.frames.iter().map(|frame| frame.commanded.clone()).collect();
    for (frame, before) in recording.frames.iter_mut().skip(1).zip(&true_rows) {
        frame.commanded.iter_mut().zip(before).for_each(|(q, earlier)| *q += rows * (earlier - *q));
    }
}

#[test]
fn a_delay_is_that_of_the_other_sessions_rows() {
    let world = World::new(4, false);
    let (mut session, mut other) = (recorded(&world, (40, 53), &[]), recorded(&world, (90, 54), &[]));
    late(&mut session, 0.05);
    late(&mut other, 0.05);
    let told = checked(&world, &session, other);
    assert_eq!((told.causes[0].effect.as_str(), told.causes[0].at.as_str()), ("joint_late", "robot"));
    let check = &told.gap.checked[0];
    let (before, after) = (check.before_m.unwrap(), check.after_m.unwrap());
    assert!(after < 0.3 * before, "{before} {after}");
}

#[test]
fn a_session_without_what_was_found_is_predicted_worse() {
    let world = World::new(4, false);
    let joint = world.bone("r_elbow");
    let (session, other) =
        (recorded(&world, (40, 55), &[Wrong::Offset(joint, 0.05)]), recorded(&world, (60, 56), &[]));
    let told = checked(&world, &session, other);
    let check = &told.gap.checked[0];
    assert!(check.after_m.unwrap() > 2.0 * check.before_m.unwrap(), "{check:?}");
}

/// The robot stands on ground that yields in the other session: no prediction of the robot could know that. It is told beside the
/// prediction, which is without it, and is not there where both stand alike.
#[test]
fn other_ground_is_told_beside_the_prediction() {
    let world = World::new(4, false);
    let elbow = Wrong::Ratio(world.bone("r_elbow"), 0.02);
    let session = recorded(&world, (40, 61), core::slice::from_ref(&elbow));
    let on = |seed: u64, c: Vector3<f64>| {
        let plan = Plan { postures: 60, views: 1, seed, wrong: vec![elbow.clone()], ..Plan::default() };
        world.record_points_of_base(&plan, NOISE_M, |_, moment| {
            Isometry3::new(Vector3::zeros(), c.component_mul(&moment))
        })
    };
    for seed in 62..66 {
        let firm = checked(&world, &session, on(seed, Vector3::zeros()));
        let check = &firm.gap.checked[0];
        assert!(check.ground.is_none() && check.after_m.unwrap() < 3.0 * NOISE_M, "{check:?}");
    }
    let yields = Vector3::new(0.008, 0.005, 0.0);
    let mut deviations = Vec::new();
    for seed in 66..72 {
        let check = checked(&world, &session, on(seed, yields)).gap.checked.remove(0);
        let ground = check.ground.clone().unwrap();
        assert!(ground.after_m < 1.8 * NOISE_M && check.after_m.unwrap() > 2.0 * ground.after_m, "{check:?}");
        for k in 0..2 {
            deviations.push((ground.yields_rad_per_nm[k] - yields[k]) / ground.std_rad_per_nm[k]);
        }
    }
    let square = deviations.iter().map(|d| d * d).sum::<f64>();
    // Twelve numbers: chi-squared is between 2.2 and 33 with 99.8 %.
    assert!(square > 2.2 && square < 33.0, "{deviations:?}");
}
