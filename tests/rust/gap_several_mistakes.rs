//! Whole mistakes beside others and beside small causes: all are named, and nothing that makes up for one of them.

use crate::gap_first_day::{robot, run, world};
use crate::gap_world::{Plan, World, Wrong};
use mirror_core::camera::Camera;
use mirror_core::diagnose::{Diagnosis, Target};

fn plan(seed: u64, wrong: Vec<Wrong>) -> Plan {
    Plan { postures: 40, seed, wrong, ..Plan::default() }
}

fn named(diagnosis: &Diagnosis) -> Vec<String> {
    let mut out: Vec<String> = diagnosis.causes.iter().map(|c| format!("{}@{}", c.effect, c.at)).collect();
    out.sort();
    out
}

fn assert_near(diagnosis: &Diagnosis, effect: &str, parameter: &str, want: f64, within: f64) {
    let cause = diagnosis.causes.iter().find(|c| c.effect == effect).unwrap();
    let got = cause.parameters[parameter];
    assert!((got.value - want).abs() < within, "{effect} {parameter}: {got:?}, put in {want}");
}

#[test]
fn a_board_of_another_print_beside_exchanged_columns_is_no_marker_elsewhere() {
    let world = world();
    let mut recording = world.record(&plan(41, vec![Wrong::BoardScale(0.1)]));
    let column = |name: &str| robot(&world).position_index(name).unwrap();
    let (a, b) = (column("r_shoulder_pitch"), column("r_elbow"));
    recording.frames.iter_mut().for_each(|f| f.commanded.swap(a, b));
    let diagnosis = run(&world, &recording);
    let wanted = ["board_scale@board", "joints_swapped@joint:r_shoulder_pitch<->joint:r_elbow"];
    assert_eq!(named(&diagnosis), wanted, "{:?}", diagnosis.trace);
    assert_near(&diagnosis, "board_scale", "scale_error", 0.1, 0.003);
}

#[test]
fn a_camera_of_three_quarters_beside_a_gear_is_no_focal_length_and_centre() {
    let world = world();
    let mut recording = world.record(&plan(42, vec![Wrong::Ratio(world.bone("l_elbow"), 0.04)]));
    let sight = recording.sight.as_mut().unwrap();
    let c = &sight.camera;
    let factor = 4.0 / 3.0;
    sight.camera =
        Camera::new((800, 600), c.focal_px() * factor, c.center_px() * factor, c.distortion()).unwrap();
    let diagnosis = run(&world, &recording);
    assert_eq!(named(&diagnosis), ["camera_resolution@camera", "gear_ratio@joint:l_elbow"]);
    assert_near(&diagnosis, "camera_resolution", "factor", 0.75, 1e-12);
    assert_near(&diagnosis, "gear_ratio", "scale_error", 0.04, 0.005);
}

#[test]
fn a_board_that_slips_beside_a_gear_leaves_nothing_for_others_to_make_up() {
    let world = world();
    let gear = || Wrong::Ratio(world.bone("r_shoulder_pitch"), 0.03);
    let motion = [0.003, -0.003, 0.017, -0.0006, -0.0037, -0.0023];
    let mut recording = world.record(&plan(43, vec![gear()]));
    let after = world.record(&plan(43, vec![gear(), Wrong::BoardMount(motion)]));
    let first = 50;
    for (frame, moved) in recording.frames.iter_mut().zip(&after.frames).skip(first) {
        frame.sightings.clone_from(&moved.sightings);
    }
    let diagnosis = run(&world, &recording);
    assert_eq!(named(&diagnosis), ["gear_ratio@joint:r_shoulder_pitch", "slip@board"]);
    assert_near(&diagnosis, "slip", "first_frame", first as f64, 0.5);
    let slip = diagnosis.causes.iter().find(|c| c.effect == "slip").unwrap();
    for (k, name) in ["rx_rad", "ry_rad", "rz_rad", "dx_m", "dy_m", "dz_m"].into_iter().enumerate() {
        let got = slip.parameters[name];
        assert!((got.value - motion[k]).abs() < 4.0 * got.std, "{name}: {got:?}, put in {}", motion[k]);
        assert!(got.std < 2.5e-3, "{name}: {got:?}");
    }
}

#[test]
fn a_marker_on_another_link_before_a_cropped_camera_is_placed_once() {
    let real = world();
    let recording = real.record(&plan(44, vec![Wrong::Center(60.0, -40.0)]));
    let mut believed = world();
    believed.markers[4].1 = believed.bone("r_shoulder_yaw");
    let diagnosis = run(&believed, &recording);
    let causes = named(&diagnosis);
    assert!(causes.contains(&"marker_parent@marker:r_fore<-link:r_elbow_link".to_owned()), "{causes:?}");
    assert!(causes.iter().any(|c| c.ends_with("@camera")) && causes.len() == 2, "{causes:?}");
    for (name, axis) in [("dx_m", 0), ("dy_m", 1), ("dz_m", 2)] {
        assert_near(&diagnosis, "marker_parent", name, real.markers[4].2[axis], 2e-3);
    }
}

#[test]
fn a_clock_that_is_late_by_half_a_row_of_three_is_no_exchange_of_rows() {
    let world = world();
    let mut recording = world.record(&Plan { views: 3, ..plan(45, Vec::new()) });
    recording.frames.iter_mut().enumerate().for_each(|(row, frame)| frame.posture = row as i64);
    let old: Vec<Vec<f64>> = recording.frames.iter().map(|f| f.commanded.clone()).collect();
    let part = 0.54;
    for f in 1..old.len() {
        let both = old[f].iter().zip(&old[f - 1]);
        recording.frames[f].commanded =
            both.map(|(now, before)| (1.0 - part) * now + part * before).collect();
    }
    let diagnosis = run(&world, &recording);
    assert_eq!(named(&diagnosis), ["joint_late@robot"], "{:?}", diagnosis.trace);
    // A row a second.
    assert_near(&diagnosis, "joint_late", "delay_s", part, 0.005);
}

#[test]
fn a_right_angle_beside_a_link_that_is_too_long_leaves_no_play() {
    let world = world();
    let wrong = vec![Wrong::Length(Some(world.bone("l_shoulder_pitch")), [0.0, -0.0015, 0.0])];
    let mut recording = world.record(&plan(46, wrong));
    let elbow = robot(&world).position_index("l_elbow").unwrap();
    let right_angle = core::f64::consts::FRAC_PI_2;
    recording.frames.iter_mut().for_each(|f| f.commanded[elbow] += right_angle);
    let diagnosis = run(&world, &recording);
    let causes = named(&diagnosis);
    assert_eq!(causes.iter().filter(|c| c.ends_with("@joint:l_elbow")).count(), 1, "{causes:?}");
    let zero = diagnosis.causes.iter().find(|c| c.effect == "joint_offset").unwrap().parameters["offset_rad"];
    assert!((zero.value + right_angle).abs() < 4.0 * zero.std && zero.std < 2e-3, "{zero:?}");
}

#[test]
fn a_marker_on_a_link_whose_joint_moves_no_other_is_named_beside_a_gear() {
    let real = World::new(5, false);
    let wrong = vec![Wrong::Ratio(real.bone("l_elbow"), 0.04)];
    let recording = real.record(&plan(47, wrong));
    // The believed robot's last joint moves no marker at all.
    let mut believed = World::new(5, false);
    believed.markers[5].1 = believed.bone("r_elbow");
    let diagnosis = run(&believed, &recording);
    let wanted = ["gear_ratio@joint:l_elbow", "marker_parent@marker:r_hand<-link:r_wrist_1_link"];
    assert_eq!(named(&diagnosis), wanted, "{:?}", diagnosis.trace);
}

#[test]
fn a_right_angle_at_a_last_joint_is_told_before_the_mount_that_moves_its_marker_alike() {
    let mut world = World::new(5, false);
    world.markers[2].2 = [0.018, 0.004, 0.03].into();
    let mut recording = world.record(&plan(48, Vec::new()));
    let wrist = robot(&world).position_index("l_wrist_1").unwrap();
    let right_angle = core::f64::consts::FRAC_PI_2;
    recording.frames.iter_mut().for_each(|f| f.commanded[wrist] += right_angle);
    let diagnosis = run(&world, &recording);
    assert_eq!(named(&diagnosis), ["joint_offset@joint:l_wrist_1"], "{:?}", diagnosis.trace);
    assert_near(&diagnosis, "joint_offset", "offset_rad", -right_angle, 0.01);
}

#[test]
fn a_right_angle_at_a_last_joint_is_told_beside_exchanged_columns_too() {
    let mut world = World::new(5, false);
    world.markers[2].2 = [0.012, 0.004, 0.03].into();
    let mut recording = world.record(&plan(51, Vec::new()));
    let column = |name: &str| robot(&world).position_index(name).unwrap();
    let (wrist, a, b) = (column("l_wrist_1"), column("r_elbow"), column("r_shoulder_yaw"));
    let right_angle = core::f64::consts::FRAC_PI_2;
    for frame in &mut recording.frames {
        frame.commanded[wrist] += right_angle;
        frame.commanded.swap(a, b);
    }
    let diagnosis = run(&world, &recording);
    let causes = named(&diagnosis);
    let zero = causes.contains(&"joint_offset@joint:l_wrist_1".to_owned());
    assert!(
        zero && causes.len() == 2 && causes[1].starts_with("joints_swapped"),
        "{causes:?} {:?}",
        diagnosis.trace
    );
    assert_near(&diagnosis, "joint_offset", "offset_rad", -right_angle, 0.01);
}

#[test]
fn exchanged_names_before_a_camera_of_another_crop_are_no_marker_elsewhere() {
    // On a neck: the boards tell the crop from a camera mounted askew.
    let world = World::new(4, true);
    let mut recording = world.record(&plan(49, vec![Wrong::Center(-70.0, -45.0)]));
    let (a, b) = (1, 2);
    for sighting in recording.frames.iter_mut().flat_map(|f| &mut f.sightings) {
        if let Target::Marker(m) = &mut sighting.target {
            *m = if *m == a {
                b
            } else if *m == b {
                a
            } else {
                *m
            };
        }
    }
    let diagnosis = run(&world, &recording);
    let swapped = format!("markers_swapped@marker:{}<->marker:{}", world.markers[a].0, world.markers[b].0);
    assert_eq!(named(&diagnosis), ["camera_resolution@camera".to_owned(), swapped], "{:?}", diagnosis.trace);
    for (name, px) in [("du_px", -70.0), ("dv_px", -45.0)] {
        let told =
            diagnosis.causes.iter().find(|c| c.effect == "camera_resolution").unwrap().parameters[name];
        assert!((told.value - px).abs() < 4.0 * told.std && told.std < 1.0, "{name}: {told:?}");
    }
}

#[test]
fn pictures_that_are_mirrored_and_cropped_are_both() {
    let world = world();
    let mut recording = world.record(&plan(50, vec![Wrong::Center(60.0, 50.0)]));
    for sighting in recording.frames.iter_mut().flat_map(|f| &mut f.sightings) {
        sighting.pixel.x = 799.0 - sighting.pixel.x;
    }
    let diagnosis = run(&world, &recording);
    let causes = named(&diagnosis);
    assert!(causes.contains(&"picture_flipped@camera".to_owned()) && causes.len() == 2, "{causes:?}");
    assert!(causes[0].starts_with("camera_"), "{causes:?}");
}

#[test]
fn names_exchanged_in_a_few_frames_are_named_beside_a_late_column() {
    let world = world();
    let mut recording = world.record(&Plan { postures: 160, views: 1, ..plan(51, Vec::new()) });
    let column = robot(&world).position_index("l_elbow").unwrap();
    let old: Vec<f64> = recording.frames.iter().map(|f| f.commanded[column]).collect();
    for f in 2..old.len() {
        recording.frames[f].commanded[column] = old[f - 2];
    }
    let (a, b) = (1, 4);
    // Mistakes are weighed on one frame of a few: these are nearly all of the others.
    for frame in recording.frames.iter_mut().skip(3).step_by(16) {
        for sighting in &mut frame.sightings {
            if let Target::Marker(m) = &mut sighting.target {
                *m = if *m == a {
                    b
                } else if *m == b {
                    a
                } else {
                    *m
                };
            }
        }
    }
    let diagnosis = run(&world, &recording);
    let causes = named(&diagnosis);
    assert_eq!(causes.len(), 2, "{causes:?} {:?}", diagnosis.trace);
    assert!(
        causes[0] == "joint_late@joint:l_elbow" && causes[1].starts_with("markers_swapped@"),
        "{causes:?}"
    );
}

#[test]
fn the_names_of_three_markers_in_a_circle_are_two_exchanges_and_no_other_link() {
    let world = world();
    // Both ways round: their order counts.
    for circle in [[0, 1, 2], [2, 1, 0]] {
        let mut recording = world.record(&plan(61, Vec::new()));
        for s in recording.frames.iter_mut().flat_map(|f| &mut f.sightings) {
            if let Target::Marker(m) = &mut s.target
                && let Some(i) = circle.iter().position(|c| c == m)
            {
                *m = circle[(i + 1) % 3];
            }
        }
        let diagnosis = run(&world, &recording);
        let causes = named(&diagnosis);
        assert_eq!(causes.len(), 2, "{causes:?} {:?}", diagnosis.trace);
        assert!(causes.iter().all(|c| c.starts_with("markers_swapped@")), "{causes:?}");
        assert!(diagnosis.data.left_out.is_empty(), "{:?}", diagnosis.data.left_out);
        assert!(diagnosis.gap.after_px.unwrap() < 1.2 * diagnosis.gap.noise_floor_px.unwrap());
    }
}

#[test]
fn columns_that_are_all_one_place_further_are_put_back() {
    let world = world();
    let columns: Vec<usize> = (0..recording_columns(&world)).collect();
    for back in [false, true] {
        let mut recording = world.record(&plan(62, Vec::new()));
        for frame in &mut recording.frames {
            if back { frame.commanded.rotate_left(1) } else { frame.commanded.rotate_right(1) }
        }
        let diagnosis = run(&world, &recording);
        let causes = named(&diagnosis);
        assert_eq!(causes.len(), columns.len() - 1, "{causes:?} {:?}", diagnosis.trace);
        assert!(causes.iter().all(|c| c.starts_with("joints_swapped@")), "{causes:?}");
        assert!(diagnosis.gap.after_px.unwrap() < 1.2 * diagnosis.gap.noise_floor_px.unwrap());
    }
}

fn recording_columns(world: &World) -> usize {
    world.record(&plan(62, Vec::new())).frames[0].commanded.len()
}

#[test]
fn a_camera_that_hangs_is_named_with_its_rows_and_a_posture_that_is_held_is_none() {
    let world = world();
    let mut recording = world.record(&plan(63, Vec::new()));
    let (first, last) = (40, 71);
    let picture = recording.frames[first - 1].sightings.clone();
    recording.frames[first..=last].iter_mut().for_each(|f| f.sightings.clone_from(&picture));
    let diagnosis = run(&world, &recording);
    assert_eq!(named(&diagnosis), ["pairing@data"], "{:?}", diagnosis.trace);
    assert_near(&diagnosis, "pairing", "first_frame", 40.0, 0.5);
    assert_near(&diagnosis, "pairing", "last_frame", 71.0, 0.5);
    let why: Vec<String> = diagnosis.data.left_out.iter().map(|l| l.why.to_string()).collect();
    assert!(!why.is_empty() && why.iter().all(|w| w.contains("to the last digit")), "{why:?}");
    // The same picture of one posture that is held is nothing wrong.
    let mut held = world.record(&plan(63, Vec::new()));
    let (picture, row) = (held.frames[first - 1].sightings.clone(), held.frames[first - 1].commanded.clone());
    for frame in &mut held.frames[first..=last] {
        (frame.sightings, frame.commanded) = (picture.clone(), row.clone());
    }
    assert!(named(&run(&world, &held)).is_empty());
}

/// Free places on other links make up for a part of what the camera's file has wrong.
#[test]
fn exchanged_names_beside_a_camera_of_another_resolution_are_no_markers_on_other_links() {
    let world = world();
    let mut recording = world.record(&plan(60, Vec::new()));
    let sight = recording.sight.as_mut().unwrap();
    let c = &sight.camera;
    sight.camera = Camera::new(c.size_px(), c.focal_px() / 2.0, c.center_px() / 2.0, c.distortion()).unwrap();
    let (a, b) = (3, 4);
    for sighting in recording.frames.iter_mut().flat_map(|f| &mut f.sightings) {
        sighting.target = match sighting.target {
            Target::Marker(m) if m == a => Target::Marker(b),
            Target::Marker(m) if m == b => Target::Marker(a),
            other => other,
        };
    }
    let diagnosis = run(&world, &recording);
    let wanted = ["camera_resolution@camera", "markers_swapped@marker:r_upper<->marker:r_fore"];
    assert_eq!(named(&diagnosis), wanted, "{:?}", diagnosis.trace);
    assert_near(&diagnosis, "camera_resolution", "factor", 2.0, 1e-12);
}

/// Mirrored pictures show no board that a mirror explains, so that nothing is compared before: no number says how much that is, and
/// all the gap lies there.
#[test]
fn a_mistake_without_which_nothing_is_compared_comes_first_and_has_the_gap() {
    let world = world();
    let mut recording = world.record(&plan(46, vec![Wrong::Offset(world.bone("r_elbow"), 0.04)]));
    for sighting in recording.frames.iter_mut().flat_map(|f| &mut f.sightings) {
        sighting.pixel.x = 799.0 - sighting.pixel.x;
    }
    let diagnosis = run(&world, &recording);
    assert!(diagnosis.gap.before_px.is_none() && diagnosis.gap.before_m.is_none(), "{:?}", diagnosis.gap);
    let effects: Vec<&str> = diagnosis.causes.iter().map(|c| c.effect.as_str()).collect();
    assert_eq!(effects, ["picture_flipped", "joint_offset"], "{}", diagnosis.sentence);
    let place = &diagnosis.r#where[0];
    assert_eq!((place.at.as_str(), place.share), ("camera", 1.0));
    let steps: Vec<bool> = diagnosis.gap.steps.iter().map(|step| step.rms_px.is_some()).collect();
    assert_eq!(steps, [false, true, true]);
}

/// What is listed as left out is found in the file by its frame and its name, also where the name is another marker's.
#[test]
fn what_is_left_out_is_listed_under_the_name_that_the_file_has() {
    let world = world();
    let mut recording = world.record(&plan(47, vec![]));
    let of = |name: &str| recording.markers.iter().position(|m| m.name == name).unwrap();
    let (a, b) = (of("l_hand"), of("r_hand"));
    let mut moved = Vec::new();
    for (f, frame) in recording.frames.iter_mut().enumerate() {
        for sighting in &mut frame.sightings {
            sighting.target = match sighting.target {
                Target::Marker(m) if m == a => Target::Marker(b),
                Target::Marker(m) if m == b => Target::Marker(a),
                other => other,
            };
            if sighting.target == Target::Marker(b) && [11, 12, 30, 51].contains(&f) {
                sighting.pixel.x += 60.0;
                moved.push((frame.number, "r_hand".to_owned()));
            }
        }
    }
    let diagnosis = run(&world, &recording);
    assert_eq!(diagnosis.causes[0].effect, "markers_swapped", "{}", diagnosis.sentence);
    let listed: Vec<(i64, String)> =
        diagnosis.data.left_out.iter().map(|l| (l.frame, l.target.clone())).collect();
    assert_eq!(listed, moved);
}
