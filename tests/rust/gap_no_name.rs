//! What no effect of the vocabulary explains: optics that no parameter has, and noise that lingers, which is nothing at all.

use crate::gap_world::lingering::blobs_linger;
use crate::gap_world::{Plan, World, Wrong};
use mirror_core::diagnose::{DiagnoseOptions, Diagnosis, Recording, Verdict, diagnose};
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
    for seed in [5, 6] {
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
    for seed in 0..4 {
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
