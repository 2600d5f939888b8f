//! The zeros of the two joints of a link, in the place of its length.
//!
//! Where both axes are parallel, zeros off by δ and −δ shift what is beyond the link by `δ × l`, in the link's frame: as
//! a link of another length does, to first order, in every posture. The search adds one cause at a time and finds the
//! one that does what both do together.

use crate::diagnose::effects::Place;
use crate::diagnose::effects::hypothesis::Term;
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::elementary::Atom;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::selection::search::{Found, Search};
use crate::error::Result;

/// Two joints' zeros, and their log posterior odds against the cause in whose place they are.
pub(crate) struct ZerosInstead {
    /// The joint that carries the link, and the one that it carries.
    pub joints: (NodeId, NodeId),
    pub odds: f64,
}

/// The likeliest two zeros in the place of the i-th cause; none where it does not shift joints.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn zeros_instead(search: &Search<'_>, found: &Found, i: usize) -> Result<Option<ZerosInstead>> {
    let (catalogue, scene) = (search.catalogue, &search.problem.scene);
    let model = &found.fit.model;
    let zero = |n: NodeId| {
        let zero = catalogue.find("joint_offset", Place::Joint(n))?;
        let is_new = !search.options.left_out.contains(&zero)
            && model.terms.iter().all(|term| term.hypothesis != zero);
        is_new.then_some(zero)
    };
    let pairs = ends(search, &model.terms[i]);
    if pairs.is_empty() {
        return Ok(None);
    }
    let own = search.fit_with_slack(model, None, found.noise, SOLVER.final_steps)?;
    let mut best: Option<ZerosInstead> = None;
    for (first, second) in pairs {
        let (Some(a), Some(b)) = (zero(first), zero(second)) else { continue };
        if !(scene.relevant[first] && scene.relevant[second]) {
            continue;
        }
        let with = model.without(i).with(catalogue, a, 0.0).with(catalogue, b, 0.0);
        let zeros = search.fit_with_slack(&with, None, found.noise, SOLVER.final_steps)?;
        let odds = search.log_posterior(&zeros) - search.log_posterior(&own);
        if best.as_ref().is_none_or(|b| odds > b.odds) {
            best = Some(ZerosInstead { joints: (first, second), odds });
        }
    }
    Ok(best)
}

/// The joints at both ends of the links whose length a cause changes.
fn ends(search: &Search<'_>, term: &Term) -> Vec<(NodeId, NodeId)> {
    let nodes = &search.problem.scene.body.nodes;
    let beyond = |n: NodeId| (0..nodes.len()).filter(move |&k| nodes[k].parent == Some(n));
    let mut out: Vec<(NodeId, NodeId)> = Vec::new();
    for column in search.catalogue.columns(&search.problem.scene, term) {
        match column.atom {
            Atom::LinkShift(Some(n), _) => out.extend(beyond(n).map(|k| (n, k))),
            Atom::OriginShift(k, _) => out.extend(nodes[k].parent.map(|n| (n, k))),
            _ => {}
        }
    }
    out.sort_unstable();
    out.dedup();
    out
}
