//! Design of experiments: the next postures, which would best separate the remaining alternatives.
//!
//! Postures are drawn that the robot can take and that camera and mirror can see ([`Draws`]). Each is predicted by
//! the cause and by its alternative, both as fitted. The posture in which the visible markers differ most separates
//! them best (T-optimal design: Atkinson and Fedorov 1975). The postures chosen differ by 10° or more from every
//! recorded one, and from each other, where there are such. They must be taken in the given order: play and friction
//! depend on the side from which a joint arrives.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::assessment::posture_draws::Draws;
use crate::diagnose::data::recording::Recording;
use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::effects::vocabulary;
use crate::diagnose::model::kinematics::NodePoses;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::model::solver::NEGLIGIBLE;
use crate::diagnose::principles::{Size, WORTH_NAMING};
use crate::diagnose::selection::standing::Standing;
use crate::error::Result;
use crate::robot::Robot;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Number of postures proposed for a pair of alternatives.
const PROPOSED: Size = 4;

/// Postures that would separate each cause from its most probable alternative; none where there are no
/// alternatives.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn next_postures(
    findings: &Findings<'_>,
    standings: &[Option<Standing>],
    robot: &Robot,
    recording: &Recording,
) -> Result<Vec<BTreeMap<String, f64>>> {
    let search = &findings.search;
    let mut out = Vec::new();
    let mut drawn: Option<(Draws, Problem, Catalogue)> = None;
    for (i, standing) in standings.iter().enumerate() {
        let rival = standing.as_ref().and_then(|s| s.rivals.first());
        let Some(rival) = rival.filter(|r| r.probability > WORTH_NAMING) else {
            continue;
        };
        // What a user's own effect does in further postures, only he knows.
        let own = |h: usize| search.catalogue.effect(h).is_tabulated();
        if own(rival.hypothesis) || findings.found.fit.model.terms.iter().any(|t| own(t.hypothesis)) {
            continue;
        }
        let rest = findings.found.fit.model.without(i);
        let rival = search.fit(
            &rest.with(search.catalogue, rival.hypothesis, rival.variant),
            findings.found.noise,
            8,
        )?;
        if drawn.is_none() {
            let draws = Draws::new(robot, recording, &search.problem)?;
            if draws.recording.frames.is_empty() {
                return Ok(out);
            }
            let problem = Problem::new(robot, &draws.recording)?;
            let effects = vocabulary().into_iter().map(Arc::from).collect();
            let catalogue = Catalogue::new(&problem.scene, effects, &[]);
            drawn = Some((draws, problem, catalogue));
        }
        let Some((draws, problem, catalogue)) = &drawn else { continue };
        let predict = |model: &Model| positions(problem, catalogue, model, search);
        let (own, other) = (predict(&findings.found.fit.model), predict(&rival.model));
        let mut separation: Vec<(usize, f64)> = own
            .iter()
            .zip(&other)
            .zip(&draws.shown)
            .map(|((a, b), shown)| {
                let seen = a.iter().zip(b).zip(shown).filter(|(_, shown)| **shown);
                seen.map(|((p, q), _)| (p - q).norm_squared()).sum::<f64>().sqrt()
            })
            .enumerate()
            .collect();
        separation.sort_by(|a, b| b.1.total_cmp(&a.1));
        separation.retain(|s| s.1 > NEGLIGIBLE);
        let mut chosen = far_apart(draws, recording, &separation);
        chosen.sort_unstable();
        for f in chosen {
            let commanded = &draws.recording.frames[f].commanded;
            let told = robot.position_names().zip(commanded).enumerate();
            // A joint that is held at its rest position anyway need not be commanded.
            let told = told.filter(|(k, (_, q))| draws.is_drawn(*k) || **q != 0.0);
            out.push(told.map(|(_, (name, q))| (name.to_owned(), *q)).collect());
        }
    }
    Ok(out)
}

/// The best postures that are far from all recorded ones and from each other; the best of all where there are none.
fn far_apart(draws: &Draws, visited: &Recording, separation: &[(usize, f64)]) -> Vec<usize> {
    let commanded = |f: usize| &draws.recording.frames[f].commanded;
    let new = |f: usize| visited.frames.iter().all(|v| draws.are_apart(commanded(f), &v.commanded));
    let mut chosen: Vec<usize> = Vec::new();
    for &(f, _) in separation {
        let apart = chosen.iter().all(|&c| draws.are_apart(commanded(f), commanded(c)));
        if chosen.len() < PROPOSED && apart && new(f) {
            chosen.push(f);
        }
    }
    if chosen.is_empty() {
        chosen.extend(separation.iter().take(PROPOSED).map(|s| s.0));
    }
    chosen
}

/// Where a model has the markers in each posture, in the root's frame, m.
fn positions(
    problem: &Problem,
    catalogue: &Catalogue,
    model: &Model,
    search: &crate::diagnose::selection::search::Search<'_>,
) -> Vec<Vec<nalgebra::Vector3<f64>>> {
    let mut here = Model::nominal(problem);
    here.terms = model.causes_in((search.catalogue, &search.problem.scene), (catalogue, &problem.scene));
    let deformation = here.deformation(problem, catalogue, &[]);
    let nodes = problem.scene.nodes();
    let mut poses = NodePoses::new(nodes);
    (0..problem.scene.frames)
        .map(|f| {
            poses.update(
                &problem.scene.body,
                &problem.scene.commanded[f * nodes..(f + 1) * nodes],
                &deformation,
                f,
            );
            let root = poses.site(&problem.scene.body.root);
            (0..problem.marker_sites.len())
                .map(|m| {
                    let shift = poses.site(&problem.marker_mounts[m]).r * deformation.marker_shift_in(f, m);
                    root.inverse_point(&(poses.site(&problem.marker_sites[m]).t + shift))
                })
                .collect()
        })
        .collect()
}
