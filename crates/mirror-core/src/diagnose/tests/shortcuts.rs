//! Shortcuts of the search against the long way: planes from nearby, evidence without a fit.

use super::gap_world::{Plan, World, Wrong};
use crate::diagnose::criteria::fit_without_each::fit_without_each;
use crate::diagnose::effects::hypothesis::{Catalogue, Model, Term};
use crate::diagnose::effects::vocabulary;
use crate::diagnose::likelihood::fit::{Active, FitOptions, Group, Until, fit};
use crate::diagnose::likelihood::linearised::Linearised;
use crate::diagnose::likelihood::normal_equations::Normal;
use crate::diagnose::likelihood::score_test::{Score, screen};
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::random_effects::free_form::free_forms;
use crate::robot::Robot;
use std::sync::Arc;

const NOISE: Noise = Noise { corner_px: 0.15, marker_px: 0.15, point_m: 1.0 };

fn problem() -> Problem {
    let world = World::new(4, true);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let wrong = vec![Wrong::Offset(world.bone("r_elbow"), 0.01)];
    let plan = Plan { postures: 12, noise_px: 0.15, wrong, ..Plan::default() };
    Problem::new(&robot, &world.record(&plan)).unwrap()
}

pub(super) fn catalogue(problem: &Problem) -> Catalogue {
    Catalogue::new(&problem.scene, vocabulary().into_iter().map(Arc::from).collect(), &[])
}

/// A hypothesis by its name.
pub(super) fn named(problem: &Problem, catalogue: &Catalogue, name: &str) -> usize {
    (0..catalogue.hypotheses.len()).find(|&h| catalogue.name(&problem.scene, h) == name).unwrap()
}

#[test]
fn planes_from_nearby_give_the_equations_of_planes_from_afar() {
    let problem = problem();
    let columns = [Atom::Focal, Atom::Curvature, Atom::CameraMount(1)].map(Column::constant);
    let at = |share: f64| {
        let mut d = problem.nominal();
        for (column, size) in columns.iter().zip([1e-3, 5e-4, 1e-3]) {
            column.add(share * size, &problem.scene, &mut d);
        }
        d
    };
    let linearise =
        |share: f64, planes| Normal::at(&problem, &at(share), NOISE, &columns, true, planes, None).unwrap();
    let before = linearise(0.5, None);
    // The planes that the linear model foretells for a step of half the errors again.
    let feet = before.planes.after(&[2.5e-4, 1.25e-4, 2.5e-4]);
    let (near, far) = (linearise(0.75, Some(&feet)), linearise(0.75, None));
    let scale = far.h.diagonal().max();
    assert!((near.cost - far.cost).abs() < 0.2, "{} {}", near.cost, far.cost);
    assert!((&near.h - &far.h).abs().max() < 1e-4 * scale, "{}", (&near.h - &far.h).abs().max() / scale);
    assert!((&near.g - &far.g).abs().max() < 1e-3 * far.g.abs().max());
    for (foretold, found) in feet.iter().zip(&far.planes.feet) {
        let miss = (foretold.unwrap() - found.unwrap()).norm();
        assert!(miss < 3e-5, "{miss:e} m");
    }
}

/// The first step of all of them is from one pass over the frames; with optics the planes are those of each frame's own part.
#[test]
fn fits_without_each_part_are_the_fits_to_the_others() {
    let problem = problem();
    let catalogue = catalogue(&problem);
    let none = Group::default();
    let options = FitOptions { noise: NOISE, steps: 4 };
    let least = Until::BEST;
    // Parts whose frames lie among each other's.
    let labels: Vec<usize> = (0..problem.frames.len()).map(|frame| (frame + frame / 3) % 3).collect();
    for others in [vec![], vec!["camera_focal@camera", "mirror_curvature@mirror"]] {
        let mut start = Model::nominal(&problem).with(
            &catalogue,
            named(&problem, &catalogue, "joint_offset@joint:r_elbow"),
            0.0,
        );
        for other in others {
            start = start.with(&catalogue, named(&problem, &catalogue, other), 0.0);
        }
        let start = fit(&problem, &catalogue, &none, &start, options, None).unwrap().model;
        let all = fit_without_each(&problem, &catalogue, &none, &start, options, &labels, least).unwrap();
        assert_eq!(all.len(), 3);
        let spent = |until: Until| {
            let before = problem.budget.share();
            let fits =
                fit_without_each(&problem, &catalogue, &none, &start, options, &labels, until).unwrap();
            (fits, problem.budget.share() - before)
        };
        let ((_, exactly), (quick, once)) = (spent(least), spent(Until::WithinDeviations));
        assert!(once < 0.5 * exactly, "{once:e} of {exactly:e}");
        for (part, fitted) in all.iter().enumerate() {
            let mask: Vec<bool> = labels.iter().map(|label| *label != part).collect();
            let alone = fit(&problem, &catalogue, &none, &start, options, Some(&mask)).unwrap();
            assert!((fitted.log_evidence - alone.log_evidence).abs() < 1e-6);
            assert!((fitted.misfit - alone.misfit).abs() < 1e-6);
            for (i, (one, other)) in fitted.model.terms.iter().zip(&alone.model.terms).enumerate() {
                let moved = (one.parameters[0] - other.parameters[0]).abs() / alone.stds(i)[0];
                assert!(moved < 1e-6, "{moved:e} deviations");
            }
            // With one step as well as a deviation tells: by a hundredth of it.
            for (i, (one, other)) in quick[part].model.terms.iter().zip(&alone.model.terms).enumerate() {
                let moved = (one.parameters[0] - other.parameters[0]).abs() / alone.stds(i)[0];
                assert!(moved < 0.01, "{moved:e} deviations");
            }
            assert!((quick[part].misfit - alone.misfit).abs() < 0.01);
            // Not the fit to all frames.
            let moved = (fitted.model.terms[0].parameters[0] - start.terms[0].parameters[0]).abs();
            assert!(moved > 0.01 * alone.stds(0)[0], "{moved:e} rad");
        }
    }
    // A single part has no others.
    let one = vec![0; labels.len()];
    let start = Model::nominal(&problem).with(
        &catalogue,
        named(&problem, &catalogue, "joint_offset@joint:r_elbow"),
        0.0,
    );
    assert_eq!(fit_without_each(&problem, &catalogue, &none, &start, options, &one, least).unwrap().len(), 1);
}

/// A camera that looks elsewhere finds no board in any mirror: its frames must not be cheaper than frames that are seen badly.
#[test]
fn frames_that_a_model_loses_cost_what_false_observations_cost() {
    let problem = problem();
    let columns = [Atom::CameraMount(0), Atom::CameraMount(1)].map(Column::constant);
    let cost = |turn_rad: f64| {
        let mut d = problem.nominal();
        columns.iter().for_each(|c| c.add(turn_rad, &problem.scene, &mut d));
        Normal::at(&problem, &d, NOISE, &columns, true, None, None).unwrap().cost
    };
    let (as_it_is, badly, not_at_all) = (cost(0.0), cost(0.3), cost(2.5));
    let seen: usize = problem.frames.iter().map(|f| f.corners.len() + f.others.len()).sum();
    assert!(as_it_is < badly && badly < 1.01 * not_at_all, "{as_it_is} {badly} {not_at_all}");
    // More than 20 each: a standard deviation of 0.15 px in a picture of hundreds by hundreds.
    assert!(not_at_all > 20.0 * seen as f64, "{not_at_all} of {seen} observations");
}

#[test]
fn evidence_without_a_fit_is_that_of_the_fit() {
    let problem = problem();
    let catalogue = catalogue(&problem);
    let nominal = Model::nominal(&problem);
    let offset = named(&problem, &catalogue, "joint_offset@joint:r_elbow");
    let start = nominal.with(&catalogue, offset, 0.0).with(
        &catalogue,
        named(&problem, &catalogue, "camera_focal@camera"),
        0.0,
    );
    let options = |steps| FitOptions { noise: NOISE, steps };
    let none = Group::default();
    let found = fit(&problem, &catalogue, &none, &start, options(12), None).unwrap();
    let here = Linearised::at(&problem, &catalogue, &none, &found.model, options(0), None).unwrap();
    let all = here.log_evidence(here.of_term(&found.model, 0), 1.0).unwrap();
    assert!((all - found.log_evidence).abs() < 0.1, "{all} {}", found.log_evidence);
    // The other cause held at next to nothing: as if it were not there.
    let small = here.log_evidence(here.of_term(&found.model, 1), 1e-6).unwrap();
    let without = fit(&problem, &catalogue, &none, &found.model.without(1), options(12), None).unwrap();
    assert!((small - without.log_evidence).abs() < 0.2, "{small} {}", without.log_evidence);
}

/// A joint's zero and the mounts of the markers beyond it do the same. Without the zero the mounts explain all of it; a fit that starts
/// where they were best beside it sees false observations only, and stays there.
#[test]
fn what_others_can_explain_as_well_they_explain_once_a_cause_is_taken_out() {
    let world = World::new(4, true);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let wrong = vec![Wrong::Offset(world.bone("r_elbow"), 0.03)];
    let plan = Plan { postures: 12, noise_px: 0.15, wrong, ..Plan::default() };
    let problem = Problem::new(&robot, &world.record(&plan)).unwrap();
    let catalogue = catalogue(&problem);
    let offset = named(&problem, &catalogue, "joint_offset@joint:r_elbow");
    let shifts = (0..world.markers.len()).flat_map(|m| (0..3).map(move |k| Atom::MarkerShift(m, k)));
    let columns: Vec<Column> = shifts.map(Column::constant).collect();
    let mut start = Model::nominal(&problem).with(&catalogue, offset, 0.0);
    start.group = vec![0.0; columns.len()];
    let fitted = |group: &Group, model: &Model, steps| {
        fit(&problem, &catalogue, group, model, FitOptions { noise: NOISE, steps }, None).unwrap()
    };
    // First the joint alone, the mounts next to exact; then the mounts within 10 mm.
    let exact = Group { columns: columns.clone(), prior_std: vec![1e-6; columns.len()], ..Group::default() };
    let coarse = FitOptions { noise: Noise { marker_px: 10.0, ..NOISE }, steps: 12 };
    let near = fit(&problem, &catalogue, &exact, &start, coarse, None).unwrap();
    let by_the_joint = fitted(&exact, &near.model, 12);
    let group = Group { prior_std: vec![0.01; columns.len()], columns, ..Group::default() };
    let options = FitOptions { noise: NOISE, steps: 0 };
    let here = Linearised::at(&problem, &catalogue, &group, &by_the_joint.model, options, None).unwrap();
    let own = here.of_term(&by_the_joint.model, 0);
    let moved = here.moved_with(&by_the_joint.model, &own, &[0.0]).unwrap();
    let by_the_mounts = fitted(&group, &moved.without(0), 8);
    let stuck = fitted(&group, &by_the_joint.model.without(0), 8);
    let more = by_the_mounts.misfit - by_the_joint.misfit;
    assert!(more.abs() < 20.0, "{more}");
    // Why it matters where the fit starts.
    assert!(stuck.misfit > by_the_mounts.misfit + 100.0, "{} {}", stuck.misfit, by_the_mounts.misfit);
}

#[test]
fn a_link_without_length_lies_along_the_limb_that_follows() {
    let world = World::new(4, true);
    let urdf = world.urdf();
    let joint = urdf.find("name=\"r_elbow\"").unwrap();
    let origin = joint + urdf[joint..].find("xyz=\"").unwrap() + 5;
    let end = origin + urdf[origin..].find('"').unwrap();
    let without_length = format!("{}0 0 0{}", &urdf[..origin], &urdf[end..]);
    let robot = Robot::from_urdf_str(&without_length).unwrap();
    let problem = Problem::new(&robot, &world.record(&Plan::default())).unwrap();
    let nodes = &problem.scene.body.nodes;
    let elbow = nodes.iter().find(|n| n.joint == "r_elbow").unwrap();
    let upper_arm = &nodes[elbow.parent.unwrap()];
    assert!(upper_arm.bend_pivot.norm() < 1e-12);
    let beyond = elbow.parent_from_joint.r * elbow.bend_pivot.normalize();
    assert!((upper_arm.long_axis.unwrap() - beyond).norm() < 1e-9);
}

/// What the screening says of all else beside a hypothesis is the solution of the equations of both together.
#[test]
fn all_else_moves_along_with_a_hypothesis() {
    let problem = problem();
    let catalogue = catalogue(&problem);
    let markers = (0..2).flat_map(|m| (0..3).map(move |k| Atom::MarkerShift(m, k)));
    let columns: Vec<Column> = markers.chain([Atom::CameraMount(1)]).map(Column::constant).collect();
    let group = Group { prior_std: vec![3e-3; columns.len()], columns, ..Group::default() };
    let mut model = Model::nominal(&problem);
    model.group = vec![1e-4; group.columns.len()];
    let screening = screen(&problem, &catalogue, &group, &model, NOISE, None).unwrap();
    // Numbers that may not be negative are held at 0 where the equations would have them so.
    let of_any_sign = |h: usize| !catalogue.effect(h).is_positive();
    let two_numbers = screening.scores.iter().filter(|s| s.parameters.len() == 2);
    let score = two_numbers.into_iter().find(|s| of_any_sign(s.hypothesis)).unwrap();
    let along = screening.moved_along(score).unwrap();
    let options = FitOptions { noise: NOISE, steps: 0 };
    let alone = fit(&problem, &catalogue, &group, &model, options, None).unwrap().misfit;
    assert!((screening.misfit.unwrap() - alone).abs() < 1e-9 * alone);

    let active = Active::of(&problem, &catalogue, &group, &model);
    let first = active.columns.len();
    let term = Term {
        hypothesis: score.hypothesis,
        variant: score.variant,
        parameters: vec![0.0; 2],
        prior_scale: 1.0,
    };
    let all: Vec<Column> =
        active.columns.iter().cloned().chain(catalogue.columns(&problem.scene, &term)).collect();
    let deformation = model.deformation(&problem, &catalogue, &group.columns);
    let mut normal = Normal::at(&problem, &deformation, NOISE, &all, true, None, None).unwrap();
    active.add_priors(&mut normal.h, &mut normal.g);
    for (k, std) in catalogue.hypotheses[score.hypothesis].prior_std.iter().enumerate() {
        normal.h[(first + k, first + k)] += std.powi(-2);
    }
    let together = normal.h.cholesky().unwrap().solve(&normal.g);
    let steps = along.iter().zip(&active.values).map(|(value, before)| value - before);
    let said: Vec<f64> = steps.chain(score.parameters.iter().copied()).collect();
    for (i, (a, b)) in said.iter().zip(together.iter()).enumerate() {
        assert!((a - b).abs() < 1e-6 * together.amax(), "{i}: {a} {b}");
    }
}

/// Free-form errors of the optics are summed in a pass of their own, in which every corner has its rows; all others with
/// the corners condensed, as without free forms.
#[test]
fn scores_beside_free_forms_are_those_of_the_vocabulary_alone() {
    let problem = problem();
    let vocabulary = catalogue(&problem);
    let all = Catalogue::with_free_forms(&vocabulary, &problem.scene, free_forms(&problem.scene));
    let markers = (0..2).flat_map(|m| (0..3).map(move |k| Atom::MarkerShift(m, k)));
    let columns: Vec<Column> = markers.chain([Atom::CameraMount(1)]).map(Column::constant).collect();
    let group = Group { prior_std: vec![3e-3; columns.len()], columns, ..Group::default() };
    let mut model = Model::nominal(&problem);
    model.group = vec![1e-4; group.columns.len()];
    let scores =
        |catalogue: &Catalogue| screen(&problem, catalogue, &group, &model, NOISE, None).unwrap().scores;
    let (alone, beside) = (scores(&vocabulary), scores(&all));
    assert!(beside.len() > alone.len());
    for score in &alone {
        let same = |s: &&Score| s.hypothesis == score.hypothesis && s.variant == score.variant;
        let other = beside.iter().find(same).unwrap();
        assert!((score.log_bayes - other.log_bayes).abs() < 1e-6 * (1.0 + score.log_bayes.abs()));
    }
    // With a free form of the optics in the model every corner has its rows in one pass. Next to nothing of it is
    // allowed, so that the others' scores are the same.
    let free = |s: &Score| {
        let columns = all.columns(
            &problem.scene,
            &Term {
                hypothesis: s.hypothesis,
                variant: s.variant,
                parameters: vec![0.0; s.parameters.len()],
                prior_scale: 1.0,
            },
        );
        columns.iter().any(|c| matches!(c.atom, Atom::FreeOptics(_)))
    };
    let of_optics: Vec<&Score> = beside.iter().filter(|s| free(s)).collect();
    assert!(of_optics.len() > 1);
    let mut with = model.with(&all, of_optics[0].hypothesis, of_optics[0].variant);
    with.terms[0].prior_scale = 1e-9;
    let in_one_pass = screen(&problem, &all, &group, &with, NOISE, None).unwrap().scores;
    for score in beside.iter().filter(|s| s.hypothesis != of_optics[0].hypothesis) {
        let same = |s: &&Score| s.hypothesis == score.hypothesis && s.variant == score.variant;
        let other = in_one_pass.iter().find(same).unwrap();
        let name = all.name(&problem.scene, score.hypothesis);
        let miss = (score.log_bayes - other.log_bayes).abs();
        assert!(miss < 1e-4 * (1.0 + score.log_bayes.abs()), "{name}: {score:?} {other:?}");
    }
}
