//! What no effect of the vocabulary explains: optics that no parameter has, and noise that lingers, which is nothing at all.

use crate::gap_world::lingering::blobs_linger;
use crate::gap_world::{Plan, World, Wrong, draws};
use mirror_core::diagnose::{DiagnoseOptions, Diagnosis, Recording, Target, Verdict, diagnose};
use mirror_core::robot::Robot;
use nalgebra::Vector2;

fn diagnosed(world: &World, recording: &Recording) -> Diagnosis {
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    diagnose(&robot, recording, &DiagnoseOptions::default(), &[]).unwrap()
}

/// Tangential distortion of everything that the camera sees: of Brown's lens p₂, which the vocabulary lacks.
fn through_a_tilted_lens(recording: &mut Recording, p2: f64) {
    let camera = &recording.sight.as_ref().unwrap().camera;
    let (focal, center) = (camera.focal_px(), camera.center_px());
    for sighting in recording.frames.iter_mut().flat_map(|f| &mut f.sightings) {
        let (x, y) = ((sighting.pixel.x - center.x) / focal.x, (sighting.pixel.y - center.y) / focal.y);
        let square = x * x + y * y;
        sighting.pixel += Vector2::new(focal.x * p2 * (square + 2.0 * x * x), focal.y * 2.0 * p2 * x * y);
    }
}

#[test]
fn optics_without_a_name_live_in_the_camera_and_are_no_small_errors_everywhere() {
    for seed in draws(1, [5, 6]) {
        let world = World::new(4, true);
        let mut recording = world.record(&Plan { postures: 50, seed, ..Plan::default() });
        through_a_tilted_lens(&mut recording, 0.03);
        let told = diagnosed(&world, &recording);
        println!("{seed} {:?} {:?} {:?}", told.verdict, told.causes, told.r#where);
        assert!(matches!(told.verdict, Verdict::Unknown | Verdict::Partial), "{}", told.sentence);
        assert_eq!(told.r#where[0].at, "camera", "{:?} {:#?}", told.r#where, told.trace);
        assert!(told.causes.iter().all(|c| c.effect != "geometry"), "{:?}", told.causes);
    }
}

#[test]
fn noise_that_lingers_from_view_to_view_is_nothing_wrong_with_the_robot() {
    for seed in draws(2, [0, 1, 2, 3]) {
        let world = World::new(4, true);
        let mut recording = world.record(&Plan { postures: 50, noise_px: 0.05, seed, ..Plan::default() });
        blobs_linger(&mut recording, 0.25, 0.45, 100 + seed);
        let told = diagnosed(&world, &recording);
        assert!(told.verdict == Verdict::None, "{seed}: {} {:#?}", told.sentence, told.trace);
    }
}

#[test]
fn a_cause_is_found_in_noise_that_lingers() {
    let world = World::new(4, true);
    let wrong = vec![Wrong::Ratio(world.bone("r_shoulder_yaw"), 0.05)];
    let mut recording =
        world.record(&Plan { postures: 50, noise_px: 0.05, seed: 3, wrong, ..Plan::default() });
    blobs_linger(&mut recording, 0.25, 0.45, 7);
    let told = diagnosed(&world, &recording);
    assert!(told.verdict == Verdict::Explained, "{} {:#?}", told.sentence, told.trace);
    assert_eq!(told.causes.len(), 1, "{:?}", told.causes);
    assert_eq!(
        (told.causes[0].effect.as_str(), told.causes[0].at.as_str()),
        ("gear_ratio", "joint:r_shoulder_yaw")
    );
    let found = told.causes[0].parameters.values().next().unwrap();
    assert!((found.value - 0.05).abs() < 4.0 * found.std, "{found:?}");
}

/// A column whose values no longer belong to their postures: each posture has that of another one.
fn column_of_other_postures(recording: &mut Recording, joint: usize, step: usize) {
    let postures = recording.frames.iter().map(|f| f.posture as usize).max().unwrap() + 1;
    let mut column = vec![0.0; postures];
    recording.frames.iter().for_each(|f| column[f.posture as usize] = f.commanded[joint]);
    for frame in &mut recording.frames {
        frame.commanded[joint] = column[(frame.posture as usize * step + 3) % postures];
    }
}

#[test]
fn a_column_that_says_nothing_of_its_joint_is_told_and_no_mount_takes_it_up() {
    let name = "r_shoulder_yaw";
    let world = World::new(4, true);
    let mut recording = world.record(&Plan { postures: 61, seed: 11, ..Plan::default() });
    let joint = world.robots_order().iter().position(|&b| b == world.bone(name)).unwrap();
    column_of_other_postures(&mut recording, joint, 7);
    let told = diagnosed(&world, &recording);
    assert!(matches!(told.verdict, Verdict::Unknown | Verdict::Partial), "{}", told.sentence);
    assert_eq!(told.r#where[0].at, format!("joint:{name}"), "{:?} {:#?}", told.r#where, told.trace);
    assert!(told.causes.iter().all(|c| c.probability < 0.9), "{:?}", told.causes);
}

#[test]
fn a_thing_in_the_background_is_no_marker_that_sits_elsewhere() {
    let world = World::new(4, true);
    // In all pictures, and in two of five.
    for every in [1, 5] {
        let mut recording = world.record(&Plan { postures: 50, seed: 21, ..Plan::default() });
        let mut put = 0;
        for (f, frame) in recording.frames.iter_mut().enumerate() {
            for s in frame.sightings.iter_mut().filter(|s| s.target == Target::Marker(1)) {
                if f % every < 2 {
                    s.pixel = Vector2::new(412.3 + 0.1 * (f % 3) as f64, 227.9);
                    put += 1;
                }
            }
        }
        let told = diagnosed(&world, &recording);
        assert!(
            told.causes.is_empty() && told.verdict == Verdict::None,
            "{every}: {} {:#?}",
            told.sentence,
            told.trace
        );
        let background =
            told.data.left_out.iter().filter(|l| l.why.to_string().contains("background")).count();
        assert!(told.warnings.iter().any(|w| w.contains("stands still")), "{:?}", told.warnings);
        assert_eq!(background, put, "{:?}", told.data.left_out);
    }
}

#[test]
fn a_marker_that_one_joint_moves_may_stand_still_with_it() {
    let world = World::new(4, false);
    let mut recording = world.record(&Plan { postures: 50, seed: 22, ..Plan::default() });
    let order = world.robots_order();
    let column = |name: &str| order.iter().position(|&b| b == world.bone(name)).unwrap();
    let steady = [column("l_shoulder_roll"), column("l_shoulder_yaw")];
    let upper = world.markers.iter().position(|m| m.0 == "l_upper").unwrap();
    for frame in &mut recording.frames {
        steady.iter().for_each(|&j| frame.commanded[j] = 0.2);
        let seen = frame.sightings.iter_mut().filter(|s| s.target == Target::Marker(upper));
        seen.for_each(|s| s.pixel = Vector2::new(412.3, 227.9));
    }
    let told = diagnosed(&world, &recording);
    assert!(
        told.data.left_out.iter().all(|l| !l.why.to_string().contains("background")),
        "{:?}",
        told.data.left_out
    );
}

#[test]
fn another_joints_column_is_no_zero_and_no_other_link() {
    let world = World::new(4, true);
    let order = world.robots_order();
    let column = |name: &str| order.iter().position(|&b| b == world.bone(name)).unwrap();
    for (name, copied) in draws(1, [("r_elbow", "l_elbow"), ("l_shoulder_pitch", "r_shoulder_roll")]) {
        let mut recording = world.record(&Plan { postures: 41, seed: 12, ..Plan::default() });
        let (own, other) = (column(name), column(copied));
        recording.frames.iter_mut().for_each(|f| f.commanded[own] = f.commanded[other]);
        let told = diagnosed(&world, &recording);
        assert!(matches!(told.verdict, Verdict::Unknown | Verdict::Partial), "{}", told.sentence);
        assert_eq!(told.r#where[0].at, format!("joint:{name}"), "{:?} {:#?}", told.r#where, told.trace);
        assert!(told.causes.iter().all(|c| c.probability < 0.9), "{:?}", told.causes);
    }
}
