//! What a person should know of the session before trusting the diagnosis.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::data::diagnosis::Data;
use crate::diagnose::data::left_out::Reason;
use crate::diagnose::likelihood::noise::trimmed_share;
use crate::diagnose::principles::{Count, FEWEST_REDUNDANT_ROWS};

/// With fewer postures than this few causes can be separated: one marker, two rows a posture, does not determine
/// its variance then.
const FEW_POSTURES: Count = FEWEST_REDUNDANT_ROWS as usize / 2;

/// In sentences, each with what to do.
pub(crate) fn warnings(findings: &Findings<'_>, data: &Data) -> Vec<String> {
    let problem = &findings.search.problem;
    let scene = &problem.scene;
    let mut out = Vec::new();
    let postures = findings.after.len();
    if postures < FEW_POSTURES {
        out.push(format!(
            "only {postures} {}: record at least {FEW_POSTURES}, better 60, spread over the joints' ranges; few causes can be told apart with so few",
            if postures == 1 { "posture" } else { "postures" }
        ));
    }
    if scene.marker_names.len() == 1 {
        out.push(
            "one marker only: joints in series are hard to separate; add a marker on each link of interest"
                .into(),
        );
    }
    let share = far_share(data);
    if share > trimmed_share() {
        out.push(format!(
            "{:.1} % of the markers' observations are far from the best model and were left out as false: look at them",
            share * 100.0
        ));
    }
    if let Some(scatter) = findings.search.scatter {
        out.push(format!(
            "what is left is as if each joint rested {:.2}° (one standard deviation) away from its logged position, in each posture by itself: servos that repeat no \
             better, positions that were rounded or only commanded, or postures that had not settled; record what the encoders say, at rest, and repeat postures",
            scatter.std_rad.to_degrees()
        ));
    }
    for (effect, at) in &findings.in_picture_only {
        out.push(format!(
            "{effect}@{at} is more probable than not, and not named, since the gap in metres, which the uncertain depth of the markers enlarges, becomes no smaller: \
             record more views of each posture, from nearer the mirror"
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

/// The share of the markers' observations that were left out as false, before the search (whole rows among them) or by its result.
fn far_share(data: &Data) -> f64 {
    let of_rows = data.left_out.iter().filter(|l| matches!(l.why, Reason::WholeRow(_))).count();
    (data.false_count() + of_rows) as f64 / data.points_given.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::data::left_out::LeftOut;

    #[test]
    fn what_was_left_out_before_the_search_counts_as_left_out() {
        let of = |why: Reason| LeftOut { frame: 1, target: "hand".into(), deviations: None, why };
        let reasons =
            [Reason::FarFromModel, Reason::FarFromAll(None), Reason::WholeRow(None), Reason::NoBoard];
        let data = Data { points_given: 60, left_out: reasons.map(of).into(), ..Data::default() };
        assert_eq!(far_share(&data), 0.05);
        assert_eq!(far_share(&Data::default()), 0.0);
    }
}
