//! Displaced mounts that a person should measure again: board, camera and markers, each as a cause with its values.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::assessment::uncertainty::Deviations;
use crate::diagnose::data::diagnosis::{Cause, Estimate};
use crate::diagnose::effects::Concern;
use crate::diagnose::likelihood::fit::Fit;
use crate::diagnose::likelihood::probability::tempered;
use crate::diagnose::principles::LEAST_LOG_ODDS;
use crate::diagnose::random_effects::displaced::{log_bayes, log_bayes_of, members_of};
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::random_effects::small_errors::Kind;
use crate::diagnose::report::rms_shift::rms_shift;
use crate::error::Result;

/// The displaced mounts, as causes, each with its columns of the group.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn setup_causes(
    findings: &Findings<'_>,
    setup: &Geometry,
    deviations: &Deviations,
) -> Result<Vec<(Cause, Vec<usize>)>> {
    if !setup.mounted {
        return Ok(Vec::new());
    }
    let (search, fit) = (&findings.search, &findings.found.fit);
    let scene = &search.problem.scene;
    let all = search.deformation(&fit.model);
    let mut out = Vec::new();
    for (effect, place) in setup.mounts() {
        let members = members_of(setup, effect, place);
        let columns: Vec<usize> = members.iter().map(|m| m.0).collect();
        let odds = log_bayes_of(setup, fit, &columns, &deviations.group);
        if odds < LEAST_LOG_ODDS {
            continue;
        }
        let mut without = fit.model.clone();
        columns.iter().for_each(|&k| without.group[k] = 0.0);
        let parameters = members
            .into_iter()
            .map(|(k, name)| (name, Estimate { value: fit.model.group[k], std: deviations.group[k] }));
        let words = search.catalogue.find(effect, place).map_or("", |h| search.catalogue.effect(h).words());
        let cause = Cause {
            effect: effect.into(),
            at: place.name(scene),
            kind: Concern::Setup.word().into(),
            probability: tempered(odds),
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
    let zeros = setup.group.columns.iter().enumerate().filter(|(_, c)| Kind::of(c) == Kind::Angle);
    log_bayes(setup, fit, &zeros.map(|(k, _)| k).collect::<Vec<_>>())
}
