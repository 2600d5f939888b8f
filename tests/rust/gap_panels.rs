//! Signatures of what is no joint: tracks tell what was put in, posture by posture and within their deviations; fields shrink
//! to the noise with the right cause.

use crate::gap_world::{Plan, World, Wrong};
use mirror_core::diagnose::{DiagnoseOptions, Diagnosis, Field, FieldPoint, Track, diagnose};
use mirror_core::robot::Robot;

fn diagnosed(world: &World, wrong: Wrong, without: &[&str]) -> Diagnosis {
    let plan = Plan { wrong: vec![wrong], ..Plan::default() };
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let options = DiagnoseOptions {
        without: without.iter().map(|w| (*w).to_owned()).collect(),
        ..DiagnoseOptions::default()
    };
    let recording = world.record(&plan).validated(robot.position_count()).unwrap();
    diagnose(&robot, &recording, &options, &[]).unwrap()
}

fn track<'a>(found: &'a Diagnosis, at: &str, what: &str) -> &'a Track {
    found.tracks.iter().find(|t| t.at == at && t.what == what).unwrap_or_else(|| {
        panic!("{:?} {:?}", found.sentence, found.tracks.iter().map(|t| (&t.at, &t.what)).collect::<Vec<_>>())
    })
}

/// RMS of `(error − truth) / std` of one component.
fn normalised(track: &Track, component: usize, truth: impl Fn(usize) -> f64) -> f64 {
    let squares = track
        .points
        .iter()
        .enumerate()
        .map(|(i, p)| ((p.error[component] - truth(i)) / p.std[component]).powi(2));
    (squares.sum::<f64>() / track.points.len() as f64).sqrt()
}

#[test]
fn a_marker_off_its_mount_is_off_by_as_much_in_every_posture() {
    let shift = [0.004, -0.003, 0.002];
    let world = World::new(4, false);
    let marker = world.markers.iter().position(|m| m.0 == "l_hand").unwrap();
    let named = diagnosed(&world, Wrong::Mount(marker, shift), &[]);
    let nameless = diagnosed(&world, Wrong::Mount(marker, shift), &["marker_mount"]);
    assert_eq!(nameless.verdict.as_str(), "unknown", "{}", nameless.sentence);
    for (found, cause) in [(named, Some(0)), (nameless, None)] {
        let track = track(&found, "marker:l_hand", "shift");
        assert_eq!((track.cause, track.unit.as_str()), (cause, "m"));
        assert!(track.points.len() >= 55);
        for (k, value) in shift.into_iter().enumerate() {
            let size = normalised(track, k, |_| value);
            assert!((0.6..1.5).contains(&size), "component {k}: {size}");
            // What the model says is the same in all postures, and right.
            assert!(track.points.iter().all(|p| (p.fitted[k] - value).abs() < 3e-4), "component {k}");
        }
    }
}

#[test]
fn a_link_that_bends_turns_with_the_moment_of_gravity() {
    let compliance = 0.02;
    let world = World::new(4, false);
    let bone = world.bone("l_shoulder_yaw");
    let found = diagnosed(&world, Wrong::Bending(bone, compliance), &[]);
    assert_eq!(found.causes[0].effect, "link_bending");
    let track = track(&found, "link:l_shoulder_yaw_link", "turn");
    let moment =
        |axis: &str| track.against.iter().position(|a| a.name == format!("moment of gravity, {axis}"));
    // The link's long axis is nearly −z: it bends about x and y.
    for (k, axis) in ["x", "y"].into_iter().enumerate() {
        let column = moment(axis).unwrap();
        let (mut top, mut bottom) = (0.0, 0.0);
        for point in &track.points {
            let weight = point.std[k].powi(-2);
            top += weight * point.against[column] * point.error[k];
            bottom += weight * point.against[column].powi(2);
        }
        let slope = top / bottom;
        assert!((slope / compliance - 1.0).abs() < 0.15, "about {axis}: {slope}");
    }
}

/// Mean over places of the squared residual in variances: 1 where only noise is left.
fn size(field: &Field, residual: impl Fn(&FieldPoint) -> &[f64]) -> f64 {
    let squares = field
        .points
        .iter()
        .flat_map(|p| residual(p).iter().zip(&p.std).map(|(r, std)| (r / std).powi(2)).collect::<Vec<_>>());
    let squares: Vec<f64> = squares.collect();
    squares.iter().sum::<f64>() / squares.len() as f64
}

#[test]
fn with_the_right_optics_the_fields_shrink_to_the_noise() {
    let world = World::new(4, false);
    for (wrong, at, over) in [
        (Wrong::Radial(-0.08), "camera", "image"),
        (Wrong::Curvature(0.03), "mirror", "image"),
        (Wrong::BoardScale(0.02), "board", "board"),
        (Wrong::MarkersFocal(0.003), "camera", "image"),
    ] {
        let found = diagnosed(&world, wrong.clone(), &[]);
        let field = found.fields.iter().find(|f| f.at == at).unwrap();
        assert_eq!((field.over.as_str(), field.cause), (over, Some(0)), "{}", found.sentence);
        let (before, after) = (size(field, |p| &p.without), size(field, |p| p.with.as_ref().unwrap()));
        assert!((0.3..1.8).contains(&after), "{wrong:?}: {after} left of {before}");
        assert!(before > 2.0 * after, "{wrong:?}: {before} to {after}");
        let [w, h] = field.size;
        let on_image = |p: &FieldPoint| (0.0..=w).contains(&p.at[0]) && (0.0..=h).contains(&p.at[1]);
        let on_board = |p: &FieldPoint| p.at[0].abs() <= w / 2.0 + 1e-12 && p.at[1].abs() <= h / 2.0 + 1e-12;
        assert!(field.points.iter().all(|p| if over == "image" { on_image(p) } else { on_board(p) }));
    }
}
