//! A gear box of another ratio: its error is far larger than the prior of ratios, and no eccentricity takes a part of it.

use super::gap_world::{Plan, World, Wrong};
use super::prior::{NOISE, search};
use super::shortcuts::named;
use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::effects::vocabulary;
use crate::diagnose::model::problem::Problem;
use crate::robot::Robot;
use std::sync::Arc;

#[test]
fn another_ratio_is_not_shared_with_an_eccentric_gear() {
    let world = World::new(4, true);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let wrong = vec![Wrong::Ratio(world.bone("r_elbow"), 0.8)];
    let plan = Plan { postures: 24, noise_px: 0.15, wrong, ..Plan::default() };
    let problem = Problem::new(&robot, &world.record(&plan)).unwrap();
    let gears = vocabulary().into_iter().filter(|effect| effect.name().starts_with("gear_"));
    let catalogue = Catalogue::new(&problem.scene, gears.map(Arc::from).collect(), &[]);
    let [ratio, eccentric] = ["gear_ratio@joint:r_elbow", "gear_eccentricity@joint:r_elbow"]
        .map(|name| named(&problem, &catalogue, name));
    let mut search = search(&problem, &catalogue);
    let fitted = |causes: &[usize]| {
        let model = causes.iter().fold(Model::nominal(&problem), |m, &h| m.with(&catalogue, h, 0.0));
        let rough = search.fit(&model, search.effective(&model).unwrap(), 8).unwrap();
        search.fit(&rough.model, NOISE, 12).unwrap()
    };
    // At the usual prior two that share the error are the more probable.
    let [one, both] = [fitted(&[ratio]), fitted(&[ratio, eccentric])];
    let ahead = search.log_posterior(&both) - search.log_posterior(&one);
    assert!(ahead > 3.0, "{ahead} {:?} {:?}", one.model.terms, both.model.terms);
    let found = search.run(Model::nominal(&problem)).unwrap();
    let causes: Vec<usize> = found.fit.model.terms.iter().map(|t| t.hypothesis).collect();
    assert_eq!(causes, [ratio], "{:#?}", found.trace);
    let term = &found.fit.model.terms[0];
    assert!((term.parameters[0] - 0.8).abs() < 0.01, "{term:?}");
}
