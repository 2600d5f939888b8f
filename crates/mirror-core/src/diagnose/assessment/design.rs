//! The next postures: where rivals remain, the few commanded postures that would separate them best.
//!
//! Many postures are drawn from the ranges that the session has shown to be reachable and in view. Each is predicted by
//! the cause and by its rival, both as fitted; the posture at which the markers come out farthest apart separates them best
//! (T-optimal design: Atkinson and Fedorov 1975). The postures are to be taken in the order given: for play and friction it
//! matters from which side a joint arrives.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::data::recording::Recording;
use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::effects::vocabulary;
use crate::diagnose::model::kinematics::NodePoses;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::selection::alternatives::Standing;
use crate::error::Result;
use crate::robot::Robot;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Postures that are drawn.
const DRAWN: usize = 80;
/// Postures that are proposed for a pair of rivals.
const PROPOSED: usize = 4;
/// Rivals below this probability need no experiment.
const WORTH_AN_EXPERIMENT: f64 = 0.05;
/// Rivals that come out nearer than this (m) in every posture are not worth moving for.
const LEAST_SEPARATION_M: f64 = 1e-5;

/// Postures that would tell each cause from its likeliest rival; none where there are no rivals.
///
/// # Errors
/// A camera or mirror that cannot be.
pub(crate) fn next_postures(
    findings: &Findings<'_>,
    standings: &[Option<Standing>],
    robot: &Robot,
    recording: &Recording,
) -> Result<Vec<BTreeMap<String, f64>>> {
    let search = &findings.search;
    let mut out = Vec::new();
    let mut drawn: Option<(Recording, Problem, Catalogue)> = None;
    for (i, standing) in standings.iter().enumerate() {
        let rival = standing.as_ref().and_then(|s| s.rivals.first());
        let Some(rival) = rival.filter(|r| r.probability > WORTH_AN_EXPERIMENT) else {
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
            let postures = draw(recording);
            let problem = Problem::new(robot, &postures)?;
            let effects = vocabulary().into_iter().map(Arc::from).collect();
            let catalogue = Catalogue::new(&problem.scene, effects, &[]);
            drawn = Some((postures, problem, catalogue));
        }
        let Some((postures, problem, catalogue)) = &drawn else { continue };
        let predict = |model: &Model| positions(problem, catalogue, model, search);
        let (own, other) = (predict(&findings.found.fit.model), predict(&rival.model));
        let mut separation: Vec<(usize, f64)> = own
            .iter()
            .zip(&other)
            .map(|(a, b)| a.iter().zip(b).map(|(p, q)| (p - q).norm_squared()).sum::<f64>().sqrt())
            .enumerate()
            .collect();
        separation.sort_by(|a, b| b.1.total_cmp(&a.1));
        let mut chosen: Vec<usize> =
            separation.iter().take(PROPOSED).filter(|s| s.1 > LEAST_SEPARATION_M).map(|s| s.0).collect();
        chosen.sort_unstable();
        for f in chosen {
            let commanded = &postures.frames[f].commanded;
            out.push(robot.position_names().map(str::to_owned).zip(commanded.iter().copied()).collect());
        }
    }
    Ok(out)
}

/// A recording of postures drawn within the session's own ranges, in which nothing was seen yet.
fn draw(recording: &Recording) -> Recording {
    let positions = recording.frames.first().map_or(0, |f| f.commanded.len());
    let range = |k: usize| {
        recording
            .frames
            .iter()
            .map(|f| f.commanded[k])
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), q| (a.min(q), b.max(q)))
    };
    let ranges: Vec<(f64, f64)> = (0..positions).map(range).collect();
    // A fixed generator (Knuth, MMIX): the same session always gets the same proposal.
    let mut state: u64 = 0x9E37_79B9_7F4A_7C15;
    let mut unit = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut out = recording.clone();
    out.ordered = true;
    out.frames.truncate(1);
    if let Some(first) = out.frames.pop() {
        for i in 0..DRAWN {
            let mut frame = first.clone();
            frame.number = i as i64;
            frame.posture = i as i64;
            frame.sightings.clear();
            frame.points.clear();
            frame.commanded = ranges.iter().map(|(low, high)| low + (high - low) * unit()).collect();
            out.frames.push(frame);
        }
    }
    out
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
