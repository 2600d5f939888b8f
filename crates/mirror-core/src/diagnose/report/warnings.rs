//! What a person should know of the session before trusting the diagnosis.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::likelihood::noise::trimmed_share;
use crate::diagnose::principles::{Count, FEWEST_REDUNDANT_ROWS};

/// With fewer postures than this few causes can be separated: one marker, two rows a posture, does not determine
/// its variance then.
const FEW_POSTURES: Count = FEWEST_REDUNDANT_ROWS as usize / 2;

/// In sentences, each with what to do.
pub(super) fn warnings(findings: &Findings<'_>) -> Vec<String> {
    let problem = &findings.search.problem;
    let scene = &problem.scene;
    let mut out = Vec::new();
    let postures = findings.after.len();
    if postures < FEW_POSTURES {
        out.push(format!(
            "only {postures} postures: record at least {FEW_POSTURES}, better 60, spread over the joints' ranges; few causes can be told apart with so few"
        ));
    }
    if scene.marker_names.len() == 1 {
        out.push(
            "one marker only: joints in series are hard to separate; add a marker on each link of interest"
                .into(),
        );
    }
    if findings.false_share > trimmed_share() {
        out.push(format!(
            "{:.1} % of the markers' observations are far from the best model and were left out as false: look at them",
            findings.false_share * 100.0
        ));
    }
    if let Some(scatter) = findings.search.scatter {
        out.push(format!(
            "what is left is as if each joint rested {:.2}° (one standard deviation) away from its logged position, in each posture by itself: servos that repeat no \
             better, positions that were rounded or only commanded, or postures that had not settled; record what the encoders say, at rest, and repeat postures",
            scatter.std_rad.to_degrees()
        ));
    }
    if !scene.ordered {
        out.push("the rows are not in the order of execution: play and stiction by direction of motion cannot be seen".into());
    }
    let still: Vec<&str> = (0..scene.nodes())
        .filter(|&n| scene.relevant[n] && !scene.moves(n))
        .map(|n| scene.body.nodes[n].joint.as_str())
        .collect();
    if !still.is_empty() {
        out.push(format!(
            "joints that never moved: {}; only a constant error of these can be seen",
            still.join(", ")
        ));
    }
    if scene.body.nodes.iter().all(|node| node.mass == 0.0) {
        out.push(
            "the URDF gives no link behind a joint a mass: what gravity does (joint_compliance, link_bending) was not tried; add <inertial> to the links"
                .into(),
        );
    }
    if problem.camera.is_some() && findings.after.iter().all(|g| g.markers == 0.0) {
        out.push("no marker was seen together with the board: the body cannot be diagnosed".into());
    }
    out
}
