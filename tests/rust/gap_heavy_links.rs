//! Links that bend by their own weight too, with the mass where motors are: near their joint. A hinge in the middle and a beam are two
//! laws of the same cause, and neither needs another cause beside it.

use crate::gap_world::{Plan, World, Wrong};
use mirror_core::diagnose::{DiagnoseOptions, Verdict, diagnose};
use mirror_core::robot::Robot;
use nalgebra::Vector3;

const NOISE_M: f64 = 1e-4;
const COMPLIANCE: f64 = 0.02;

/// The upper arm as heavy as all that it carries.
fn world(own_mass: f64, center: f64) -> World {
    let mut world = World::new(4, false);
    let upper = world.bone("r_shoulder_yaw");
    world.bones[upper].mass = own_mass;
    world.bones[upper].com = Vector3::new(0.0, 0.0, center);
    // What the model moves with the link's end lies on what it carries.
    world.markers.retain(|(name, ..)| name != "r_upper");
    world
}

fn assert_alone(world: &World, wrong: Wrong, seed: u64) {
    let plan = Plan { postures: 50, views: 1, seed, wrong: vec![wrong.clone()], ..Plan::default() };
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let recording = world.record_points(&plan, NOISE_M);
    let told = diagnose(&robot, &recording, &DiagnoseOptions::default(), &[]).unwrap();
    assert!(matches!(told.verdict, Verdict::Explained | Verdict::Partial), "{wrong:?} {}", told.sentence);
    let named: Vec<_> = told.causes.iter().filter(|c| c.probability >= 0.5).collect();
    let [cause] = &named[..] else { panic!("{wrong:?} {:?} {:#?}", told.causes, told.trace) };
    assert_eq!((cause.effect.as_str(), cause.at.as_str()), ("link_bending", "link:r_shoulder_yaw_link"));
    let found = cause.parameters["compliance_rad_per_nm"];
    assert!((found.value - COMPLIANCE).abs() < 4.0 * found.std + 0.15 * COMPLIANCE, "{wrong:?} {found:?}");
}

#[test]
fn a_beam_is_told_as_one_cause_wherever_its_own_mass_is() {
    for (own_mass, center, seed) in [(1.5, -0.095, 1), (3.0, -0.05, 2), (3.0, -0.02, 3)] {
        let world = world(own_mass, center);
        assert_alone(&world, Wrong::Beam(world.bone("r_shoulder_yaw"), COMPLIANCE), seed);
    }
}

#[test]
fn a_hinge_in_the_middle_is_told_as_one_cause_all_the_same() {
    for (own_mass, center, seed) in [(1.5, -0.095, 4), (3.0, -0.13, 5)] {
        let world = world(own_mass, center);
        assert_alone(&world, Wrong::Bending(world.bone("r_shoulder_yaw"), COMPLIANCE), seed);
    }
}
