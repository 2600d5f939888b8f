//! A base that is not where it was, measured from outside: it sinks with time, or yields on its bolts. No effect of the vocabulary has
//! that, and no joint is to blame.

use crate::gap_world::{Plan, World, Wrong};
use mirror_core::diagnose::{DependsOn, DiagnoseOptions, Diagnosis, Recording, Verdict, diagnose};
use mirror_core::robot::Robot;
use nalgebra::{Isometry3, Vector3};

const NOISE_M: f64 = 2e-4;

fn plan(seed: u64, wrong: Vec<Wrong>) -> Plan {
    Plan { postures: 50, views: 1, seed, wrong, ..Plan::default() }
}

fn diagnosed(world: &World, recording: &Recording) -> Diagnosis {
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    diagnose(&robot, recording, &DiagnoseOptions::default(), &[]).unwrap()
}

/// The base moves by the row and by the moment of the whole robot about it, N m; what is told depends `on` that.
fn assert_at_the_base(seeds: [u64; 2], on: DependsOn, base: impl Fn(usize, Vector3<f64>) -> Isometry3<f64>) {
    let world = World::new(4, false);
    for seed in seeds {
        let told = diagnosed(&world, &world.record_points_of_base(&plan(seed, vec![]), NOISE_M, &base));
        assert_eq!(told.verdict, Verdict::Unknown, "{} {:#?}", told.sentence, told.trace);
        assert_eq!(told.r#where[0].at, "link:base", "{:?}", told.r#where);
        assert_eq!(told.r#where[0].depends_on.as_ref(), Some(&on), "{:?}", told.r#where);
        let gap = &told.gap;
        assert!(gap.after_m <= gap.before_m, "{gap:?}");
    }
}

#[test]
fn a_base_that_sinks_is_no_drift_of_joints() {
    assert_at_the_base([91, 92], DependsOn::Time, |f, _| {
        let way = (f as f64 / 50.0).sqrt();
        Isometry3::new(Vector3::new(0.0, 0.001, -0.004) * way, Vector3::new(0.012, -0.006, 0.002) * way)
    });
}

#[test]
fn a_base_that_yields_on_its_bolts_is_no_spring_of_a_joint() {
    assert_at_the_base([93, 94], DependsOn::Load, |_, moment| {
        Isometry3::new(Vector3::zeros(), moment * 0.008)
    });
}

#[test]
fn a_joint_that_drifts_on_a_firm_base_is_still_told() {
    let world = World::new(4, false);
    let joint = world.bone("r_shoulder_pitch");
    let told = diagnosed(&world, &world.record_points(&plan(95, vec![Wrong::Drift(joint, 4e-4)]), NOISE_M));
    assert_eq!(told.verdict, Verdict::Explained, "{} {:#?}", told.sentence, told.trace);
    let named: Vec<_> = told.causes.iter().map(|c| (c.effect.as_str(), c.at.as_str())).collect();
    assert_eq!(named, [("drift", "joint:r_shoulder_pitch")]);
}
