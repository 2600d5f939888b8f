//! A camera or tracker that hangs: over a run of rows it repeats one measurement while the joints move.
//!
//! Noise makes two measurements differ. So rows i to j contain one measurement if everything measured in them is
//! identical to the last digit, if they are enough rows and postures, and if a joint that moves the observations
//! moves between them. The first row keeps its measurement; the others are left out.

use super::mistake::Mistake;
use super::variant::seen_joints;
use crate::diagnose::data::recording::{Frame, Recording};
use crate::diagnose::model::problem::Problem;
use crate::diagnose::model::solver::NEGLIGIBLE;
use crate::diagnose::principles::{FEWEST_FRAMES, FEWEST_POSTURES};

/// The runs of rows that repeat the measurement of the row before them.
pub(super) fn find(recording: &Recording, problem: &Problem) -> Vec<Mistake> {
    let joints = seen_joints(&problem.scene.body, &problem.scene.relevant);
    let frames = &recording.frames;
    let moved = |f: usize, g: usize| {
        joints.iter().any(|&(j, _)| (frames[f].commanded[j] - frames[g].commanded[j]).abs() > NEGLIGIBLE)
    };
    let mut out = Vec::new();
    let mut first = 0;
    while first < frames.len() {
        let same = frames[first + 1..].iter().take_while(|f| is_same(f, &frames[first])).count();
        let last = first + same;
        let postures = (first + 1..=last).filter(|&f| moved(f - 1, f)).count();
        if same >= FEWEST_FRAMES && postures >= FEWEST_POSTURES {
            out.push(Mistake::Hung { first: first + 1, last });
        }
        first = last + 1;
    }
    out
}

/// Whether all that was measured in two rows is the same, and something was.
fn is_same(a: &Frame, b: &Frame) -> bool {
    let something = !a.sightings.is_empty() || !a.points.is_empty();
    something && a.sightings == b.sightings && a.points == b.points
}
