//! Random postures that a robot can take and that camera and mirror can see, drawn within the joints' limits.
//!
//! A joint that moves nothing visible (a caster, a leg) is held at the session's median. The others are drawn within
//! their limits, less a margin, half of them anywhere and half near recorded postures; a joint without limits goes
//! slightly beyond its recorded range. A posture counts if one of the session's mirrors, fixed relative to the
//! camera, shows the whole board from its printed side and at least one marker; the markers that this mirror shows
//! are kept. Occlusion by the body is not modelled.

use crate::diagnose::data::recording::Recording;
use crate::diagnose::model::kinematics::NodePoses;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::model::scene::Scene;
use crate::diagnose::principles::{Grid, Size};
use crate::error::Result;
use crate::random::Random;
use crate::robot::Robot;
use crate::statistics::median;
use nalgebra::{Point3, Vector3};

/// Postures that are drawn.
const DRAWN: Size = 320;
/// Number of them that are examined further.
const KEPT: Size = 100;
/// Margin to each limit, as a share of the range.
const MARGIN: Grid = 0.05;
/// Half of the postures lie within this share of the range about a visited one.
const NEARBY: Grid = 0.3;
/// Mirrors of the session that are tried.
const MIRRORS: Size = 24;
/// Margin of the picture, px.
const EDGE_PX: Grid = 8.0;
/// A further posture differs from each visited one by so much in at least one joint: 10°; of a prismatic joint, [`MARGIN`] of its range.
const APART_RAD: Grid = 0.174_533;

/// Postures that a next session could visit.
#[derive(Debug, Clone)]
pub(crate) struct Draws {
    /// The postures that a mirror of the session shows, in the order in which they were drawn.
    pub recording: Recording,
    /// Which markers the best mirror shows, by posture.
    pub shown: Vec<Vec<bool>>,
    apart: Vec<Option<f64>>,
}

/// The range of each position; none where it is held.
fn ranges(robot: &Robot, scene: &Scene, recording: &Recording) -> Vec<Option<(f64, f64)>> {
    let visited = |k: usize| {
        recording
            .frames
            .iter()
            .map(|f| f.commanded[k])
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), q| (a.min(q), b.max(q)))
    };
    (0..robot.position_count())
        .map(|k| {
            let nodes = scene.body.nodes.iter().enumerate().filter(|(_, node)| node.command.0 == k);
            let mut moving = nodes.filter(|(n, _)| scene.relevant[*n]).map(|(n, _)| n).peekable();
            let prismatic = scene.body.nodes[*moving.peek()?].prismatic;
            let (low, high) = visited(k);
            let moved = moving.any(|n| scene.moves(n));
            match robot.joints()[robot.position_joints()[k]].limits {
                Some(limits) if limits.upper > limits.lower => {
                    let margin = MARGIN * (limits.upper - limits.lower);
                    // Recorded positions can be reached, whatever the limits say.
                    Some(((limits.lower + margin).min(low), (limits.upper - margin).max(high)))
                }
                _ => {
                    let beyond = 2.0 * if prismatic { MARGIN * (high - low) } else { APART_RAD };
                    moved.then_some((low - beyond, high + beyond))
                }
            }
        })
        .collect()
}

impl Draws {
    /// Draws postures for a robot; `session` has the mirrors that were seen.
    ///
    /// # Errors
    /// A recording that is not valid.
    pub fn new(robot: &Robot, recording: &Recording, session: &Problem) -> Result<Self> {
        let ranges = ranges(robot, &session.scene, recording);
        // The same session always gets the same proposal.
        let mut random = Random::new(0x9E37_79B9_7F4A_7C15);
        let mut unit = || random.unit();
        let held: Vec<f64> = (0..ranges.len())
            .map(|k| median(recording.frames.iter().map(|f| f.commanded[k]).collect()))
            .collect();
        let mut out = recording.clone();
        out.ordered = true;
        out.frames.truncate(1);
        let first = out.frames.pop();
        for i in 0..if first.is_some() { DRAWN } else { 0 } {
            let about =
                &recording.frames[(unit() * recording.frames.len() as f64) as usize % recording.frames.len()];
            let mut frame = about.clone();
            frame.sightings.clear();
            frame.points.clear();
            (frame.number, frame.posture) = (i as i64, i as i64);
            frame.commanded = (0..ranges.len())
                .map(|k| match ranges[k] {
                    None => held[k],
                    Some((low, high)) if i % 2 == 0 => low + (high - low) * unit(),
                    Some((low, high)) => {
                        let aside = NEARBY * (high - low) * (2.0 * unit() - 1.0);
                        (about.commanded[k] + aside).clamp(low, high)
                    }
                })
                .collect();
            out.frames.push(frame);
        }
        let prismatic = |k: usize| session.scene.body.nodes.iter().any(|n| n.command.0 == k && n.prismatic);
        let apart = (0..ranges.len())
            .map(|k| {
                ranges[k].map(|(low, high)| if prismatic(k) { MARGIN * (high - low) } else { APART_RAD })
            })
            .collect();
        let mut draws = Self { recording: out, shown: Vec::new(), apart };
        draws.keep_visible(robot, session)?;
        Ok(draws)
    }

    /// Whether a position is drawn, rather than held.
    pub fn is_drawn(&self, position: usize) -> bool {
        self.apart[position].is_some()
    }

    /// Whether two postures differ by 10° or more in a joint that is drawn.
    pub fn are_apart(&self, a: &[f64], b: &[f64]) -> bool {
        self.apart
            .iter()
            .enumerate()
            .any(|(k, least)| least.is_some_and(|least| (a[k] - b[k]).abs() >= least))
    }

    /// Leaves the postures that a mirror of the session shows.
    fn keep_visible(&mut self, robot: &Robot, session: &Problem) -> Result<()> {
        let problem = Problem::new(robot, &self.recording)?;
        let feet: Vec<Vector3<f64>> = {
            let all: Vec<Vector3<f64>> = session.boards.iter().flatten().map(|b| b.foot).collect();
            let every = all.len().div_ceil(MIRRORS).max(1);
            all.into_iter().step_by(every).collect()
        };
        let nominal = problem.nominal();
        let nodes = problem.scene.nodes();
        let mut poses = NodePoses::new(nodes);
        let mut kept = Vec::new();
        for (f, frame) in self.recording.frames.drain(..).enumerate() {
            let commanded = &problem.scene.commanded[f * nodes..(f + 1) * nodes];
            poses.update(&problem.scene.body, commanded, &nominal, f);
            let shown = shown(&problem, &poses, &feet);
            if shown.iter().any(|s| *s) && kept.len() < KEPT {
                kept.push(frame);
                self.shown.push(shown);
            }
        }
        for (i, frame) in kept.iter_mut().enumerate() {
            (frame.number, frame.posture) = (i as i64, i as i64);
        }
        self.recording.frames = kept;
        Ok(())
    }
}

/// Which markers the mirror shows that shows most of them together with the whole board; all where nothing is seen by a mirror.
fn shown(problem: &Problem, poses: &NodePoses, feet: &[Vector3<f64>]) -> Vec<bool> {
    let markers = problem.marker_sites.len();
    let (Some(camera), Some(site), Some(board)) = (&problem.camera, &problem.camera_site, &problem.board)
    else {
        return vec![true; markers];
    };
    if feet.is_empty() {
        return vec![true; markers];
    }
    let (eye, board) = (poses.site(site), poses.site(board));
    let printed = eye.r.tr_mul(&(board.r * Vector3::z()));
    let center = eye.inverse_point(&board.t);
    let corners: Vec<Vector3<f64>> =
        problem.corners.iter().map(|c| eye.inverse_point(&board.point(c))).collect();
    let balls: Vec<Vector3<f64>> =
        problem.marker_sites.iter().map(|m| eye.inverse_point(&poses.site(m).t)).collect();
    let (width, height) = camera.size_px();
    let inside = |point: &Vector3<f64>, foot: &Vector3<f64>| {
        let distance = foot.norm();
        let normal = foot / distance;
        let before = distance - normal.dot(point);
        let image = Point3::from(point + normal * (2.0 * before));
        before > 0.0
            && image.z > 0.0
            && camera.project(&image).is_ok_and(|px| {
                let free = |x: f64, size: u32| x > EDGE_PX && x < f64::from(size) - 1.0 - EDGE_PX;
                free(px.x, width) && free(px.y, height)
            })
    };
    feet.iter()
        .filter(|foot| {
            let virtual_eye = **foot * 2.0;
            printed.dot(&(virtual_eye - center)) > 0.0 && corners.iter().all(|c| inside(c, foot))
        })
        .map(|foot| balls.iter().map(|b| inside(b, foot)).collect::<Vec<bool>>())
        .max_by_key(|seen| seen.iter().filter(|s| **s).count())
        .unwrap_or_else(|| vec![false; markers])
}
