//! Names of several markers exchanged in a cycle, on a tool that a turn of its joint nearly brings onto itself: the names are wrong, and
//! no zero is.

use crate::gap_world::{Plan, World, Wrong};
use mirror_core::diagnose::{DiagnoseOptions, Diagnosis, Recording, Verdict, diagnose};
use mirror_core::robot::Robot;
use nalgebra::Vector3;

/// Three markers around the last joint's axis, a third of a turn apart, to some millimetres.
fn world() -> World {
    let mut world = World::new(5, false);
    let hand = world.bone("r_wrist_1");
    assert_eq!(world.bones[hand].axis, Vector3::z());
    world.markers.retain(|(name, ..)| name != "r_hand");
    for (k, beside) in [0.0, 0.002, -0.0015].into_iter().enumerate() {
        let angle = core::f64::consts::TAU * k as f64 / 3.0;
        let at = Vector3::new(0.05 * angle.cos() + beside, 0.05 * angle.sin(), 0.04 + beside);
        world.markers.push((format!("r_tool_{k}"), hand, at));
    }
    world
}

/// Each of the tool's markers under the name of the next.
fn turn_names(recording: &mut Recording) {
    let tool: Vec<usize> =
        (0..recording.markers.len()).filter(|&m| recording.markers[m].name.starts_with("r_tool")).collect();
    for point in recording.frames.iter_mut().flat_map(|f| &mut f.points) {
        if let Some(k) = tool.iter().position(|&m| m == point.marker) {
            point.marker = tool[(k + 1) % tool.len()];
        }
    }
}

fn diagnosed(wrong: Vec<Wrong>, seed: u64, turned: bool) -> Diagnosis {
    let world = world();
    let mut recording =
        world.record_points(&Plan { postures: 40, views: 1, seed, wrong, ..Plan::default() }, 3e-4);
    if turned {
        turn_names(&mut recording);
    }
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    diagnose(&robot, &recording, &DiagnoseOptions::default(), &[]).unwrap()
}

#[test]
fn names_in_a_cycle_are_exchanges_of_names_alone() {
    for seed in [1, 2] {
        let told = diagnosed(vec![], seed, true);
        assert_eq!(told.verdict, Verdict::Explained, "{} {:#?}", told.sentence, told.trace);
        let effects: Vec<&str> = told.causes.iter().map(|c| c.effect.as_str()).collect();
        assert_eq!(effects, ["markers_swapped"; 2], "{:#?}", told.trace);
    }
}

/// A name may be of a marker that another exchange has moved there: an exchange is of all frames, whatever names they show.
#[test]
fn names_in_a_cycle_are_put_right_in_frames_that_lack_markers_too() {
    let world = world();
    let mut recording =
        world.record_points(&Plan { postures: 40, views: 1, seed: 4, ..Plan::default() }, 3e-4);
    turn_names(&mut recording);
    let tool = recording.markers.len() - 3;
    for (f, frame) in recording.frames.iter_mut().enumerate() {
        // In one of three frames one marker of the tool is left, another one each time.
        frame.points.retain(|p| f % 3 > 0 || p.marker < tool || p.marker == tool + f / 3 % 3);
    }
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let told = diagnose(&robot, &recording, &DiagnoseOptions::default(), &[]).unwrap();
    assert_eq!(told.verdict, Verdict::Explained, "{} {:#?}", told.sentence, told.trace);
    assert!(told.data.left_out.is_empty(), "{:?}", told.data.left_out);
    for cause in &told.causes {
        assert_eq!((cause.effect.as_str(), cause.parameters["share"].value), ("markers_swapped", 1.0));
    }
}

#[test]
fn a_zero_that_is_a_third_of_a_turn_off_is_no_exchange_of_names() {
    let joint = world().bone("r_wrist_1");
    let told = diagnosed(vec![Wrong::Offset(joint, core::f64::consts::TAU / 3.0)], 3, false);
    assert_eq!(told.verdict, Verdict::Explained, "{} {:#?}", told.sentence, told.trace);
    let named: Vec<_> = told.causes.iter().map(|c| (c.effect.as_str(), c.at.as_str())).collect();
    assert_eq!(named, [("joint_offset", "joint:r_wrist_1")], "{:#?}", told.trace);
}
