//! What a correction tells at its stop: at which end a joint rests, and how far the markers were when last believed.

use mirror_core::correct::*;
use mirror_core::robot::Robot;
use nalgebra::{Matrix3, Vector3};
use std::sync::Arc;

/// Range of both slides, m.
const RANGE_M: f64 = 0.01;

/// Two slides in a plane, one along x, the other along (0.9, 0.436): what one moves, the other moves nearly as well.
fn slides() -> Arc<Robot> {
    let slide = |name: &str, parent: &str, child: &str, axis: &str| {
        format!(
            r#"<joint name="{name}" type="prismatic"><parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>
               <limit lower="-{RANGE_M}" upper="{RANGE_M}" effort="1" velocity="1"/></joint>"#
        )
    };
    let urdf = format!(
        r#"<robot name="slides"><link name="base"/><link name="camera"/><link name="first"/><link name="second"/>
           <joint name="mount" type="fixed"><parent link="base"/><child link="camera"/></joint>{}{}</robot>"#,
        slide("along", "base", "first", "1 0 0"),
        slide("askew", "first", "second", "0.9 0.43588989435406735 0"),
    );
    Arc::new(Robot::from_urdf_str(&urdf).unwrap())
}

fn corrector(markers: &[&str], looks: usize) -> Corrector {
    let robot = slides();
    let link = |name: &str| robot.link_index(name).unwrap();
    let markers: Vec<(String, usize)> = markers.iter().map(|name| ((*name).to_owned(), link(name))).collect();
    let target =
        Target::new(robot.clone(), link("camera"), link("base"), &markers, &[0.0, 0.0], &[]).unwrap();
    let mut options = CorrectOptions::default();
    options.step.gain = 1.0;
    options.judge.looks = looks;
    Corrector::new(target, options, None).unwrap()
}

fn reading(point_in_frame_m: Vector3<f64>) -> Option<Reading> {
    let covariance_m2 = Matrix3::identity() * 1e-10;
    Some(Reading { point_in_frame_m, covariance_m2, chi_squared: 0.0, degrees_of_freedom: 0 })
}

/// Without limits the first slide would go to +15 mm, since the second one goes to -50 mm; with both held to 10 mm it rests at
/// -10 mm, and this end is told.
#[test]
fn the_end_is_told_at_which_a_joint_rests() {
    let mut corrector = corrector(&["second"], 20);
    let slide = Vector3::new(0.9, 0.43588989435406735, 0.0);
    let off = Vector3::x() * 0.015 - slide * 0.05;
    let limit = loop {
        let q = corrector.command();
        let seen = Vector3::x() * q[0] + slide * q[1] - off;
        match corrector.observe(&[reading(seen)]).unwrap() {
            Decision::Stop { stop: Stop::LimitReached(limit) } => break limit,
            Decision::Stop { stop } => panic!("{stop:?}"),
            _ => {}
        }
    };
    assert_eq!(limit.joints.iter().map(|hit| hit.joint.as_str()).collect::<Vec<_>>(), ["along", "askew"]);
    for (hit, wanted) in limit.joints.iter().zip([0.015, -0.05]) {
        assert!((hit.limit_rad + RANGE_M).abs() < 1e-12 && hit.of_model, "{hit:?}");
        assert!((hit.position_rad - hit.limit_rad).abs() < 1e-9, "{hit:?}");
        assert!((hit.wanted_rad - wanted).abs() < 1e-6, "{hit:?}");
    }
}

/// A last look in which a marker is hidden tells nothing: distances are those of the look before it, one for each marker.
#[test]
fn a_spent_budget_tells_the_last_accepted_look() {
    let mut bold = corrector(&["first", "second"], 2);
    let (far, near) = (Vector3::new(0.004, 0.0, 0.0), Vector3::new(0.0, 0.003, 0.0));
    assert!(matches!(bold.observe(&[reading(far), reading(near)]).unwrap(), Decision::Step { .. }));
    let spent = |decision: Decision| match decision {
        Decision::Stop { stop: Stop::BudgetSpent(spent) } => spent,
        other => panic!("{other:?}"),
    };
    let told = spent(bold.observe(&[None, reading(near * 0.1)]).unwrap());
    assert_eq!(told.distance_m.len(), 2, "{told:?}");
    assert!((told.distance_m[0] - 0.004).abs() < 1e-12 && (told.distance_m[1] - 0.003).abs() < 1e-12);
    // Where no look was accepted, nothing is known.
    let mut blind = corrector(&["first", "second"], 1);
    assert!(spent(blind.observe(&[None, reading(near)]).unwrap()).distance_m.is_empty());
}
