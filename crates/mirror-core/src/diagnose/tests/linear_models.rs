//! Sets of causes beside small errors everywhere: one linear model against a fit of each, with the scales learned in both.

use super::gap_world::{Plan, World, Wrong};
use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::effects::vocabulary;
use crate::diagnose::likelihood::fit::FitOptions;
use crate::diagnose::likelihood::linearised::Linearised;
use crate::diagnose::model::elementary::{Atom, Column, Weight};
use crate::diagnose::model::problem::Problem;
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::selection::competing::Competing;
use crate::diagnose::selection::linear_search::LinearSearch;
use crate::diagnose::selection::search::{Search, SearchOptions};
use crate::robot::Robot;
use std::sync::Arc;

/// A robot with zeros and links off everywhere, and squares of another size.
fn problem() -> Problem {
    let world = World::new(4, true);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let mut wrong = vec![Wrong::BoardScale(0.01)];
    for bone in 0..world.bones.len() {
        let off = (1.7 * bone as f64).sin();
        wrong.push(Wrong::Offset(bone, 4e-3 * off));
        wrong.push(Wrong::Length(Some(bone), [1e-3 * off, -8e-4 * off, 6e-4 * (2.3 * bone as f64).cos()]));
    }
    let plan = Plan { postures: 40, noise_px: 0.3, wrong, ..Plan::default() };
    Problem::new(&robot, &world.record(&plan)).unwrap()
}

#[test]
fn a_linear_model_tells_what_a_cause_gains_by_the_scales_that_it_leaves() {
    let problem = problem();
    let catalogue = Catalogue::new(&problem.scene, vocabulary().into_iter().map(Arc::from).collect(), &[]);
    let squares = (0..catalogue.hypotheses.len())
        .find(|&h| catalogue.name(&problem.scene, h) == "board_scale@board")
        .unwrap();
    let mut search = Search {
        measured_noise: problem.noise,
        noise_widening: 1.0,
        scatter: None,
        catalogue: &catalogue,
        group: Default::default(),
        options: SearchOptions::default(),
        mask: None,
        ties: Vec::new(),
        nominal_sums: None,
        problem: problem.clone(),
    };
    let options = FitOptions { noise: problem.noise, steps: 8 };
    let nominal = Model::nominal(&problem);
    let fitted = |model: &Model| {
        let mut geometry = Geometry::new(&problem, &catalogue, false);
        let fit = geometry.fit(&problem, &catalogue, model, options, None).unwrap();
        (geometry, fit)
    };
    let (geometry, without) = fitted(&nominal);
    let (_, with) = fitted(&nominal.with(&catalogue, squares, 0.0));
    search.group = geometry.group.clone();
    let exact = search.log_posterior(&with) - search.log_posterior(&without);

    let competing = Competing::all([(squares, 0.0)].into_iter());
    let frames = vec![(0..problem.frames.len()).collect()];
    let from = (&search, &without.model, problem.noise);
    let linear = LinearSearch::new(from, Some(&geometry), &competing, &frames).unwrap();
    let whole = linear.sum(&[1.0]);
    let [with_it, without_it] = [vec![0], Vec::new()].map(|set| linear.with_scales(&whole, set).unwrap());
    let told = with_it.log_posterior - without_it.log_posterior;
    assert!(exact > 5.0, "{exact}");
    assert!((told - exact).abs() < 0.1 * exact + 1.0, "{told} {exact}");
    // At the scales without it, it gains less: they leave room for what it explains.
    let at_those = linear.additions(&without_it.scaled.reduced, &[], None).unwrap()[0].1;
    assert!(at_those < told, "{at_those} {told}");
    // Its value, too, is that of the fit.
    let moved = linear.model_with(&search, &without.model, (&with_it.scaled.equations, &[0]));
    let (value, std) = (with.model.terms[0].parameters[0], with.stds(0)[0]);
    assert!((moved.terms[0].parameters[0] - value).abs() < std, "{:?} {value} {std}", moved.terms);
}

#[test]
fn one_parameter_that_drives_two_columns_together_is_one_column_of_their_sum() {
    let problem = problem();
    let none = Catalogue::new(&problem.scene, Vec::new(), &[]);
    let n = (0..problem.scene.nodes()).find(|&n| problem.scene.relevant[n]).unwrap();
    let count = problem.scene.frames;
    let weights = |f: &dyn Fn(f64) -> f64| Weight::Frames((0..count).map(|k| f(k as f64)).collect());
    let of = |weight: Weight| Column { atom: Atom::Joint(n), weight };
    let (one, other) = (weights(&|k| (0.7 * k).sin()), weights(&|k| 0.01 * k));
    let sum = weights(&|k| (0.7 * k).sin() + 0.01 * k);
    let std = 0.02;
    let here = |columns: Vec<Column>| {
        // The mounts are free beside them.
        let mut group = Geometry::of_setup(&problem, &[]).group;
        let first = group.columns.len();
        group.prior_std.extend(vec![std; columns.len()]);
        group.columns.extend(columns);
        let start = Model { group: vec![0.0; group.columns.len()], ..Model::nominal(&problem) };
        let options = FitOptions { noise: problem.noise, steps: 0 };
        let here = Linearised::at(&problem, &none, &group, &start, options, None).unwrap();
        let first = here.first_group() + first;
        (here, first)
    };
    let (two, first) = here(vec![of(one), of(other)]);
    let (value, log_bayes) = two.together(&[first, first + 1], &[first, first + 1], std).unwrap();
    let (single, at) = here(vec![of(sum)]);
    let (its, its_log_bayes) = single.together(&[at], &[at], std).unwrap();
    assert!((value - its).abs() < 1e-9 * its.abs().max(std), "{value} {its}");
    assert!((log_bayes - its_log_bayes).abs() < 1e-6 * its_log_bayes.abs().max(1.0));
    // And by the evidence of the whole model, with the parameter and with almost none of it.
    let [with, without] = [1.0, 1e-9].map(|scale| single.log_evidence(at..at + 1, scale).unwrap());
    assert!(
        (with - without - its_log_bayes).abs() < 1e-3 * its_log_bayes.abs().max(1.0),
        "{with} {without} {its_log_bayes}"
    );
    // A column that is held is not moved by what is told.
    let (alone, ..) = two.together(&[first], &[first, first + 1], std).unwrap();
    assert!(alone.is_finite() && (alone - value).abs() > 1e-6);
}
