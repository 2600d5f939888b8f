//! The causes on another session: predicted with the values found; only that session's nuisance parameters are
//! fitted.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::data::diagnosis::Checked;
use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::effects::own::own_effects;
use crate::diagnose::effects::vocabulary;
use crate::diagnose::likelihood::fit::{FitOptions, Group, fit};
use crate::diagnose::likelihood::noise;
use crate::diagnose::likelihood::saturated::free_markers;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::prepare::options::OtherSession;
use crate::error::Result;
use std::sync::Arc;

/// Predicts another session with the causes as they were found; only its own nuisances are fitted.
pub(crate) fn check(findings: &Findings<'_>, other: &OtherSession) -> Result<Checked> {
    let recording = other.recording.clone().validated(other.robot.position_count())?;
    let mut problem = Problem::new(&other.robot, &recording)?;
    problem.cancel = findings.search.problem.cancel.clone();
    let nominal_deformation = problem.nominal();
    problem.noise = noise::estimate(&problem, &nominal_deformation, problem.noise)?;
    let here = &findings.search;
    let mut effects = vocabulary();
    effects.extend(own_effects(&other.own, &problem.scene)?);
    let catalogue = Catalogue::new(&problem.scene, effects.into_iter().map(Arc::from).collect(), &[]);
    let mut model = Model::nominal(&problem);
    model.frozen = true;
    let none = Group::default();
    let measure = |problem: &Problem, model: &Model, group: &Group| -> Result<Option<f64>> {
        let mut model = model.clone();
        let mut problem = problem.clone();
        for _ in 0..2 {
            let deformation = model.deformation(&problem, &catalogue, &group.columns);
            problem.scene.update_loads(&deformation);
            let scatter = noise::effective(&problem, &deformation, problem.noise, None)?;
            model = fit(&problem, &catalogue, group, &model, FitOptions { noise: scatter, steps: 6 }, None)?
                .model;
        }
        let deformation = model.deformation(&problem, &catalogue, &group.columns);
        let postures = free_markers(&problem, &deformation, problem.noise, true, None)?;
        let (sum, count) = postures
            .iter()
            .flat_map(|p| &p.markers)
            .fold((0.0, 0.0), |(s, c), m| (s + m.displacement.norm_squared(), c + 1.0));
        Ok((count > 0.0).then(|| (sum / count).sqrt()))
    };
    let before_m = measure(&problem, &model, &none)?;
    model.terms = findings
        .found
        .fit
        .model
        .causes_in((here.catalogue, &here.problem.scene), (&catalogue, &problem.scene));
    let group =
        if here.group.columns.iter().all(|c| problem.has_atom(c.atom)) { here.group.clone() } else { none };
    if group.columns.len() == findings.found.fit.model.group.len() {
        model.group.clone_from(&findings.found.fit.model.group);
    }
    let after_m = measure(&problem, &model, &group)?;
    Ok(Checked { session: other.name.clone(), before_m, after_m })
}
