//! Sums of the score test that serve several questions, against a pass over the frames for each.

use super::gap_world::{Plan, World, Wrong};
use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::effects::vocabulary;
use crate::diagnose::likelihood::fit::{Active, FitOptions, Group, fit};
use crate::diagnose::likelihood::linearised::Linearised;
use crate::diagnose::likelihood::score_sums::{CandidateSums, ScoreSums};
use crate::diagnose::likelihood::score_test::{Score, scored, screen};
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::robot::Robot;
use nalgebra::{DMatrix, DVector};
use std::sync::Arc;

const NOISE: Noise = Noise { corner_px: 0.15, marker_px: 0.15, point_m: 1.0 };

/// A session with a zero and a ratio that are off, and a model of both that was fitted with free mounts.
struct Fitted {
    problem: Problem,
    catalogue: Catalogue,
    group: Group,
    model: Model,
}

fn fitted() -> Fitted {
    let world = World::new(4, true);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let wrong =
        vec![Wrong::Offset(world.bone("r_elbow"), 0.002), Wrong::Offset(world.bone("l_elbow"), 0.003)];
    let plan = Plan { postures: 14, noise_px: 0.15, wrong, ..Plan::default() };
    let problem = Problem::new(&robot, &world.record(&plan)).unwrap();
    let catalogue = Catalogue::new(&problem.scene, vocabulary().into_iter().map(Arc::from).collect(), &[]);
    let named = |name: &str| {
        (0..catalogue.hypotheses.len()).find(|&h| catalogue.name(&problem.scene, h) == name).unwrap()
    };
    let shifts = (0..world.markers.len()).flat_map(|m| (0..3).map(move |k| Atom::MarkerShift(m, k)));
    let columns: Vec<Column> = shifts.chain([Atom::CameraMount(1)]).map(Column::constant).collect();
    let group = Group { prior_std: vec![2e-5; columns.len()], columns, ..Group::default() };
    let mut start = Model::nominal(&problem);
    start.group = vec![0.0; group.columns.len()];
    for joint in ["joint_offset@joint:r_elbow", "joint_offset@joint:l_elbow"] {
        start = start.with(&catalogue, named(joint), 0.0);
    }
    let options = FitOptions { noise: NOISE, steps: 12 };
    let model = fit(&problem, &catalogue, &group, &start, options, None).unwrap().model;
    Fitted { problem, catalogue, group, model }
}

#[test]
fn scores_without_a_cause_are_those_of_the_model_without_it() {
    let Fitted { problem, catalogue, group, model } = fitted();
    let sums = ScoreSums::at(&problem, &catalogue, &group, &model, NOISE, None).unwrap();
    let active = Active::of(&problem, &catalogue, &group, &model);
    let out = [active.first_term];
    let own = model.terms[0].hypothesis;
    let shared = scored(&sums, &catalogue, &[model.terms[1].hypothesis], &out);
    // The long way: the others to where they are best without the cause, and a pass there.
    let options = FitOptions { noise: NOISE, steps: 0 };
    let here = Linearised::at(&problem, &catalogue, &group, &model, options, None).unwrap();
    let rest = here.moved_with(&model, &here.of_term(&model, 0), &[0.0]).unwrap().without(0);
    let moved: Vec<f64> = Active::of(&problem, &catalogue, &group, &rest).values;
    for (i, (a, b)) in shared.at_rest().unwrap().iter().zip(&moved).enumerate() {
        assert!((a - b).abs() < 1e-9 + 1e-6 * b.abs(), "{i}: {a} {b}");
    }
    let anew = screen(&problem, &catalogue, &group, &rest, NOISE, None).unwrap().scores;
    let of = |scores: &[Score], h: usize| scores.iter().find(|s| s.hypothesis == h).unwrap().clone();
    let (mine, its) = (of(&shared.scores, own), of(&anew, own));
    let (a, b) = (mine.log_bayes, its.log_bayes);
    assert!(b > 5.0 && (a - b).abs() < 0.15 * b, "{a} {b}");
    let (estimate, fitted) = (mine.parameters[0], model.terms[0].parameters[0]);
    assert!((estimate - fitted).abs() < 0.03 * fitted.abs(), "{estimate} {fitted}");
    // What can take its place.
    for score in anew.iter().take(12).filter(|s| catalogue.hypotheses[s.hypothesis].variants.len() == 1) {
        let (a, b) = (of(&shared.scores, score.hypothesis).log_bayes, score.log_bayes);
        assert!(
            (a - b).abs() < 3.0 + 0.2 * b.abs(),
            "{}: {a} {b}",
            catalogue.name(&problem.scene, score.hypothesis)
        );
    }
}

#[test]
fn evidence_from_the_sums_is_that_of_the_model_linearised() {
    let Fitted { problem, catalogue, group, model } = fitted();
    let sums = ScoreSums::at(&problem, &catalogue, &group, &model, NOISE, None).unwrap();
    assert!(sums.comparable, "the free camera mount needs the boards, as the optics' hypotheses do");
    let options = FitOptions { noise: NOISE, steps: 0 };
    let here = Linearised::at(&problem, &catalogue, &group, &model, options, None).unwrap();
    let all: Vec<usize> = (0..sums.active.values.len()).collect();
    let from_sums = Linearised::among((&sums.h, &sums.g, sums.cost), &sums.active, &all);
    for i in 0..2 {
        let own = here.of_term(&model, i);
        for scale in [1.0, 1e-3] {
            let (a, b) = (here.log_evidence(own.clone(), scale), from_sums.log_evidence(own.clone(), scale));
            assert!((a.unwrap() - b.unwrap()).abs() < 1e-6 * a.unwrap().abs(), "{a:?} {b:?}");
        }
    }
}

/// One dense system of the model and of one hypothesis more, solved and inverted whole.
#[test]
fn a_further_cause_moves_and_widens_values_as_one_system_with_it_does() {
    let Fitted { problem, catalogue, group, model } = fitted();
    let sums = ScoreSums::at(&problem, &catalogue, &group, &model, NOISE, None).unwrap();
    let known: Vec<usize> = model.terms.iter().map(|t| t.hypothesis).collect();
    let screening = scored(&sums, &catalogue, &known, &[]);
    let active = &screening.active;
    let (mut h, mut g) = (sums.h.clone(), sums.g.clone());
    active.add_priors(&mut h, &mut g);
    let (count, first) = (g.len(), active.first_group);
    let alone = h.clone().try_inverse().unwrap();
    let mut tried = 0;
    let plain = |s: &&Score| catalogue.hypotheses[s.hypothesis].variants.len() == 1;
    for score in screening.scores.iter().filter(plain).take(30) {
        let of = |c: &&CandidateSums| c.hypothesis == score.hypothesis;
        let candidate = sums.candidates.iter().find(of).unwrap();
        let k = candidate.g.len();
        if candidate.positive {
            continue;
        }
        let prior: Vec<f64> = catalogue.prior_stds(score.hypothesis, score.variant).collect();
        let mut whole = DMatrix::zeros(count + k, count + k);
        whole.view_mut((0, 0), (count, count)).copy_from(&h);
        whole.view_mut((0, count), (count, k)).copy_from(&candidate.b);
        whole.view_mut((count, 0), (k, count)).copy_from(&candidate.b.transpose());
        let mut own = candidate.a.clone();
        own.fill_lower_triangle_with_upper_triangle();
        whole.view_mut((count, count), (k, k)).copy_from(&own);
        (0..k).for_each(|i| whole[(count + i, count + i)] += prior[i].powi(-2));
        let right = DVector::from_iterator(count + k, g.iter().chain(candidate.g.iter()).copied());
        let inverse = whole.try_inverse().unwrap();
        let (with, without) = (&inverse * right, &alone * &g);
        let moved = screening.with_cause(score, prior.into_iter(), first).unwrap();
        for i in first..count {
            let unit = alone[(i, i)].sqrt();
            let moves = (with[i] - without[i]) / unit;
            let adds = (inverse[(i, i)] - alone[(i, i)]) / unit.powi(2);
            let (its_moves, its_adds) =
                (moved.moves[i - first] / unit, moved.adds_variance[i - first] / unit.powi(2));
            let name = catalogue.name(&problem.scene, score.hypothesis);
            assert!((its_moves - moves).abs() < 1e-5 + 1e-4 * moves.abs(), "{name}: {its_moves} {moves}");
            assert!((its_adds - adds).abs() < 1e-5 + 1e-4 * adds.abs(), "{name}: {its_adds} {adds}");
        }
        tried += 1;
    }
    assert!(tried > 10, "{tried}");
}
