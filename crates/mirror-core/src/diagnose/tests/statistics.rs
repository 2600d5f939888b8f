//! Estimated parameters against simulated truth and their own claimed covariance.

use super::gap_world::{Plan, World, Wrong};
use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::effects::vocabulary;
use crate::diagnose::likelihood::fit::{FitOptions, Group, fit};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::robot::Robot;
use nalgebra::DVector;
use std::sync::Arc;

const SEEDS: u64 = 40;
const NOISE_PX: f64 = 0.15;

/// Mean of the normalised squared errors over their degrees of freedom: 1 where the covariance is right.
fn normalised_error(wrong: impl Fn(&World) -> Wrong, name: &str, truth: &[f64]) -> f64 {
    let world = World::new(4, false);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let mut sum = 0.0;
    for seed in 0..SEEDS {
        let plan = Plan {
            postures: 15,
            noise_px: NOISE_PX,
            seed: 100 + seed,
            wrong: vec![wrong(&world)],
            ..Plan::default()
        };
        let problem = Problem::new(&robot, &world.record(&plan)).unwrap();
        let effects = vocabulary().into_iter().map(Arc::from).collect();
        let catalogue = Catalogue::new(&problem.scene, effects, &[]);
        let hypothesis =
            (0..catalogue.hypotheses.len()).find(|&h| catalogue.name(&problem.scene, h) == name).unwrap();
        let noise = Noise { corner_px: NOISE_PX, marker_px: NOISE_PX, point_m: 1.0 };
        // Coarse first: at the measurement's own noise a model that is far off sees only false observations.
        let mut model = Model::nominal(&problem).with(&catalogue, hypothesis, 0.0);
        let coarse = Noise { marker_px: 10.0, ..noise };
        for noise in [coarse, noise] {
            let options = FitOptions { noise, steps: 12 };
            let done = fit(&problem, &catalogue, &Group::default(), &model, options, None).unwrap();
            model = done.model.clone();
            if noise.marker_px == NOISE_PX {
                let error = DVector::from_column_slice(&model.terms[0].parameters)
                    - DVector::from_column_slice(truth);
                let (first, count) = (done.first_term, truth.len());
                let covariance = done.covariance.matrix().view((first, first), (count, count)).into_owned();
                let information = covariance.try_inverse().unwrap();
                sum += error.dot(&(information * &error));
            }
        }
    }
    sum / (SEEDS as f64 * truth.len() as f64)
}

/// 99.9 % bounds of χ²/ν (Wilson and Hilferty).
fn is_chi_squared(mean: f64, degrees: f64) {
    let spread = 3.29 * (2.0 / (9.0 * degrees)).sqrt();
    let (low, high) =
        ((1.0 - 2.0 / (9.0 * degrees) - spread).powi(3), (1.0 - 2.0 / (9.0 * degrees) + spread).powi(3));
    assert!(mean > low && mean < high, "{mean} outside {low} to {high}");
}

#[test]
fn an_offsets_error_is_as_large_as_claimed() {
    let of = |w: &World| Wrong::Offset(w.bone("r_shoulder_roll"), 0.02);
    let mean = normalised_error(of, "joint_offset@joint:r_shoulder_roll", &[0.02]);
    is_chi_squared(mean, SEEDS as f64);
}

#[test]
fn a_mounts_error_is_as_large_as_claimed() {
    let truth = [0.004, -0.003, 0.002];
    let mean = normalised_error(|_| Wrong::Mount(5, truth), "marker_mount@marker:r_hand", &truth);
    is_chi_squared(mean, 3.0 * SEEDS as f64);
}
