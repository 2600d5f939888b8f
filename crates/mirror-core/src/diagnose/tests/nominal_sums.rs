//! Sums that are kept or left out: kept ones serve only what they were summed over, and free-form errors alone have the sums that they have
//! beside all others.

use super::gap_world::{Plan, World, Wrong};
use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::effects::vocabulary;
use crate::diagnose::likelihood::fit::Group;
use crate::diagnose::likelihood::nominal_sums::NominalSums;
use crate::diagnose::likelihood::score_sums::ScoreSums;
use crate::diagnose::likelihood::score_test::{scored, screen};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::random_effects::free_form::free_forms;
use crate::robot::Robot;
use std::sync::Arc;

const NOISE: Noise = Noise { corner_px: 0.15, marker_px: 0.4, point_m: 1.0 };

fn problem() -> Problem {
    let world = World::new(4, true);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let wrong = vec![Wrong::Offset(world.bone("r_elbow"), 0.01)];
    let plan = Plan { postures: 14, noise_px: 0.15, wrong, ..Plan::default() };
    Problem::new(&robot, &world.record(&plan)).unwrap()
}

fn catalogue(problem: &Problem, without: &[&str]) -> Catalogue {
    let without: Vec<String> = without.iter().map(|w| (*w).to_owned()).collect();
    Catalogue::new(&problem.scene, vocabulary().into_iter().map(Arc::from).collect(), &without)
}

#[test]
fn kept_sums_serve_only_what_they_were_summed_over() {
    let problem = problem();
    let all = catalogue(&problem, &[]);
    let nominal = Model::nominal(&problem);
    let kept = NominalSums::at(&problem, &all, NOISE).unwrap();
    assert!(kept.are_of(&problem, &all, &nominal, NOISE));
    assert!(kept.are_of(&problem, &all, &nominal, Noise { marker_px: 0.403, ..NOISE }));
    assert!(!kept.are_of(&problem, &all, &nominal, Noise { marker_px: 0.41, ..NOISE }));
    assert!(!kept.are_of(&problem, &all, &nominal, Noise { corner_px: 0.16, ..NOISE }));
    assert!(!kept.are_of(&problem, &catalogue(&problem, &["backlash"]), &nominal, NOISE));
    assert!(!kept.are_of(&problem, &all, &nominal.with(&all, 0, 0.0), NOISE));
    let mut fewer = problem.clone();
    fewer.frames[3].others.pop().unwrap();
    assert!(!kept.are_of(&fewer, &all, &nominal, NOISE));
    let mut moved = problem.clone();
    moved.frames[3].corners[0].1.x += 0.5;
    assert!(!kept.are_of(&moved, &all, &nominal, NOISE));
    let mut turned = problem.clone();
    turned.scene.gravity = -turned.scene.gravity;
    turned.scene.update_loads(&problem.nominal());
    assert!(!kept.are_of(&turned, &all, &nominal, NOISE));

    let anew = screen(&problem, &all, &Group::default(), &nominal, NOISE, None).unwrap();
    let read = kept.screening(&all);
    assert_eq!(anew.scores.len(), read.scores.len());
    for (one, other) in anew.scores.iter().zip(&read.scores) {
        assert_eq!((one.hypothesis, one.log_bayes), (other.hypothesis, other.log_bayes));
    }
}

#[test]
fn free_forms_alone_have_the_sums_that_they_have_beside_all_others() {
    let problem = problem();
    let named = catalogue(&problem, &[]);
    let all = Catalogue::with_free_forms(&named, &problem.scene, free_forms(&problem.scene));
    let nominal = Model::nominal(&problem);
    let model = nominal.with(&all, 0, 0.0);
    let group = Group::default();
    let whole = ScoreSums::at(&problem, &all, &group, &model, NOISE, None).unwrap();
    let free =
        ScoreSums::of(&problem, (&all, all.first_free()..all.hypotheses.len()), &group, &model, NOISE, None)
            .unwrap();
    let beside: Vec<_> = whole.candidates.iter().filter(|c| all.is_free(c.hypothesis)).collect();
    assert!(!beside.is_empty());
    assert_eq!(beside.len(), free.candidates.len());
    let near = |a: f64, b: f64, scale: f64| (a - b).abs() <= 1e-9 * (scale + 1.0);
    for (one, other) in beside.iter().zip(&free.candidates) {
        assert_eq!((one.hypothesis, one.variant), (other.hypothesis, other.variant));
        assert!(one.a.iter().zip(other.a.iter()).all(|(a, b)| near(*a, *b, one.a.amax())));
        assert!(one.b.iter().zip(other.b.iter()).all(|(a, b)| near(*a, *b, one.b.amax())));
        assert!(one.g.iter().zip(other.g.iter()).all(|(a, b)| near(*a, *b, one.g.amax())));
    }
    let best = scored(&free, &all, &[0], &[]).scores;
    let of_all = screen(&problem, &all, &group, &model, NOISE, None).unwrap().scores;
    let likeliest = of_all.iter().find(|s| all.is_free(s.hypothesis)).unwrap();
    assert!(near(best[0].log_bayes, likeliest.log_bayes, likeliest.log_bayes.abs()));
}
