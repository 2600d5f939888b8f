//! Sessions whose board, camera and markers were mounted by hand: the cause is named all the same, and the set-up is told as set-up.

use crate::gap_world::{Plan, World, Wrong, draws};
use mirror_core::camera::Camera;
use mirror_core::diagnose::{Cause, DiagnoseOptions, Diagnosis, Recording, Tolerance, diagnose};
use mirror_core::robot::Robot;
use nalgebra::{Rotation3, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Where the URDF has the board too far along x, y and z of the base, m.
const BOARD_OFF_M: [f64; 3] = [0.003, -0.004, 0.0025];
/// Joints' zeros of a robot that was put together with care, rad.
const ZEROS_RAD: f64 = 0.0026;

/// The world's URDF with the board elsewhere.
fn urdf_with_the_board_off(world: &World) -> String {
    let urdf = world.urdf();
    let at = urdf.find("board_fixed").unwrap();
    let start = at + urdf[at..].find("xyz=\"").unwrap() + 5;
    let end = start + urdf[start..].find('"').unwrap();
    let numbers: Vec<f64> = urdf[start..end].split(' ').map(|n| n.parse().unwrap()).collect();
    let moved: Vec<String> = numbers.iter().zip(BOARD_OFF_M).map(|(n, d)| (n + d).to_string()).collect();
    format!("{}{}{}", &urdf[..start], moved.join(" "), &urdf[end..])
}

/// Camera, markers and the joints' zeros a little off.
fn mounted_by_hand(world: &World, seed: u64) -> Vec<Wrong> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut some = |size: f64| random.random_range(-1.7 * size..1.7 * size);
    let mut wrong = vec![Wrong::CameraMount([
        some(0.015),
        some(0.015),
        some(0.015),
        some(0.003),
        some(0.003),
        some(0.003),
    ])];
    wrong.extend((0..world.markers.len()).map(|m| Wrong::Mount(m, [some(0.002), some(0.002), some(0.002)])));
    wrong.extend((0..world.bones.len()).map(|b| Wrong::Offset(b, some(ZEROS_RAD))));
    wrong
}

/// A session mounted by hand, with a further cause.
fn by_hand(seed: u64, cause: Option<Wrong>) -> Diagnosis {
    by_hand_as_told(seed, cause, |_| ())
}

/// The same, with something told otherwise than it was.
fn by_hand_as_told(seed: u64, cause: Option<Wrong>, tell: impl Fn(&mut Recording)) -> Diagnosis {
    let world = World::new(4, false);
    let mut wrong: Vec<Wrong> = cause.into_iter().collect();
    wrong.extend(mounted_by_hand(&world, seed));
    let mut recording = world.record(&Plan { postures: 50, seed, wrong, ..Plan::default() });
    tell(&mut recording);
    let robot = Robot::from_urdf_str(&urdf_with_the_board_off(&world)).unwrap();
    diagnose(&robot, &recording, &DiagnoseOptions::default(), &[]).unwrap()
}

fn of_robot(diagnosis: &Diagnosis) -> Vec<&Cause> {
    diagnosis.causes.iter().filter(|c| c.kind != "setup" && c.effect != "geometry").collect()
}

fn names(diagnosis: &Diagnosis) -> Vec<String> {
    diagnosis.causes.iter().map(|c| format!("{}@{}", c.effect, c.at)).collect()
}

#[test]
fn a_set_up_by_hand_is_told_as_set_up_and_never_as_the_robots_fault() {
    let found = by_hand(3, None);
    assert!(of_robot(&found).is_empty(), "{:?} {:#?}", names(&found), found.trace);
    let board = found.causes.iter().find(|c| c.effect == "board_mount").unwrap();
    assert_eq!((board.at.as_str(), board.kind.as_str()), ("board", "setup"));
    // The real board lies where the URDF has it less the shift, in the board's own frame.
    let quarter = core::f64::consts::FRAC_PI_2;
    let base_from_board = Rotation3::from_euler_angles(quarter, 0.0, quarter);
    let truth = base_from_board.inverse() * -Vector3::from(BOARD_OFF_M);
    for (name, value) in ["dx_m", "dy_m", "dz_m"].into_iter().zip(truth.iter()) {
        let told = board.parameters[name];
        assert!((told.value - value).abs() < 4.0 * told.std, "{name}: {told:?}, {value}");
        assert!(told.std < 1.5e-3, "{name}: {told:?}");
    }
    let markers = found.causes.iter().filter(|c| c.effect == "marker_mount").count();
    assert!(markers >= 4, "{:?}", names(&found));
}

#[test]
fn a_cause_is_named_beside_a_set_up_by_hand() {
    let world = World::new(4, false);
    let causes = [
        (
            Wrong::Length(Some(world.bone("l_shoulder_yaw")), [0.006, 0.0, -0.005]),
            "link_length",
            "link:l_shoulder_yaw_link",
        ),
        (
            Wrong::Compliance(world.bone("r_shoulder_pitch"), 0.01),
            "joint_compliance",
            "joint:r_shoulder_pitch",
        ),
        (Wrong::Focal(0.02), "camera_focal", "camera"),
    ];
    for (seed, (wrong, effect, at)) in (11..).zip(causes) {
        let found = by_hand(seed, Some(wrong));
        let told: Vec<_> = of_robot(&found).iter().map(|c| (c.effect.as_str(), c.at.as_str())).collect();
        assert_eq!(told, [(effect, at)], "{:?} {:#?}", names(&found), found.trace);
    }
}

/// An elbow's zero moves the two markers of the last link as two mounts can: which it was, no posture tells. What decides is by how much
/// the mounts may be off.
fn as_an_elbow_would_move_them(stated_m: f64) -> Diagnosis {
    let world = World::new(4, false);
    let elbow_rad = 0.015;
    let beyond = |m: &usize| world.bones[world.markers[*m].1].name == "r_elbow";
    // The arc about y through the marker, as far as it is a straight line.
    let moved = |m: usize| {
        Wrong::Mount(m, [elbow_rad * world.markers[m].2.z, 0.0, -elbow_rad * world.markers[m].2.x])
    };
    let wrong: Vec<Wrong> = (0..world.markers.len()).filter(beyond).map(moved).collect();
    assert_eq!(wrong.len(), 2);
    let mut recording = world.record(&Plan { postures: 40, wrong, ..Plan::default() });
    let stated = Tolerance { shift_m: Some(stated_m), turn_rad: None };
    recording.tolerances.markers = vec![stated; world.markers.len()];
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    diagnose(&robot, &recording, &DiagnoseOptions::default(), &[]).unwrap()
}

#[test]
fn mounts_within_their_stated_tolerance_are_told_beside_the_joint_that_they_imitate() {
    let found = as_an_elbow_would_move_them(0.003);
    for cause in of_robot(&found) {
        assert!(cause.probability < 0.8, "{} {}", cause.effect, cause.probability);
        assert!(cause.alternatives.iter().any(|a| a.effect == "marker_mount"), "{:?}", cause.alternatives);
    }
    // Where the mounts are known to a tenth of that it was the joint.
    let found = as_an_elbow_would_move_them(0.0003);
    let causes = of_robot(&found);
    assert_eq!(causes.len(), 1, "{:?}", names(&found));
    assert_eq!(causes[0].at, "joint:r_elbow");
    assert!(
        causes[0].alternatives.iter().all(|a| a.effect != "marker_mount"),
        "{:?}",
        causes[0].alternatives
    );
}

/// Without mounts free no spring shows that gravity is upside down; couplings and eccentric gears took its place.
#[test]
fn gravity_upside_down_is_told_where_parts_are_mounted_by_hand() {
    for seed in draws(1, [5, 6]) {
        let world = World::new(4, false);
        let spring = Wrong::Compliance(world.bone("r_shoulder_pitch"), 0.05);
        let found = by_hand_as_told(seed, Some(spring), |r| r.gravity = -r.gravity);
        let told: Vec<String> = of_robot(&found).iter().map(|c| format!("{}@{}", c.effect, c.at)).collect();
        assert!(told.contains(&"gravity_direction@robot".to_owned()), "{seed}: {told:?} {:#?}", found.trace);
        assert!(told.contains(&"joint_compliance@joint:r_shoulder_pitch".to_owned()), "{seed}: {told:?}");
        assert_eq!(told.len(), 2, "{seed}: {told:?}");
    }
    let found = by_hand(5, None);
    assert!(found.causes.iter().all(|c| c.effect != "gravity_direction"), "{:?}", names(&found));
}

/// The first estimate of a slip, beside mounts that are not known yet, is a little off. Held there, that error was told as a length of the
/// base, which the board's mount cancels; and with a noise that is stated too small a slip of the camera was not told at all.
#[test]
fn what_slips_is_told_with_its_motion_beside_a_set_up_by_hand() {
    let board = [0.028, 0.0, 0.004, 0.003, -0.0015, -0.004];
    let camera = [-0.016, -0.002, -0.005, -0.005, -0.002, -0.008];
    let first = 45;
    for (seed, what, motion) in
        draws(2, [(21, "board", board), (22, "camera", camera), (23, "board", camera)])
    {
        let world = World::new(4, true);
        let before = mounted_by_hand(&world, seed);
        let mut after = before.clone();
        if what == "board" {
            after.push(Wrong::BoardMount(motion));
        } else if let Wrong::CameraMount(mount) = &mut after[0] {
            mount.iter_mut().zip(motion).for_each(|(m, d)| *m += d);
        }
        let record =
            |wrong| world.record(&Plan { postures: 60, seed, noise_px: 0.28, wrong, ..Plan::default() });
        let (mut recording, slipped) = (record(before), record(after));
        for (frame, later) in recording.frames.iter_mut().zip(&slipped.frames).skip(first) {
            frame.sightings.clone_from(&later.sightings);
        }
        recording.pixel_std_px = Some(0.16);
        let robot = Robot::from_urdf_str(&urdf_with_the_board_off(&world)).unwrap();
        let found = diagnose(&robot, &recording, &DiagnoseOptions::default(), &[]).unwrap();
        assert!(of_robot(&found).is_empty(), "{seed}: {:?} {:#?}", names(&found), found.trace);
        let slip = found.causes.iter().find(|c| c.effect == "slip").unwrap();
        assert_eq!((slip.at.as_str(), slip.parameters["first_frame"].value), (what, first as f64));
        for (name, want) in ["rx_rad", "ry_rad", "rz_rad", "dx_m", "dy_m", "dz_m"].iter().zip(motion) {
            let got = slip.parameters[*name];
            assert!((got.value - want).abs() < 4.0 * got.std + 4e-4, "{seed} {name}: {got:?}, put in {want}");
            assert!(got.std < 4e-3, "{seed} {name}: {got:?}");
        }
    }
}

/// Every row of some columns becomes a mixture with the row before: rows of one posture differ then.
fn late_by(recording: &mut Recording, share: f64, is_late: impl Fn(usize) -> bool) {
    recording.frames.iter_mut().enumerate().for_each(|(row, frame)| frame.posture = row as i64);
    let logged: Vec<Vec<f64>> = recording.frames.iter().map(|f| f.commanded.clone()).collect();
    for (frame, before) in recording.frames.iter_mut().skip(1).zip(&logged) {
        for (joint, (own, earlier)) in frame.commanded.iter_mut().zip(before).enumerate() {
            if is_late(joint) {
                *own += share * (earlier - *own);
            }
        }
    }
}

/// Mounts are as large as such mistakes: these were told as a column without any relation to its joint, or not at all.
#[test]
fn mistakes_of_columns_are_named_beside_a_set_up_by_hand() {
    let world = World::new(4, false);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let index = |name: &str| robot.position_index(name).unwrap();
    let elbow = index("l_elbow");
    let (late_elbow, late_clock) =
        (|r: &mut Recording| late_by(r, 0.36, |j| j == elbow), |r: &mut Recording| late_by(r, 0.9, |_| true));
    let other_way = |r: &mut Recording| {
        r.frames.iter_mut().for_each(|f| f.commanded[elbow] = -f.commanded[elbow]);
    };
    type Told<'a> = (&'a dyn Fn(&mut Recording), &'a str);
    let cases: [Told<'_>; 3] = [
        (&late_elbow, "joint_late@joint:l_elbow"),
        (&late_clock, "joint_late@robot"),
        (&other_way, "axis_sign@joint:l_elbow"),
    ];
    for (tell, want) in cases {
        // With less care: the camera twice as far off, and the board turned.
        let mut wrong = mounted_by_hand(&world, 31);
        if let Wrong::CameraMount(mount) = &mut wrong[0] {
            mount.iter_mut().for_each(|m| *m *= 2.0);
        }
        wrong.push(Wrong::BoardMount([-0.038, -0.021, 0.024, 0.003, 0.006, -0.002]));
        let mut recording = world.record(&Plan { postures: 50, seed: 31, wrong, ..Plan::default() });
        tell(&mut recording);
        let found = diagnose(&robot, &recording, &DiagnoseOptions::default(), &[]).unwrap();
        let told: Vec<String> = of_robot(&found).iter().map(|c| format!("{}@{}", c.effect, c.at)).collect();
        assert_eq!(told, [want], "{:?} {:#?}", names(&found), found.trace);
        let step_s = recording.frames[1].time_s - recording.frames[0].time_s;
        let rows = [0.36, 0.9][usize::from(want == "joint_late@robot")];
        if let Some(delay) = of_robot(&found)[0].parameters.get("delay_s") {
            assert!((delay.value - rows * step_s).abs() < 4.0 * delay.std, "{want}: {delay:?}");
            assert!(delay.std < 0.01 * step_s, "{want}: {delay:?}");
        } else {
            assert!(want.starts_with("axis_sign"), "{want} has no delay");
        }
    }
}

/// A camera that is askew shifts the picture, and so does its centre at a neighbouring resolution.
#[test]
fn the_resolution_of_a_camera_file_is_exact_beside_mounts_by_hand() {
    let world = World::new(4, false);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    for (seed, factor) in draws(2, [(41, 0.5), (43, 1.25), (42, 0.75), (44, 1.6), (45, 2.0), (46, 0.8)]) {
        let mut wrong = mounted_by_hand(&world, seed);
        if let Wrong::CameraMount(mount) = &mut wrong[0] {
            mount.iter_mut().for_each(|m| *m *= 2.0);
        }
        wrong.push(Wrong::BoardMount([-0.01, 0.02, 0.03, 0.003, 0.002, -0.002]));
        let mut recording = world.record(&Plan { postures: 50, seed, wrong, ..Plan::default() });
        let sight = recording.sight.as_mut().unwrap();
        let (right, told) = (&sight.camera, 1.0 / factor);
        // Whole numbers are the pixels' centres.
        let center = (right.center_px().add_scalar(0.5) * told).add_scalar(-0.5);
        sight.camera =
            Camera::new(right.size_px(), right.focal_px() * told, center, right.distortion()).unwrap();
        let found = diagnose(&robot, &recording, &DiagnoseOptions::default(), &[]).unwrap();
        let told: Vec<String> = of_robot(&found).iter().map(|c| format!("{}@{}", c.effect, c.at)).collect();
        assert_eq!(told, ["camera_resolution@camera"], "{factor}: {:?} {:#?}", names(&found), found.trace);
        let cause = found.causes.iter().find(|c| c.effect == "camera_resolution").unwrap();
        assert!((cause.parameters["factor"].value - factor).abs() < 1e-9, "{factor}: {cause:?}");
    }
}

/// With the mounts as modelled further markers seem to be on other links too.
#[test]
fn a_marker_on_another_link_is_named_beside_mounts_by_hand() {
    let mut real = World::new(5, false);
    let robot = Robot::from_urdf_str(&real.urdf()).unwrap();
    let hand = real.markers.iter().position(|m| m.0 == "l_hand").unwrap();
    real.markers[hand].1 = real.bone("l_elbow");
    for seed in draws(1, [51, 52]) {
        let mut wrong = mounted_by_hand(&real, seed);
        if let Wrong::CameraMount(mount) = &mut wrong[0] {
            mount.iter_mut().for_each(|m| *m *= 2.0);
        }
        wrong.push(Wrong::BoardMount([0.011, 0.004, -0.033, -0.002, 0.003, -0.005]));
        let recording = real.record(&Plan { postures: 50, seed, wrong, ..Plan::default() });
        let found = diagnose(&robot, &recording, &DiagnoseOptions::default(), &[]).unwrap();
        assert!(of_robot(&found).is_empty(), "{:?}", names(&found));
        let told = names(&found);
        assert!(told.iter().any(|t| t == "marker_parent@marker:l_hand<-link:l_elbow_link"), "{told:?}");
    }
}
