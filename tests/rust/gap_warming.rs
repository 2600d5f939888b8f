//! What creeps or warms up within a recording and is no joint's steady drift: the place and time are told, and no cause that imitates it.

use crate::gap_world::{Plan, World, Wrong, draws};
use mirror_core::diagnose::{DependsOn, DiagnoseOptions, Diagnosis, Recording, Verdict, diagnose};
use mirror_core::robot::Robot;

const NOISE_M: f64 = 2e-4;

fn diagnosed(world: &World, recording: &Recording) -> Diagnosis {
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    diagnose(&robot, recording, &DiagnoseOptions::default(), &[]).unwrap()
}

fn assert_at(told: &Diagnosis, place: &str) {
    assert_eq!(told.verdict, Verdict::Unknown, "{} {:#?}", told.sentence, told.trace);
    assert_eq!(told.r#where[0].at, place, "{:?}", told.r#where);
    assert_eq!(told.r#where[0].depends_on, Some(DependsOn::Time), "{:?}", told.r#where);
}

#[test]
fn a_link_that_grows_is_neither_longer_nor_a_drift_of_its_joint() {
    let world = World::new(4, false);
    for (seed, bone) in [(41, "r_shoulder_yaw"), (42, "l_shoulder_yaw")] {
        let wrong = vec![Wrong::LinkWarms(world.bone(bone), [0.0, 0.0, -0.003])];
        let plan = Plan { postures: 70, views: 1, seed, wrong, ..Plan::default() };
        let told = diagnosed(&world, &world.record_points(&plan, NOISE_M));
        assert_at(&told, &format!("link:{bone}_link"));
    }
}

#[test]
fn a_camera_mount_that_creeps_is_no_drift_of_the_neck() {
    let world = World::new(4, true);
    for seed in draws(1, [43, 44]) {
        let wrong = vec![Wrong::CameraWarms([0.004, 0.006, -0.003, 0.0, 0.0, 0.0])];
        let told = diagnosed(&world, &world.record(&Plan { postures: 70, seed, wrong, ..Plan::default() }));
        assert_at(&told, "camera");
    }
}

/// Its drift is not steady, as no real one is: that is what it is, a part of it, or it has no word.
#[test]
fn a_zero_that_warms_up_is_at_most_a_drift_of_its_joint() {
    let world = World::new(4, true);
    for (seed, joint) in draws(1, [(45, "r_shoulder_pitch"), (46, "l_elbow")]) {
        let wrong = vec![Wrong::ZeroWarms(world.bone(joint), 0.015)];
        let told = diagnosed(&world, &world.record(&Plan { postures: 70, seed, wrong, ..Plan::default() }));
        assert_ne!(told.verdict, Verdict::None, "{}", told.sentence);
        let place = format!("joint:{joint}");
        assert!(told.causes.iter().all(|c| c.effect == "drift" && c.at == place), "{}", told.sentence);
        assert!(told.r#where.iter().any(|w| w.at == place), "{:?}", told.r#where);
    }
}
