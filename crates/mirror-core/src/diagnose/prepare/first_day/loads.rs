//! Gravity that points elsewhere: every spring would give way against its load.
//!
//! Springs have compliances of one sign only. Under a gravity that is stated upside down (or along another axis) they need the
//! other: no cause of the vocabulary fits then, and the right direction explains with one what many others cannot.

use super::mistake::Mistake;
use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::effects::{Effect, vocabulary};
use crate::diagnose::likelihood::fit::{FitOptions, Group, fit};
use crate::diagnose::likelihood::noise::effective;
use crate::diagnose::likelihood::score_test::screen;
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::principles::{A_GAP, BEYOND_DOUBT, NEARLY_ALL};
use crate::error::Result;
use core::f64::consts::{FRAC_PI_2, PI};
use nalgebra::{Rotation3, Vector3};
use std::sync::Arc;

/// Gravity's turn that lets a single spring explain what no cause explains under the stated direction.
///
/// # Errors
/// Invalid parameters of camera or mirror.
pub(super) fn turned_gravity(problem: &Problem) -> Result<Option<(Mistake, f64)>> {
    let Some(down) = problem.scene.gravity.try_normalize(1e-9) else { return Ok(None) };
    let nominal = problem.nominal();
    let noise = effective(problem, &nominal, problem.noise, None)?;
    if size(problem, noise) < A_GAP * size(problem, problem.noise) {
        return Ok(None);
    }
    let stated = best(problem, vocabulary(), noise)?;
    let across = down.cross(&if down.x.abs() < 0.8 { Vector3::x() } else { Vector3::y() }).normalize();
    let other = down.cross(&across);
    let turns = [across * PI, across * FRAC_PI_2, across * -FRAC_PI_2, other * FRAC_PI_2, other * -FRAC_PI_2];
    let mut found: Option<(f64, f64, Vector3<f64>)> = None;
    for turn in turns {
        let mut turned = problem.clone();
        turned.scene.gravity = Rotation3::new(turn) * problem.scene.gravity;
        turned.scene.update_loads(&nominal);
        let springs = vocabulary().into_iter().filter(|e| e.depends_on_load()).collect();
        let (log_bayes, left) = best(&turned, springs, noise)?;
        if found.is_none_or(|f| log_bayes > f.0) {
            found = Some((log_bayes, left, turn));
        }
    }
    // The remainder must be clearly less than what the best cause under the stated gravity leaves.
    let clear = found.filter(|f| f.0 > stated.0 + BEYOND_DOUBT && f.1 < NEARLY_ALL * stated.1);
    Ok(clear.map(|f| (Mistake::Gravity { turn: f.2 }, f.0 - stated.0)))
}

/// The best cause's log Bayes factor, and the size of the residuals that it leaves when fitted.
fn best(problem: &Problem, effects: Vec<Box<dyn Effect>>, noise: Noise) -> Result<(f64, f64)> {
    let catalogue = Catalogue::new(&problem.scene, effects.into_iter().map(Arc::from).collect(), &[]);
    let model = Model::nominal(problem);
    let group = Group::default();
    let scores = screen(problem, &catalogue, &group, &model, noise, None)?.scores;
    let Some(score) = scores.first() else { return Ok((f64::NEG_INFINITY, f64::INFINITY)) };
    let mut with = model.with(&catalogue, score.hypothesis, score.variant);
    if let Some(term) = with.terms.last_mut() {
        let positive = catalogue.effect(score.hypothesis).is_positive();
        term.parameters = score.parameters.iter().map(|p| if positive { p.max(0.0) } else { *p }).collect();
    }
    let fitted = fit(problem, &catalogue, &group, &with, FitOptions { noise, steps: 6 }, None)?;
    let deformation = fitted.model.deformation(problem, &catalogue, &group.columns);
    Ok((score.log_bayes, size(problem, effective(problem, &deformation, problem.noise, None)?)))
}

fn size(problem: &Problem, noise: Noise) -> f64 {
    if problem.camera.is_some() { noise.marker_px } else { noise.point_m }
}
