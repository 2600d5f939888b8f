//! The poses of frames' nodes as they were computed last: of the alternatives that are tried one after another most differ
//! in one joint, and only what it carries is posed again.

use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::frame::FrameWork;
use crate::diagnose::model::kinematics::{Before, NodePoses};
use crate::diagnose::model::problem::Problem;
use crate::diagnose::principles::Size;
use std::sync::Mutex;

/// Of so many nodes, each of a frame, poses are kept: about five megabytes.
const MOST_NODES: Size = 20_000;

/// The poses of the first frames, with one deformation.
pub(super) struct KeptPoses {
    by_frame: Vec<Mutex<Option<Kept>>>,
}

/// The poses of a frame, and at which positions they are.
pub(super) struct Kept {
    poses: NodePoses,
    before: Before,
}

impl KeptPoses {
    /// None yet, of a problem's frames.
    pub fn none(problem: &Problem) -> Self {
        let frames = problem.frames.len().min(MOST_NODES / problem.scene.nodes().max(1));
        Self { by_frame: (0..frames).map(|_| Mutex::default()).collect() }
    }

    /// Poses a frame in `work`, what moved since it was posed last: the nodes that the session's own sites ride on, or
    /// `all`. What is returned is given back by [`KeptPoses::keep`]; none of a frame of which nothing is kept.
    pub fn pose(
        &self,
        work: &mut FrameWork,
        problem: &Problem,
        (known, frame): (&Deformation, usize),
        positions: &[f64],
        all: bool,
    ) -> Option<Kept> {
        let nodes = problem.scene.nodes();
        // Another thread may have this frame's at the moment: then there are none.
        let taken = self.by_frame.get(frame).map(|kept| kept.lock().ok().and_then(|mut kept| kept.take()));
        let Some(taken) = taken else {
            let pose = if all { FrameWork::pose_as } else { FrameWork::pose_sites_as };
            pose(work, problem, known, frame, positions);
            return None;
        };
        let mut kept =
            taken.unwrap_or_else(|| Kept { poses: NodePoses::new(nodes), before: Before::never(nodes) });
        core::mem::swap(&mut work.poses, &mut kept.poses);
        work.pose_again(problem, (known, frame), positions, all, &mut kept.before);
        Some(kept)
    }

    /// Keeps the poses of a frame for the next time.
    pub fn keep(&self, work: &mut FrameWork, frame: usize, kept: Option<Kept>) {
        if let (Some(mut kept), Some(Ok(mut place))) = (kept, self.by_frame.get(frame).map(Mutex::lock)) {
            core::mem::swap(&mut work.poses, &mut kept.poses);
            *place = Some(kept);
        }
    }
}
