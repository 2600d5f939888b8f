//! Lack of fit: noise alone is never called a remainder, however few the postures.

use super::gap_world::{Plan, World};
use crate::diagnose::criteria::lack_of_fit::{adequacy, noticeable_excess};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::robot::Robot;

const NOISE: Noise = Noise { corner_px: 0.15, marker_px: 0.15, point_m: 1.0 };

#[test]
fn few_postures_scatter_and_are_no_lack_of_fit() {
    let mut large = 0;
    for seed in 0..40 {
        let world = World::new(4, true);
        let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
        let plan = Plan { postures: 3, noise_px: NOISE.marker_px, seed, ..Plan::default() };
        let problem = Problem::new(&robot, &world.record(&plan)).unwrap();
        let told = adequacy(&problem, &problem.nominal(), NOISE).unwrap();
        assert!(!told.significant, "seed {seed}: an excess of {} over nothing but noise", told.excess);
        large += usize::from(told.excess > noticeable_excess());
    }
    // That the excess is large by chance is common: its scatter is what keeps it from being called one.
    assert!(large >= 3, "{large} of 40");
}
