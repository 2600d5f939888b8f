//! The members of a group of small errors as they are reported.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::assessment::uncertainty::Deviations;
use crate::diagnose::data::diagnosis::Member;
use crate::diagnose::random_effects::geometric_tolerances::Geometry;

/// The small errors of a group, with the outliers that have their own prior in the model.
pub(super) fn members(
    findings: &Findings<'_>,
    geometry: &Geometry,
    outliers: &[usize],
    deviations: &Deviations,
) -> Vec<Member> {
    let (search, fit) = (&findings.search, &findings.found.fit);
    let scene = &search.problem.scene;
    let mut members = geometry.members(fit, &deviations.group, scene);
    for &i in outliers {
        let term = &fit.model.terms[i];
        let effect = search.catalogue.effect(term.hypothesis);
        let at = search.catalogue.hypotheses[term.hypothesis].place.name(scene);
        for ((parameter, value), std) in
            effect.parameters().into_iter().zip(&term.parameters).zip(&deviations.stds[i])
        {
            let own = |m: &&mut Member| m.effect == effect.name() && m.at == at && m.parameter == parameter;
            if let Some(member) = members.iter_mut().find(own) {
                member.value += value;
                member.std = *std;
            }
        }
    }
    members
}
