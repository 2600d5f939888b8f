//! An arm whose joints have transmission errors: curves of their own along a turn, beside small errors everywhere.

use crate::diagnose::data::diagnosis::Diagnosis;
use crate::diagnose::data::recording::{
    Frame, MarkerSpec, MeasuredPoint, PointsFrame, Recording, Tolerances,
};
use crate::diagnose::model::elementary::{KNOTS_A_TURN, Weight};
use crate::diagnose::model::problem::Problem;
use crate::diagnose::prepare::options::{DiagnoseOptions, OtherSession};
use crate::diagnose::second_opinion::diagnose;
use crate::random::Random;
use crate::robot::Robot;
use nalgebra::{Point3, Rotation3, Unit, Vector3};

/// Origin, m, and axis of each joint in the link before it.
const JOINTS: [([f64; 3], [f64; 3]); 4] = [
    ([0.0, 0.0, 0.3], [0.0, 0.0, 1.0]),
    ([0.0, 0.1, 0.0], [0.0, 1.0, 0.0]),
    ([0.0, 0.0, 0.5], [0.0, 1.0, 0.0]),
    ([0.1, 0.0, 0.3], [1.0, 0.0, 0.0]),
];
const MARKERS: [[f64; 3]; 3] = [[0.1, 0.0, 0.1], [0.2, 0.1, 0.0], [0.1, -0.1, 0.05]];
const NOISE_M: f64 = 2e-5;

fn robot() -> Robot {
    let mut urdf = String::from("<robot name=\"arm\"><link name=\"link_0\"/>");
    for (i, (at, axis)) in JOINTS.iter().enumerate() {
        let text = |v: &[f64; 3]| v.map(|x| x.to_string()).join(" ");
        urdf += &format!(
            "<link name=\"link_{}\"/><joint name=\"joint_{i}\" type=\"revolute\"><parent link=\"link_{i}\"/><child link=\"link_{}\"/>\
             <origin xyz=\"{}\"/><axis xyz=\"{}\"/><limit lower=\"-3\" upper=\"3\" effort=\"1\" velocity=\"1\"/></joint>",
            i + 1,
            i + 1,
            text(at),
            text(axis)
        );
    }
    Robot::from_urdf_str(&(urdf + "</robot>")).unwrap()
}

/// A session of the same arm: its small errors, and curves of `amplitude_rad` with 11 and 17 periods a turn. The
/// noise is `times` the stated one.
fn recorded(seed: u64, amplitude_rad: f64, times: f64) -> Recording {
    let mut arm = Random::new(5);
    let small = |r: &mut Random, scale: f64| Vector3::from_fn(|_, _| scale * r.normal());
    let joints: Vec<_> = JOINTS
        .iter()
        .map(|(at, axis)| {
            let at = Vector3::from(*at) + small(&mut arm, 5e-4);
            let axis = Unit::new_normalize(Vector3::from(*axis) + small(&mut arm, 2e-3));
            (at, axis, 2e-3 * arm.normal(), [6.0 * arm.unit(), 6.0 * arm.unit()])
        })
        .collect();
    let mut random = Random::new(seed);
    let frames = (0..250).map(|i| {
        let commanded: Vec<f64> = JOINTS.iter().map(|_| 2.4 * (random.unit() - 0.5)).collect();
        let (mut turn, mut at) = (Rotation3::identity(), Vector3::zeros());
        for ((origin, axis, zero, phase), q) in joints.iter().zip(&commanded) {
            let curve = (11.0 * q + phase[0]).cos() + 0.7 * (17.0 * q + phase[1]).sin();
            at += turn * origin;
            turn *= Rotation3::from_axis_angle(axis, q + zero + amplitude_rad * curve);
        }
        let mut seen = |m: usize| {
            let noise = small(&mut random, times * NOISE_M);
            MeasuredPoint {
                marker: m,
                position_m: Point3::from(at + turn * Vector3::from(MARKERS[m]) + noise),
            }
        };
        let points = (0..MARKERS.len()).map(&mut seen).collect();
        Frame { number: i, posture: i, time_s: i as f64, commanded, sightings: Vec::new(), points }
    });
    Recording {
        root_link: "link_0".into(),
        gravity: Vector3::new(0.0, 0.0, -9.81),
        sight: None,
        frames: frames.collect(),
        markers: (0..MARKERS.len())
            .map(|m| MarkerSpec {
                name: format!("marker_{m}"),
                link: "link_4".into(),
                diameter_m: 0.0,
                mount_known: false,
            })
            .collect(),
        tolerances: Tolerances::default(),
        points_frame: Some(PointsFrame::Unknown),
        columns: Vec::new(),
        ordered: false,
        timed: false,
        pixel_std_px: None,
        point_std_m: Some(NOISE_M),
    }
}

fn diagnosed(amplitude_rad: f64, times: f64) -> Diagnosis {
    let other = OtherSession {
        name: "other".into(),
        robot: robot(),
        recording: recorded(2, amplitude_rad, times),
        own: Vec::new(),
    };
    diagnose(&robot(), &recorded(1, amplitude_rad, times), &DiagnoseOptions::default(), &[other]).unwrap()
}

/// Errors of the transmissions as they are reported: joint, position in degrees, error in rad.
fn reported(diagnosis: &Diagnosis) -> usize {
    let members = diagnosis.causes.iter().flat_map(|c| &c.members);
    members.filter(|m| m.effect == "transmission_error").count()
}

#[test]
fn curves_of_the_joints_are_found_beside_small_errors_and_predict_another_session() {
    let found = diagnosed(4e-4, 1.0);
    assert!(reported(&found) > 4 * 20, "{:?}", found.trace);
    // 0.35 mrad of each of four joints at 0.5 m are 0.3 mm.
    let (held_out, predicted) = (found.gap.after_m.unwrap(), found.gap.checked[0].after_m.unwrap());
    assert!(held_out < 1e-4 && predicted < 1e-4, "{held_out} {predicted} {:?}", found.trace);
    assert!(found.causes.iter().all(|c| c.effect == "geometry"), "{:?}", found.causes);
}

#[test]
fn joints_without_curves_are_given_none() {
    // Ten times the stated noise is a remainder, and no curve.
    for times in [1.0, 10.0] {
        let found = diagnosed(0.0, times);
        assert_eq!(reported(&found), 0, "{times} {:?}", found.trace);
        assert!(found.gap.after_m.unwrap() < 2.0 * times * NOISE_M * 3f64.sqrt());
    }
}

#[test]
fn knots_add_up_to_one_wherever_a_joint_is() {
    let problem = Problem::new(&robot(), &recorded(3, 0.0, 1.0).validated(JOINTS.len()).unwrap()).unwrap();
    let scene = &problem.scene;
    for frame in 0..scene.frames {
        let weights: Vec<f64> = (0..KNOTS_A_TURN).map(|k| Weight::Knot(1, k).at(scene, frame)).collect();
        assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-9);
        assert!(weights.iter().filter(|w| **w != 0.0).count() <= 2);
        // Their mean position is the joint's.
        let middle: f64 = (0..KNOTS_A_TURN)
            .map(|k| {
                let at = core::f64::consts::TAU * k as f64 / KNOTS_A_TURN as f64;
                weights[k] * if at > core::f64::consts::PI { at - core::f64::consts::TAU } else { at }
            })
            .sum();
        assert!((middle - scene.q(frame, 1)).abs() < 1e-9);
    }
}
