//! Which of the joints' zeros is a cause of its own, and which one of the small errors of all.

use super::gap_world::{Plan, World};
use crate::diagnose::effects::hypothesis::Catalogue;
use crate::diagnose::effects::{Place, vocabulary};
use crate::diagnose::model::problem::Problem;
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::random_effects::outlier_tolerances::{Zero, Zeros};
use crate::robot::Robot;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use std::sync::Arc;

/// Zeros by hand are off by about 0.15 degrees.
const BY_HAND_RAD: f64 = 2.5e-3;

#[test]
fn a_zero_is_a_cause_where_it_is_none_of_the_others() {
    let world = World::new(4, true);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let problem = Problem::new(&robot, &world.record(&Plan { postures: 20, ..Plan::default() })).unwrap();
    let scene = &problem.scene;
    let catalogue = Catalogue::new(scene, vocabulary().into_iter().map(Arc::from).collect(), &[]);
    let setup = Geometry::of_setup(&problem, &[]);
    let joints = (0..scene.nodes()).filter(|&n| scene.relevant[n]);
    let hypotheses: Vec<usize> =
        joints.filter_map(|n| catalogue.find("joint_offset", Place::Joint(n))).collect();
    assert!(hypotheses.len() >= 6);
    let odds = |values: &[f64], k: usize| {
        let each = hypotheses.iter().zip(values).map(|(&hypothesis, &value_rad)| Zero {
            hypothesis,
            value_rad,
            told: 1.0,
            is_cause: false,
        });
        let each = each.collect();
        Zeros { setup: &setup, catalogue: &catalogue, each }.log_odds(k)
    };
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let by_hand = Normal::new(0.0, BY_HAND_RAD).unwrap();
    let draws = 2_000;
    let told = (0..draws).filter(|_| {
        let values: Vec<f64> = hypotheses.iter().map(|_| by_hand.sample(&mut random)).collect();
        (0..values.len()).any(|k| odds(&values, k) > 0.0)
    });
    // Of zeros by hand hardly ever one is told.
    let told = told.count();
    assert!(told < draws / 100, "{told}");
    let beside = |rest: f64| {
        let mut values: Vec<f64> =
            (0..hypotheses.len()).map(|k| if k % 2 == 0 { rest } else { -rest }).collect();
        values[1] = 0.0134;
        odds(&values, 1)
    };
    // One of three quarters of a degree among exact ones is, and is none among others of a third.
    assert!(beside(2e-4) > 1.0, "{}", beside(2e-4));
    assert!(beside(4.5e-3) < 0.0, "{}", beside(4.5e-3));
    // Two degrees are told beside any.
    let mut values = vec![BY_HAND_RAD; hypotheses.len()];
    values[0] = 0.035;
    assert!(odds(&values, 0) > 3.0);
}
