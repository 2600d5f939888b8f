//! Signatures of the joints: the error in each posture, free, beside what the cause or the free form predicts.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::data::depends_on::DependsOn;
use crate::diagnose::data::diagnosis::{Cause, Signature, SignaturePoint};
use crate::diagnose::data::recording::Recording;
use crate::diagnose::effects::Place;
use crate::diagnose::effects::hypothesis::Model;
use crate::diagnose::model::elementary::Atom;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::report::signature::free_errors;
use crate::error::Result;

/// One for each cause that moves a joint's position, and for each joint with an unexplained error.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(super) fn signatures(
    findings: &Findings<'_>,
    causes: &[Cause],
    recording: &Recording,
) -> Result<Vec<Signature>> {
    let search = &findings.search;
    let scene = &search.problem.scene;
    let found = &findings.found;
    let mut out = Vec::new();
    let mut add = |problem: &Problem,
                   (node, other): (usize, Option<usize>),
                   cause: Option<usize>,
                   model: &Model,
                   full: &Model|
     -> Result<()> {
        let scene = &problem.scene;
        let of = |model: &Model| model.deformation(problem, search.catalogue, &search.group.columns);
        let (bare, with) = (of(model), of(full));
        let points = free_errors(problem, &bare, search.measured_noise, Atom::Joint(node))?
            .iter()
            .map(|e| SignaturePoint {
                frame: recording.frames[e.frame].number,
                position: scene.q(e.frame, node),
                other_position: other.map(|k| scene.q(e.frame, k)),
                torque_nm: scene.torque(e.frame, node),
                direction: scene.direction(e.frame, node),
                time_s: scene.time_s[e.frame],
                error: e.value,
                std: e.std,
                fitted: with.joint_delta(e.frame, node) - bare.joint_delta(e.frame, node),
            })
            .collect();
        let unit = if scene.body.nodes[node].prismatic { "m" } else { "rad" };
        out.push(Signature {
            cause,
            at: format!("joint:{}", scene.body.nodes[node].joint),
            other: other.map(|k| format!("joint:{}", scene.body.nodes[k].joint)),
            unit: unit.into(),
            points,
        });
        Ok(())
    };
    for (i, term) in found.fit.model.terms.iter().enumerate() {
        if search.catalogue.is_free(term.hypothesis) {
            continue;
        }
        // What turns an axis does not move the position: it has a track.
        if !search.catalogue.columns(scene, term).iter().any(|c| matches!(c.atom, Atom::Joint(_))) {
            continue;
        }
        let place = search.catalogue.hypotheses[term.hypothesis].place;
        let name = (search.catalogue.effect(term.hypothesis).name(), place.name(scene));
        let index = causes.iter().position(|c| c.effect == name.0 && c.at == name.1);
        let other = if let Place::JointPair(_, k) = place { Some(k) } else { None };
        if let (Place::Joint(n) | Place::JointPair(n, _), Some(index)) = (place, index) {
            add(&search.problem, (n, other), Some(index), &found.fit.model.without(i), &found.fit.model)?;
        }
    }
    // What is unexplained at a joint, without the free-form error there and as that error has it.
    let mut drawn = Vec::new();
    for entry in findings.unexplained.iter().flat_map(|u| &u.places) {
        let Some(Place::Joint(node)) = entry.place else { continue };
        if drawn.contains(&node) {
            continue;
        }
        drawn.push(node);
        let on = entry.depends_on.as_ref().and_then(DependsOn::other_joint);
        let other = on.and_then(|name| scene.body.nodes.iter().position(|n| n.joint == name));
        let mut causes = found.fit.model.clone();
        causes.terms.retain(|t| {
            let at = search.catalogue.hypotheses[t.hypothesis].place.node();
            !(search.catalogue.is_free(t.hypothesis) && at == Some(node))
        });
        // A step is seen in the session as it was logged.
        let problem = match &findings.step {
            Some((step, as_logged)) if step.node == node => as_logged,
            _ => &search.problem,
        };
        add(problem, (node, other), None, &causes, &found.fit.model)?;
    }
    Ok(out)
}
