//! A marker that something pushes in a few postures: a cable, a contact. Its observations there are far from every model and are left
//! out, but they are no false detections: all lie where one joint is beyond a position, or in one run of rows.

use crate::gap_world::{Plan, World};
use mirror_core::diagnose::{DependsOn, DiagnoseOptions, Diagnosis, Recording, Verdict, diagnose};
use mirror_core::robot::Robot;
use nalgebra::Vector3;

const NOISE_M: f64 = 5e-4;
const POSTURES: usize = 60;

fn recorded(world: &World, seed: u64) -> Recording {
    world.record_points(&Plan { postures: POSTURES, views: 1, seed, ..Plan::default() }, NOISE_M)
}

fn diagnosed(world: &World, recording: &Recording) -> Diagnosis {
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    diagnose(&robot, recording, &DiagnoseOptions::default(), &[]).unwrap()
}

/// Pushes a marker by a centimetre in these frames.
fn push(recording: &mut Recording, marker: &str, frames: &[usize]) {
    let which = recording.markers.iter().position(|m| m.name == marker).unwrap();
    for &f in frames {
        for point in recording.frames[f].points.iter_mut().filter(|p| p.marker == which) {
            point.position_m += Vector3::new(0.006, -0.007, 0.004);
        }
    }
}

/// The eight postures in which a joint is highest.
fn highest(recording: &Recording, joint: usize) -> Vec<usize> {
    let mut frames: Vec<usize> = (0..recording.frames.len()).collect();
    let at = |f: &usize| recording.frames[*f].commanded[joint];
    frames.sort_by(|a, b| at(b).total_cmp(&at(a)));
    frames.truncate(8);
    frames
}

#[test]
fn pushed_beyond_a_joints_position_it_is_told_with_the_joint() {
    let world = World::new(4, false);
    for seed in [31, 32] {
        let mut recording = recorded(&world, seed);
        let joint = Robot::from_urdf_str(&world.urdf())
            .unwrap()
            .position_names()
            .position(|name| name == "r_elbow")
            .unwrap();
        let frames = highest(&recording, joint);
        push(&mut recording, "r_hand", &frames);
        let told = diagnosed(&world, &recording);
        assert_eq!(told.verdict, Verdict::Unknown, "{} {:#?}", told.sentence, told.trace);
        assert_eq!(told.r#where[0].at, "marker:r_hand", "{:?}", told.r#where);
        assert_eq!(told.r#where[0].depends_on, Some(DependsOn::PositionOf("r_elbow".into())));
        assert!(told.sentence.contains("in 8 of 60 postures"), "{}", told.sentence);
    }
}

#[test]
fn pushed_in_any_postures_it_is_left_out_and_nothing_is_told() {
    let world = World::new(4, false);
    for seed in [33, 34] {
        let mut recording = recorded(&world, seed);
        // By a sequence that has nothing to do with any joint.
        push(&mut recording, "r_hand", &[3, 11, 18, 29, 36, 47, 58]);
        let told = diagnosed(&world, &recording);
        assert_eq!(told.verdict, Verdict::None, "{} {:?}", told.sentence, told.r#where);
        assert_eq!(told.data.left_out.len(), 7, "{:?}", told.data.left_out);
    }
}
