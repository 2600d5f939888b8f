//! Whole mistakes that show only beside the causes found: they do no more than small errors, or small causes do more than they.

use crate::gap_world::{Plan, World, Wrong};
use mirror_core::diagnose::{Alternative, DiagnoseOptions, Diagnosis, Recording, Target, Verdict, diagnose};
use mirror_core::robot::Robot;

fn robot(world: &World) -> Robot {
    Robot::from_urdf_str(&world.urdf()).unwrap()
}

fn plan(seed: u64, wrong: Vec<Wrong>) -> Plan {
    Plan { postures: 40, seed, wrong, ..Plan::default() }
}

fn run(world: &World, recording: &Recording) -> Diagnosis {
    let diagnosis = diagnose(&robot(world), recording, &DiagnoseOptions::default(), &[]).unwrap();
    assert_eq!(diagnosis.verdict, Verdict::Explained, "{:#?}", diagnosis.trace);
    diagnosis
}

fn assert_named(diagnosis: &Diagnosis, wanted: &[&str]) {
    let mut named: Vec<String> = diagnosis.causes.iter().map(|c| format!("{}@{}", c.effect, c.at)).collect();
    named.sort();
    assert_eq!(named, wanted, "{:#?}", diagnosis.trace);
    assert!(diagnosis.causes.iter().all(|c| c.probability > 0.5), "{:?}", diagnosis.causes);
}

/// Observations of markers that were left out as false.
fn left_out(diagnosis: &Diagnosis) -> usize {
    diagnosis.data.left_out.iter().filter(|l| l.target != "board").count()
}

#[test]
fn a_last_joint_that_stands_still_beside_a_soft_shoulder_is_no_row_of_false_observations() {
    let world = World::new(6, false);
    let soft = Wrong::Compliance(world.bone("l_shoulder_roll"), 0.03);
    let held = Wrong::Held(world.bone("r_wrist_2"), 29, 56);
    let recording = world.record(&plan(61, vec![soft, held]));
    let diagnosis = run(&world, &recording);
    assert_named(&diagnosis, &["joint_compliance@joint:l_shoulder_roll", "joint_frozen@joint:r_wrist_2"]);
    assert!(left_out(&diagnosis) < 3, "{:?}", diagnosis.data.left_out);
}

#[test]
fn names_exchanged_in_a_few_frames_beside_another_print_are_named_and_not_left_out() {
    let world = World::new(4, false);
    let mut recording = world.record(&plan(62, vec![Wrong::BoardScale(-0.25)]));
    let exchanged = [7, 21, 40, 58, 73];
    for &f in &exchanged {
        for sighting in &mut recording.frames[f].sightings {
            match &mut sighting.target {
                Target::Marker(m) if *m == 1 => *m = 4,
                Target::Marker(m) if *m == 4 => *m = 1,
                _ => {}
            }
        }
    }
    let diagnosis = run(&world, &recording);
    assert_named(&diagnosis, &["board_scale@board", "markers_swapped@marker:l_fore<->marker:r_fore"]);
    let told = diagnosis.causes.iter().find(|c| c.effect == "markers_swapped").unwrap();
    assert_eq!(told.frames, exchanged.map(|f| recording.frames[f].number));
    assert_eq!(left_out(&diagnosis), 0);
}

#[test]
fn a_camera_that_slips_so_far_that_no_mirror_fits_its_boards_has_slipped() {
    let world = World::new(4, false);
    let wrong = || vec![Wrong::Offset(world.bone("r_elbow"), 0.03)];
    let mut recording = world.record(&plan(63, wrong()));
    let motion = [0.025, -0.02, 0.04, 0.004, 0.003, -0.005];
    let moved = world.record(&plan(63, wrong().into_iter().chain([Wrong::CameraMount(motion)]).collect()));
    let first = 50;
    for (frame, seen) in recording.frames.iter_mut().zip(moved.frames).skip(first) {
        frame.sightings = seen.sightings;
    }
    let diagnosis = run(&world, &recording);
    assert_named(&diagnosis, &["joint_offset@joint:r_elbow", "slip@camera"]);
    let slip = &diagnosis.causes.iter().find(|c| c.effect == "slip").unwrap().parameters;
    assert!((slip["first_frame"].value - first as f64).abs() < 0.5, "{slip:?}");
    assert!(diagnosis.data.frames_used >= recording.frames.len() - 2, "{:?}", diagnosis.data.frames_used);
}

#[test]
fn a_ratio_of_the_last_joint_that_is_half_as_large_again_is_one_cause_beside_a_link() {
    let world = World::new(6, false);
    let length = Wrong::Length(Some(world.bone("l_shoulder_yaw")), [0.006, 0.0, -0.007]);
    let mut recording = world.record(&plan(64, vec![length]));
    let wrist = robot(&world).position_index("r_wrist_2").unwrap();
    recording.frames.iter_mut().for_each(|f| f.commanded[wrist] /= 1.5);
    let diagnosis = run(&world, &recording);
    let of_wrist: Vec<_> = diagnosis.causes.iter().filter(|c| c.at == "joint:r_wrist_2").collect();
    assert_eq!(of_wrist.len(), 1, "{:?}", diagnosis.causes);
    let ratio = of_wrist[0].parameters["scale_error"];
    assert!(of_wrist[0].effect == "gear_ratio" && (ratio.value - 0.5).abs() < 0.03, "{ratio:?}");
}

#[test]
fn zeros_at_both_ends_of_a_link_take_their_share_of_its_length() {
    // About parallel axes, in opposite directions, and with no marker on the link itself: they shift the hand as its length does.
    let mut world = World::new(5, false);
    let (elbow, wrist) = (world.bone("r_elbow"), world.bone("r_wrist_1"));
    world.bones[wrist].axis = world.bones[elbow].axis;
    world.markers[4].1 = world.bone("r_shoulder_yaw");
    let told = |wrong: Vec<Wrong>| {
        let recording = world.record(&Plan { postures: 50, seed: 61, wrong, ..Plan::default() });
        run(&world, &recording)
    };
    let zeros = told(vec![Wrong::Offset(elbow, 0.02), Wrong::Offset(wrist, -0.02)]);
    let link = zeros.causes.iter().find(|c| c.effect == "link_length").unwrap();
    let instead = |a: &Alternative| (a.effect.as_str(), a.at.as_str()) == ("joint_offset", "joint:r_elbow");
    let instead = link.alternatives.iter().find(|a| instead(a)).unwrap().probability;
    assert!(link.probability < 0.9 && instead > 0.1, "{link:?} {:#?}", zeros.trace);
    // Along the link no zeros shift it.
    let length = told(vec![Wrong::Length(Some(elbow), [0.004, 0.0, 0.0])]);
    let link = &length.causes[0];
    assert!(link.effect == "link_length" && link.probability > 0.9, "{link:?} {:#?}", length.trace);
}
