//! The prior over models: what a cause costs, and what company at its place costs, in the odds that decide.

use super::gap_world::{Plan, World, Wrong};
use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::effects::vocabulary;
use crate::diagnose::likelihood::fit::Group;
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::selection::search::{Search, SearchOptions};
use crate::robot::Robot;
use std::sync::Arc;

pub(super) const NOISE: Noise = Noise { corner_px: 0.15, marker_px: 0.15, point_m: 1.0 };

pub(super) fn search<'a>(problem: &Problem, catalogue: &'a Catalogue) -> Search<'a> {
    Search {
        problem: problem.clone(),
        catalogue,
        group: Group::default(),
        measured_noise: NOISE,
        noise_widening: 1.0,
        scatter: None,
        options: SearchOptions::default(),
        mask: None,
        ties: Vec::new(),
        nominal_sums: None,
    }
}

/// The model of causes by name, fitted; and its log prior.
fn log_prior(search: &Search, names: &[&str]) -> f64 {
    let named = |name: &str| {
        let catalogue = search.catalogue;
        (0..catalogue.hypotheses.len()).find(|&h| catalogue.name(&search.problem.scene, h) == name).unwrap()
    };
    let model = names
        .iter()
        .fold(Model::nominal(&search.problem), |model, name| model.with(search.catalogue, named(name), 0.0));
    let fit = search.fit(&model, NOISE, 2).unwrap();
    search.log_posterior(&fit) - fit.log_evidence
}

#[test]
fn causes_cost_what_the_catalogue_says_and_company_at_one_place_costs_more() {
    let world = World::new(4, true);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let wrong = vec![Wrong::Offset(world.bone("r_elbow"), 0.003)];
    let plan = Plan { postures: 12, noise_px: 0.15, wrong, ..Plan::default() };
    let problem = Problem::new(&robot, &world.record(&plan)).unwrap();
    let mut catalogue =
        Catalogue::new(&problem.scene, vocabulary().into_iter().map(Arc::from).collect(), &[]);

    let told = search(&problem, &catalogue);
    let (offset, ratio, far) =
        ("joint_offset@joint:r_elbow", "gear_ratio@joint:r_elbow", "gear_ratio@joint:l_elbow");
    let tilt = "axis_tilt@joint:r_elbow";
    let alone = log_prior(&told, &[offset]);
    // One among some twenty effects, at one among some ten places.
    assert!((-8.0..-3.0).contains(&alone), "{alone}");
    let (apart, together) = (log_prior(&told, &[offset, far]), log_prior(&told, &[offset, ratio]));
    assert!((apart - alone - log_prior(&told, &[far])).abs() < 1e-9);
    assert!((-8.0..-2.0).contains(&(together - apart)), "{}", together - apart);
    let crowd = log_prior(&told, &[offset, ratio, tilt]) - together - log_prior(&told, &[tilt]);
    assert!(crowd < -20.0, "{crowd}");

    // What the catalogue says enters the odds of a cause whole.
    let model = Model::nominal(&problem).with(&catalogue, 0, 0.0);
    let name = catalogue.name(&problem.scene, 0);
    let fit = told.fit(&model, NOISE, 6).unwrap();
    let before = told.log_odds(&fit, 0, NOISE).unwrap();
    catalogue.hypotheses[0].log_prior -= 3.0;
    let after = search(&problem, &catalogue).log_odds(&fit, 0, NOISE).unwrap();
    assert!((before - after - 3.0).abs() < 1e-6, "{name}: {before} {after}");
}
