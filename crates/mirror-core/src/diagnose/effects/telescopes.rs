//! What the effects of telescopic columns share: which columns exist, how far they are extended, the moment across
//! them.

use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::scene::Scene;
use crate::diagnose::model::solver::NEGLIGIBLE;
use crate::diagnose::model::telescope::Telescope;
use crate::diagnose::principles::{Guard, Prior};

/// Extension at which the overlap of the tubes would be zero, in multiples of the largest extension that the
/// joints' limits allow: loaded guides keep a fifth of the stroke.
const END: Prior = 1.2;
/// The overlap is zero at least this far beyond the largest commanded extension.
const LEAST_OVERLAP: Guard = 1.02;

/// The last prismatic joint of each column that moves the observed markers, was moved, and is loaded.
pub(super) fn columns_last(scene: &Scene) -> impl Iterator<Item = NodeId> + '_ {
    let nodes = &scene.body.nodes;
    let is_inner = move |n: NodeId| {
        nodes.iter().any(|other| other.column().is_some_and(|t| t.joints[..t.joints.len() - 1].contains(&n)))
    };
    (0..scene.nodes()).filter(move |&n| {
        let moves = |t: &Telescope| t.joints.iter().any(|&k| scene.moves(k));
        let loaded = largest_moment(scene, n) > NEGLIGIBLE;
        scene.relevant[n] && nodes[n].column().is_some_and(moves) && !is_inner(n) && loaded
    })
}

/// The first sliding joint of each of these columns.
pub(super) fn columns_first(scene: &Scene) -> impl Iterator<Item = NodeId> + '_ {
    columns_last(scene).filter_map(|n| scene.body.nodes[n].column()?.joints.first().copied())
}

/// Gravity's moment on a node's link about direction k across its joint, frame by frame, N m.
pub(super) fn moment_across(scene: &Scene, n: NodeId, k: usize) -> impl Iterator<Item = f64> + '_ {
    let direction = scene.body.nodes[n].tilt_directions[k];
    (0..scene.frames).map(move |f| direction.dot(scene.moment(f, n)))
}

/// The largest moment of these, about either direction, N m.
pub(super) fn largest_moment(scene: &Scene, n: NodeId) -> f64 {
    let across = scene.body.nodes[n].tilt_directions;
    scene.largest_moment(n, |f| {
        let moment = scene.moment(f, n);
        across[0].dot(moment).abs().max(across[1].dot(moment).abs())
    })
}

/// Growth of a column's flexibility with its extension, frame by frame, m: `h = e/(1 − e/D)`, e its extension and D
/// where its overlap is zero, [`END`] times the largest that the limits allow; h is e itself where there are no
/// limits. It depends on nothing else of the session.
pub(super) fn slackening_m(scene: &Scene, n: NodeId) -> Vec<f64> {
    let (Some(telescope), Some(out)) = (scene.body.nodes[n].column(), scene.extensions_m(n)) else {
        return vec![0.0; scene.frames];
    };
    let most = out.iter().fold(0.0_f64, |a, e| a.max(*e));
    let whole = (END * telescope.farthest_m).max(LEAST_OVERLAP * most);
    // Limits of nothing but 0 say as much as none.
    let ends = whole.is_finite() && whole > 0.0;
    out.iter().map(|e| if ends { e / (1.0 - e / whole) } else { *e }).collect()
}
