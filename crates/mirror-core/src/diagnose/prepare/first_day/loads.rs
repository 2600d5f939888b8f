//! Gravity with a wrong direction: every spring would deflect against its load.
//!
//! Springs have compliances of one sign only. If gravity is stated upside down (or along another axis) they need the
//! other sign. Then no cause of the vocabulary fits, and the right direction explains with one parameter what many
//! others cannot.

use super::mistake::Mistake;
use super::verify::{all_at_once, smaller};
use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::effects::{Effect, vocabulary};
use crate::diagnose::likelihood::fit::{FitOptions, Group, fit};
use crate::diagnose::likelihood::noise::effective;
use crate::diagnose::likelihood::score_test::screen;
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::{A_GAP, BEYOND_DOUBT, MAJORITY, NEARLY_ALL};
use crate::error::Result;
use core::f64::consts::{FRAC_PI_2, PI};
use nalgebra::{Rotation3, Vector3};
use std::sync::Arc;

/// Set free where the parts are mounted by hand: mounts alone leave no gap small enough to see a spring in.
const MOUNTS: [&str; 4] = ["board_mount", "camera_mount", "marker_mount", "joint_offset"];

/// The rotation of gravity with which a single spring explains what no cause explains under the stated direction, with
/// everything mounted as modelled, else with mounts and zeros free.
///
/// # Errors
/// Invalid parameters of camera or mirror.
pub(super) fn turned_gravity(problem: &Problem) -> Result<Option<(Mistake, f64)>> {
    let exact = Beside { group: Group::default(), start: Model::nominal(problem) };
    // Where nothing is to be explained mounts need not be fitted.
    let Some(noise) = exact.gap(problem)? else { return Ok(None) };
    if let Some(found) = turned_beside(problem, &exact, noise)? {
        return Ok(Some(found));
    }
    let mounts = Beside::mounts(problem)?;
    let Some(noise) = mounts.gap(problem)? else { return Ok(None) };
    turned_beside(problem, &mounts, noise)
}

/// What is free besides a cause, and where its fit starts.
struct Beside {
    group: Group,
    start: Model,
}

impl Beside {
    /// Mounts and zeros, fitted alone.
    fn mounts(problem: &Problem) -> Result<Self> {
        let effects = vocabulary().into_iter().filter(|e| MOUNTS.contains(&e.name()));
        let catalogue = Catalogue::new(&problem.scene, effects.map(Arc::from).collect(), &[]);
        let group = all_at_once(problem, &catalogue);
        let mut start = Model::nominal(problem);
        start.group = vec![0.0; group.columns.len()];
        for _ in 0..SOLVER.rounds {
            let deformation = start.deformation(problem, &catalogue, &group.columns);
            let noise = effective(problem, &deformation, problem.noise, None)?;
            let options = FitOptions { noise, steps: SOLVER.loose_steps };
            start = fit(problem, &catalogue, &group, &start, options, None)?.model;
        }
        Ok(Self { group, start })
    }

    /// The noise at which what is left would be as large as it is; none where that is no gap.
    fn gap(&self, problem: &Problem) -> Result<Option<Noise>> {
        let none = Catalogue::new(&problem.scene, Vec::new(), &[]);
        let deformation = self.start.deformation(problem, &none, &self.group.columns);
        let noise = effective(problem, &deformation, problem.noise, None)?;
        Ok((problem.of_observations(noise) >= A_GAP * problem.of_observations(problem.noise))
            .then_some(noise))
    }
}

fn turned_beside(problem: &Problem, beside: &Beside, noise: Noise) -> Result<Option<(Mistake, f64)>> {
    let Some(down) = problem.scene.gravity.try_normalize(1e-9) else { return Ok(None) };
    let nominal = problem.nominal();
    let Some(stated) = best(problem.clone(), vocabulary(), beside, noise)? else { return Ok(None) };
    let across = down.cross(&if down.x.abs() < 0.8 { Vector3::x() } else { Vector3::y() }).normalize();
    let other = down.cross(&across);
    let turns = [across * PI, across * FRAC_PI_2, across * -FRAC_PI_2, other * FRAC_PI_2, other * -FRAC_PI_2];
    let mut found: Option<(Likeliest, Vector3<f64>)> = None;
    for turn in turns {
        let mut turned = problem.clone();
        turned.scene.gravity = Rotation3::new(turn) * problem.scene.gravity;
        turned.scene.update_loads(&nominal);
        let springs = vocabulary().into_iter().filter(|e| e.depends_on_load()).collect();
        if let Some(best) = best(turned, springs, beside, noise)?
            && found.as_ref().is_none_or(|(other, _)| best.log_bayes > other.log_bayes)
        {
            found = Some((best, turn));
        }
    }
    let Some((turned, turn)) = found else { return Ok(None) };
    let likelier = turned.log_bayes > stated.log_bayes + BEYOND_DOUBT;
    let turned = turned.fitted(noise)?;
    let excess = |best: &Best| {
        (problem.of_observations(best.left) / problem.of_observations(problem.noise)).powi(2) - 1.0
    };
    let a_gap = A_GAP * A_GAP - 1.0;
    // Neither of the two below, whatever the best cause under the stated gravity leaves.
    if !likelier && excess(&turned) >= a_gap {
        return Ok(None);
    }
    let stated = stated.fitted(noise)?;
    // With the nominal model's scatter, and with clearly less left than by the best cause under the stated gravity,
    // whatever else is wrong;
    let much =
        likelier && problem.of_observations(turned.left) < NEARLY_ALL * problem.of_observations(stated.left);
    // or if the spring alone leaves no gap, compared with the noise that it leaves. Together with other causes a
    // spring of the wrong sign may only absorb a part of theirs.
    let all = excess(&turned) < a_gap.min(MAJORITY * excess(&stated));
    if !(much || all) {
        return Ok(None);
    }
    let at = smaller(turned.left, stated.left);
    let odds = turned.log_evidence(at)? - stated.log_evidence(at)?;
    Ok((odds > BEYOND_DOUBT).then_some((Mistake::Gravity { turn }, odds)))
}

/// The best single cause under a direction of gravity, by the score test.
struct Likeliest {
    problem: Problem,
    group: Group,
    catalogue: Catalogue,
    /// At the linear estimate.
    model: Model,
    log_bayes: f64,
}

/// The same, fitted.
struct Best {
    problem: Problem,
    group: Group,
    catalogue: Catalogue,
    model: Model,
    /// What it leaves.
    left: Noise,
}

impl Likeliest {
    fn fitted(self, noise: Noise) -> Result<Best> {
        let Self { problem, group, catalogue, model, .. } = self;
        let options = FitOptions { noise, steps: SOLVER.loose_steps };
        let model = fit(&problem, &catalogue, &group, &model, options, None)?.model;
        let deformation = model.deformation(&problem, &catalogue, &group.columns);
        let left = effective(&problem, &deformation, problem.noise, None)?;
        Ok(Best { problem, group, catalogue, model, left })
    }
}

impl Best {
    fn log_evidence(&self, noise: Noise) -> Result<f64> {
        let options = FitOptions { noise, steps: SOLVER.loose_steps };
        Ok(fit(&self.problem, &self.catalogue, &self.group, &self.model, options, None)?.log_evidence)
    }
}

fn best(
    problem: Problem,
    effects: Vec<Box<dyn Effect>>,
    beside: &Beside,
    noise: Noise,
) -> Result<Option<Likeliest>> {
    let catalogue = Catalogue::new(&problem.scene, effects.into_iter().map(Arc::from).collect(), &[]);
    let (group, model) = (beside.group.clone(), &beside.start);
    let screening = screen(&problem, &catalogue, &group, model, noise, None)?;
    // What is free already is no cause.
    let is_free = |h: usize| !group.columns.is_empty() && MOUNTS.contains(&catalogue.effect(h).name());
    let Some(score) = screening.scores.iter().find(|s| !is_free(s.hypothesis)) else { return Ok(None) };
    let along = screening.moved_along(score).map(|values| screening.active.model(model, &values));
    let moved = along.unwrap_or_else(|| model.clone());
    let mut with = moved.with(&catalogue, score.hypothesis, score.variant);
    if let Some(term) = with.terms.last_mut() {
        let positive = catalogue.effect(score.hypothesis).is_positive();
        term.parameters = score.parameters.iter().map(|p| if positive { p.max(0.0) } else { *p }).collect();
    }
    let log_bayes = score.log_bayes;
    Ok(Some(Likeliest { problem, group, catalogue, model: with, log_bayes }))
}
