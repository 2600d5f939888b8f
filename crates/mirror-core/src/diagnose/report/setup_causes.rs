//! What a person should measure again: the displacements of board, camera and markers, each as a cause of its own with its values.
//!
//! Whether a mount is displaced: the Bayes factor of its values under their spread against none at all, by the ratio of the
//! posterior's and the prior's densities at zero (Savage and Dickey), `log BF = ½ μᵀ Σ⁻¹ μ + ½ log |Σ| − Σ log s_k`.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::data::diagnosis::{Cause, Estimate};
use crate::diagnose::effects::Concern;
use crate::diagnose::likelihood::fit::Fit;
use crate::diagnose::model::elementary::Atom;
use crate::diagnose::random_effects::geometric_tolerances::{Geometry, single_effect};
use crate::diagnose::report::rms_shift::rms_shift;
use crate::error::Result;
use nalgebra::{DMatrix, DVector};

/// A displacement is told from these log odds on: 3 is 20 to 1.
const LEAST_LOG_ODDS: f64 = 3.0;
/// Evidence is taken to this power, as for every cause: noise is never quite what it is thought to be.
const TEMPER: f64 = 0.35;
/// What is kept back for a cause that nobody thought of.
const UNTHOUGHT_OF: f64 = 0.01;

/// The displaced mounts of a set-up, as causes, each with its columns of the group.
///
/// # Errors
/// A camera or mirror that cannot be.
pub(crate) fn setup_causes(findings: &Findings<'_>, setup: &Geometry) -> Result<Vec<(Cause, Vec<usize>)>> {
    if !setup.mounted {
        return Ok(Vec::new());
    }
    let (search, fit) = (&findings.search, &findings.found.fit);
    let scene = &search.problem.scene;
    let all = search.deformation(&fit.model);
    let mut out = Vec::new();
    for (effect, place) in setup.mounts() {
        let members: Vec<(usize, &'static str)> = setup
            .group
            .columns
            .iter()
            .enumerate()
            .filter_map(|(k, c)| {
                single_effect(c.atom).filter(|e| (e.0, e.1) == (effect, place)).map(|e| (k, e.2))
            })
            .collect();
        let columns: Vec<usize> = members.iter().map(|m| m.0).collect();
        let odds = log_bayes(setup, fit, &columns);
        if odds < LEAST_LOG_ODDS {
            continue;
        }
        let mut without = fit.model.clone();
        columns.iter().for_each(|&k| without.group[k] = 0.0);
        let first = fit.model.nuisances.len();
        let parameters = members.iter().map(|&(k, name)| {
            let std = fit.covariance[(first + k, first + k)].max(0.0).sqrt();
            (name.to_owned(), Estimate { value: fit.model.group[k], std })
        });
        let words = search.catalogue.find(effect, place).map_or("", |h| search.catalogue.effect(h).words());
        let cause = Cause {
            effect: effect.into(),
            at: place.name(scene),
            kind: Concern::Setup.word().into(),
            probability: (1.0 - UNTHOUGHT_OF) / (1.0 + (-TEMPER * odds).exp()),
            parameters: parameters.collect(),
            stability: None,
            alternatives: Vec::new(),
            words: words.to_owned(),
            rms_shift: rms_shift(findings, &search.deformation(&without), &all)?,
            members: Vec::new(),
            frames: Vec::new(),
        };
        out.push((cause, columns));
    }
    Ok(out)
}

/// Log Bayes factor of the joints' zeros all together.
pub(crate) fn zeros_log_bayes(setup: &Geometry, fit: &Fit) -> f64 {
    let zeros = setup.group.columns.iter().enumerate().filter(|(_, c)| matches!(c.atom, Atom::Joint(_)));
    log_bayes(setup, fit, &zeros.map(|(k, _)| k).collect::<Vec<_>>())
}

/// Log Bayes factor of some of the group's values under their spreads against zero.
fn log_bayes(setup: &Geometry, fit: &Fit, columns: &[usize]) -> f64 {
    let first = fit.model.nuisances.len();
    let spread = |k: usize| setup.group.prior_std[k];
    // In units of the spreads: the prior is standard normal.
    let covariance = DMatrix::from_fn(columns.len(), columns.len(), |i, j| {
        let (a, b) = (columns[i], columns[j]);
        fit.covariance[(first + a, first + b)] / (spread(a) * spread(b))
    });
    let values = DVector::from_fn(columns.len(), |i, _| fit.model.group[columns[i]] / spread(columns[i]));
    let Some(factor) = covariance.cholesky() else { return 0.0 };
    let log_det = 2.0 * factor.l_dirty().diagonal().iter().map(|x| x.ln()).sum::<f64>();
    0.5 * values.dot(&factor.solve(&values)) + 0.5 * log_det
}
