//! The result checked on another session of the same robot: of another length, and with the mistakes of the log in both.

use crate::gap_world::{Plan, World, Wrong};
use mirror_core::diagnose::{
    Checked, DiagnoseOptions, Diagnosis, LeftOutThere, OtherSession, Recording, Target, Via, diagnose,
};
use mirror_core::robot::Robot;
use nalgebra::{Isometry3, Vector2, Vector3};

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

/// Two sessions in a mirror of a robot whose elbow is off, and what the second shows of the causes of the first once it is changed.
fn checked_in_pictures(change: impl Fn(&mut Recording)) -> Checked {
    let world = World::new(4, false);
    let wrong = vec![Wrong::Offset(world.bone("r_elbow"), 0.05)];
    let of = |seed: u64| world.record(&Plan { postures: 30, seed, wrong: wrong.clone(), ..Plan::default() });
    let (session, mut other) = (of(71), of(72));
    change(&mut other);
    checked(&world, &session, other).gap.checked.remove(0)
}

/// Moves what is seen of a marker in these frames.
fn move_pixels(recording: &mut Recording, frames: core::ops::Range<usize>, marker: usize, by: Vector2<f64>) {
    let of_it = |target: &Target| *target == Target::Marker(marker);
    for sighting in recording.frames[frames].iter_mut().flat_map(|f| &mut f.sightings) {
        if of_it(&sighting.target) {
            sighting.pixel += by;
        }
    }
}

/// One false detection, or a board counted from another corner, says nothing of the causes; it is left out, and told.
#[test]
fn what_is_false_in_the_other_session_does_not_count_against_the_causes() {
    let clean = checked_in_pictures(|_| ());
    let [before, after] = [clean.before_m, clean.after_m].map(Option::unwrap);
    assert!(before > 3.0 * after && clean.left_out.is_none(), "{clean:?}");
    let alike = |told: &Checked| {
        let near = |a: Option<f64>, b: f64| (a.unwrap() - b).abs() < 0.1 * b;
        assert!(near(told.before_m, before) && near(told.after_m, after), "{told:?} {clean:?}");
    };
    let one = checked_in_pictures(|other| move_pixels(other, 20..21, 5, Vector2::new(100.0, 0.0)));
    assert_eq!(one.left_out.map(|l| (l.points, l.boards)), Some((1, 0)));
    alike(&one);
    let turned = checked_in_pictures(|other| {
        let of_board = |s: &&mut mirror_core::diagnose::Sighting| s.via == Via::Mirror;
        for sighting in other.frames[20].sightings.iter_mut().filter(of_board) {
            if let Target::Corner(i) = &mut sighting.target {
                *i = (*i + 7) % 35;
            }
        }
    });
    assert!(matches!(turned.left_out, Some(LeftOutThere { points: 0, boards: 1, .. })), "{turned:?}");
    alike(&turned);
    // A point that was measured once has nothing beside it but the model.
    let world = World::new(4, false);
    let session = recorded(&world, (40, 73), &[]);
    let mut other = recorded(&world, (60, 74), &[]);
    other.frames[7].points[3].position_m.x += 0.1;
    let told = checked(&world, &session, other).gap.checked.remove(0);
    assert_eq!(told.left_out, Some(LeftOutThere { points: 1, points_given: 360, boards: 0 }));
    assert!(told.after_m.unwrap() < 3.0 * NOISE_M, "{told:?}");
}

/// Where all views of some postures agree on another place, the model is wrong there: that is what the check is for.
#[test]
fn where_the_model_is_wrong_in_a_few_postures_nothing_is_left_out() {
    let clean = checked_in_pictures(|_| ());
    let pushed = checked_in_pictures(|other| move_pixels(other, 20..24, 5, Vector2::new(25.0, 15.0)));
    assert!(pushed.left_out.is_none(), "{pushed:?}");
    assert!(pushed.after_m.unwrap() > 1.5 * clean.after_m.unwrap(), "{pushed:?} {clean:?}");
    // What is wrong at one joint alone leaves most observations as they are, and the others are no false ones.
    let world = World::new(4, false);
    for wrong in [Wrong::Offset(world.bone("r_elbow"), 0.05), Wrong::Stiction(world.bone("r_elbow"), 0.08)] {
        let of = |seed: u64, wrong: Vec<Wrong>| world.record(&Plan { seed, wrong, ..Plan::default() });
        let told = checked(&world, &of(75, vec![wrong]), of(76, Vec::new())).gap.checked.remove(0);
        assert!(told.left_out.is_none() && told.after_m > told.before_m, "{told:?}");
    }
}
