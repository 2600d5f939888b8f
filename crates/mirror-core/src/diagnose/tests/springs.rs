//! Springs among small errors everywhere: how soft joints are beside each other, and which spring is none of many.

use super::gap_world::{Plan, World};
use crate::diagnose::effects::hypothesis::{Catalogue, Model, Term};
use crate::diagnose::effects::{Place, vocabulary};
use crate::diagnose::model::problem::Problem;
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::random_effects::outlier_tolerances::{name_outlying, put_back};
use crate::diagnose::random_effects::small_errors::softness;
use crate::robot::Robot;
use std::sync::Arc;

/// The arms of the world; the joints whose names hold it are made for ten times the torque.
fn problem(large: &str, effort: f64) -> Problem {
    let world = World::new(4, true);
    let urdf = world.urdf();
    let mut parts = urdf.split("<joint name=\"");
    let mut text = parts.next().unwrap().to_owned();
    for part in parts {
        text += "<joint name=\"";
        let stated = if part.split('"').next().unwrap().contains(large) { 10.0 * effort } else { effort };
        text += &part.replace("effort=\"1\"", &format!("effort=\"{stated}\""));
    }
    let robot = Robot::from_urdf_str(&text).unwrap();
    Problem::new(&robot, &world.record(&Plan { postures: 20, ..Plan::default() })).unwrap()
}

fn loaded(problem: &Problem) -> Vec<usize> {
    let scene = &problem.scene;
    (0..scene.nodes()).filter(|&n| scene.relevant[n] && scene.largest_torque(n) > 1e-6).collect()
}

#[test]
fn a_joint_is_as_soft_as_it_is_small_and_the_most_loaded_for_its_size_gives_way_by_the_spread() {
    for effort in [1.0, 50.0] {
        let problem = problem("shoulder", effort);
        let scene = &problem.scene;
        let joints = loaded(&problem);
        let soft = softness(scene, joints.iter().copied());
        let large = |n: usize| scene.body.nodes[n].joint.contains("shoulder");
        let of = |is_large: bool| joints.iter().find(|&&n| large(n) == is_large).map(|n| soft[n]).unwrap();
        assert!((of(false) / of(true) - 10.0).abs() < 1e-9);
        let most = joints.iter().map(|n| soft[n] * scene.largest_torque(*n)).fold(0.0, f64::max);
        assert!((most - 1.0).abs() < 1e-12, "{most}");
    }
    // 0 states nothing: all joints are of one size.
    let problem = problem("shoulder", 0.0);
    let soft = softness(&problem.scene, loaded(&problem).into_iter());
    assert!(soft.values().all(|s| (s / soft.values().next().unwrap() - 1.0).abs() < 1e-12));
}

#[test]
fn a_spring_that_outweighs_all_others_is_named_and_goes_back_where_another_is_as_large() {
    let problem = problem("shoulder", 1.0);
    let (scene, catalogue) = (
        &problem.scene,
        Catalogue::new(&problem.scene, vocabulary().into_iter().map(Arc::from).collect(), &[]),
    );
    let geometry = Geometry::new(&problem, &catalogue, false);
    let springs: Vec<usize> = loaded(&problem);
    let gives = |n: usize, rad: f64| rad / scene.largest_torque(n);
    let spring = |n: usize| catalogue.find("joint_compliance", Place::Joint(n)).unwrap();
    let columns = catalogue_columns(&geometry, &springs);
    let mut model = Model { group: vec![0.0; geometry.group.columns.len()], ..Model::nominal(&problem) };
    model.group[columns[0]] = gives(springs[0], 0.03);
    model.group[columns[1]] = gives(springs[1], 0.003);
    assert_eq!(name_outlying((&geometry, scene), &catalogue, &mut model), Some(spring(springs[0])));
    assert_eq!((model.terms.len(), model.group[columns[0]]), (1, 0.0));
    let named = [spring(springs[0])];
    // Alone it stays named; beside a second one of its size both are two of many.
    assert!(!put_back((&geometry, scene), &catalogue, &named, &mut model.clone()));
    model.terms.push(Term {
        hypothesis: spring(springs[1]),
        variant: 0.0,
        parameters: vec![gives(springs[1], 0.02)],
        prior_scale: 1.0,
    });
    let both = [named[0], spring(springs[1])];
    assert!(put_back((&geometry, scene), &catalogue, &both, &mut model));
    assert!(model.terms.is_empty());
    assert!((model.group[columns[0]] - gives(springs[0], 0.03)).abs() < 1e-15);
    assert!((model.group[columns[1]] - gives(springs[1], 0.023)).abs() < 1e-15);
}

/// The group's column of each joint's spring.
fn catalogue_columns(geometry: &Geometry, joints: &[usize]) -> Vec<usize> {
    use crate::diagnose::model::elementary::{Atom, Weight};
    let of = |n: usize| {
        let own = |c: &crate::diagnose::model::elementary::Column| {
            c.atom == Atom::Joint(n) && matches!(c.weight, Weight::Torque(_))
        };
        geometry.group.columns.iter().position(own).unwrap()
    };
    joints.iter().map(|&n| of(n)).collect()
}
