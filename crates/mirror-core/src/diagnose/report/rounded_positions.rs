//! The warning for positions that are written in coarse steps, as people type them: whole degrees, hundredths of a radian.
//!
//! A position that was rounded to steps of s errs by up to s/2, evenly: by `s/√12` in the root mean square, independently in each
//! posture and at each joint. The markers then move by the root of the sum of the joints' squares. No cause describes it, and it
//! is no error of the model. Where the robot was commanded to such positions they are exact: so it is a warning, not a finding.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::scene::Scene;
use crate::diagnose::principles::{FEWEST_OBSERVATIONS, Grid, MAJORITY, Size};
use crate::diagnose::report::rms_shift::{noise_square, rms_shift};
use crate::error::Result;

/// Steps in which people write angles, the largest first: of degrees, and of radians.
const STEPS_DEG: [Grid; 5] = [5.0, 1.0, 0.5, 0.2, 0.1];
const STEPS_RAD: [Grid; 4] = [0.1, 0.05, 0.02, 0.01];
/// A value counts as a multiple within this share of the step: a fiftieth of other values does by chance.
const SHARE: Grid = 0.01;

/// Joints that the warning names.
const NAMED: Size = 3;

/// A joint's step, and how people would say it.
fn step_of(scene: &Scene, node: NodeId) -> Option<(f64, String)> {
    let mut values: Vec<f64> = (0..scene.frames).map(|f| scene.q(f, node)).collect();
    values.sort_by(f64::total_cmp);
    values.dedup();
    // Few values are multiples of something by chance.
    if values.len() < FEWEST_OBSERVATIONS || scene.body.nodes[node].prismatic {
        return None;
    }
    let degrees = STEPS_DEG.iter().map(|s| (s.to_radians(), format!("{s}°")));
    let radians = STEPS_RAD.iter().map(|s| (*s, format!("{s} rad")));
    let fits = |step: f64| values.iter().all(|q| (q / step - (q / step).round()).abs() < SHARE);
    degrees.chain(radians).filter(|(step, _)| fits(*step)).max_by(|a, b| a.0.total_cmp(&b.0))
}

/// The warning where rounding may move the observations by more than half of their noise; none elsewhere.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn positions_are_rounded(findings: &Findings<'_>) -> Result<Option<String>> {
    let search = &findings.search;
    let scene = &search.problem.scene;
    let rounded: Vec<(NodeId, (f64, String))> = (0..scene.nodes())
        .filter(|&n| scene.is_seen(n) && scene.body.nodes[n].follows.is_none())
        .filter_map(|n| Some((n, step_of(scene, n)?)))
        .collect();
    let at = search.deformation(&findings.found.fit.model);
    let mut square = 0.0;
    for (node, (step, _)) in &rounded {
        let mut off = at.clone();
        (0..scene.frames).for_each(|f| off.add_joint_delta(f, *node, step / 12f64.sqrt()));
        square += rms_shift(findings, &at, &off)?.powi(2);
    }
    let noise = noise_square(&search.problem, search.detector_noise());
    if square <= MAJORITY.powi(2) * noise {
        return Ok(None);
    }
    let coarsest = rounded.iter().max_by(|a, b| a.1.0.total_cmp(&b.1.0)).map_or("", |r| &r.1.1);
    let names: Vec<&str> = rounded.iter().map(|r| scene.body.nodes[r.0].joint.as_str()).collect();
    let some = names[..names.len().min(NAMED)].join(", ");
    let names = match names.len().saturating_sub(NAMED) {
        0 => some,
        others => format!("{some} and {others} more joints"),
    };
    let (moved, noise, unit) = match search.problem.camera {
        Some(_) => (square.sqrt(), noise.sqrt(), "px"),
        None => (square.sqrt() * 1e3, noise.sqrt() * 1e3, "mm"),
    };
    Ok(Some(format!(
        "the positions of {names} are written in steps of up to {coarsest}: if the log rounded them, that alone moves the \
         markers by {moved:.2} {unit} (root mean square; the noise is {noise:.2} {unit}), differently in each posture, and a \
         remainder of this size is no error of the model; record what the encoders say"
    )))
}
