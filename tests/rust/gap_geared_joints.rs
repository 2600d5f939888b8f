//! Joints that gears or links drive from another one's (`<mimic>`): an error of the leading joint is told once, where it is.

use crate::gap_world::{Plan, World, Wrong};
use mirror_core::diagnose::{DiagnoseOptions, Diagnosis, Verdict, diagnose};
use mirror_core::robot::Robot;

/// A parallelogram: the elbow turns back by what the shoulder turns, so that the forearm keeps its direction.
fn palletiser() -> World {
    let mut world = World::new(4, false);
    world.geared = vec![(world.bone("r_elbow"), world.bone("r_shoulder_pitch"), -1.0)];
    world
}

fn run(world: &World, seed: u64, wrong: Vec<Wrong>) -> Diagnosis {
    let recording = world.record(&Plan { postures: 40, seed, wrong, ..Plan::default() });
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    diagnose(&robot, &recording, &DiagnoseOptions::default(), &[]).unwrap()
}

fn assert_told(diagnosis: &Diagnosis, effect: &str, at: &str, parameter: &str, value: f64) {
    assert_eq!(diagnosis.verdict, Verdict::Explained, "{:#?}", diagnosis.trace);
    let named: Vec<_> = diagnosis.causes.iter().map(|c| (c.effect.as_str(), c.at.as_str())).collect();
    assert_eq!(named, [(effect, at)], "{:#?}", diagnosis.trace);
    let cause = &diagnosis.causes[0];
    assert!(cause.probability > 0.5, "{cause:?}");
    let told = &cause.parameters[parameter];
    assert!((told.value - value).abs() < 4.0 * told.std, "{told:?}");
}

#[test]
fn an_error_of_the_leading_joint_reaches_what_it_drives_and_is_one_cause() {
    let world = palletiser();
    let leader = world.bone("r_shoulder_pitch");
    let at = "joint:r_shoulder_pitch";
    let told = |seed, wrong, effect, parameter, value| {
        assert_told(&run(&world, seed, vec![wrong]), effect, at, parameter, value);
    };
    told(81, Wrong::Offset(leader, 0.02), "joint_offset", "offset_rad", 0.02);
    told(82, Wrong::Ratio(leader, 0.04), "gear_ratio", "scale_error", 0.04);
    told(83, Wrong::Compliance(leader, 0.02), "joint_compliance", "compliance_rad_per_nm", 0.02);
}

#[test]
fn an_error_behind_the_gears_is_the_following_joints_alone() {
    let world = palletiser();
    let follower = world.bone("r_elbow");
    let at = "joint:r_elbow";
    assert_told(
        &run(&world, 84, vec![Wrong::Offset(follower, -0.03)]),
        "joint_offset",
        at,
        "offset_rad",
        -0.03,
    );
    assert_told(
        &run(&world, 85, vec![Wrong::Compliance(follower, 0.04)]),
        "joint_compliance",
        at,
        "compliance_rad_per_nm",
        0.04,
    );
}

/// With no marker on the leading joint's own body the observations can't tell its error from that of what it drives.
#[test]
fn a_leading_joint_that_nothing_shows_stands_beside_the_one_that_follows_it() {
    let mut world = World::new(4, false);
    let leader = world.bone("l_elbow");
    world.geared = vec![(world.bone("r_elbow"), leader, 0.8)];
    world.markers.retain(|(name, ..)| name != "l_fore" && name != "l_hand");
    let diagnosis = run(&world, 86, vec![Wrong::Offset(leader, 0.03)]);
    assert_eq!(diagnosis.verdict, Verdict::Explained, "{:#?}", diagnosis.trace);
    let [cause] = &diagnosis.causes[..] else { panic!("{:?}", diagnosis.causes) };
    assert_eq!(cause.effect, "joint_offset", "{cause:?}");
    // Each as probable as the other.
    let same = cause.alternatives.iter().find(|a| a.effect == cause.effect && a.at != cause.at).unwrap();
    let mut places = [cause.at.as_str(), same.at.as_str()];
    places.sort_unstable();
    assert_eq!(places, ["joint:l_elbow", "joint:r_elbow"], "{cause:?}");
    assert!((cause.probability - same.probability).abs() < 0.1, "{cause:?}");
}
