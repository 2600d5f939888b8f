//! The joint that alone corrects a frame: its position was typed with another digit or sign, or belongs to another row.

use super::alternatives::least;
use super::misfit::{Misfit, Work};
use super::variant::{Variant, seen_joints};
use crate::diagnose::data::left_out::Elsewhere;
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::camera_and_mirror::Eye;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::elementary::{Atom, moves_against};
use crate::diagnose::model::frame::{FrameWork, Task};
use crate::diagnose::model::problem::{Noise, Observation, Problem};
use crate::diagnose::principles::{Grid, SURE_DEVIATIONS};
use crate::error::Result;

/// Step of the positions that are tried, up to half a turn both ways; of a joint that slides up to as many steps of half a centimetre.
const STEP_RAD: Grid = 0.02;
const STEP_M: Grid = 0.005;

/// Tries other positions of single joints beside a known deformation. All positions are tried with the mirror as the board alone
/// shows it; the likeliest is refined with the frame evaluated exactly.
pub(super) struct OtherPositions<'a> {
    problem: &'a Problem,
    eye: Option<Eye>,
    noise: Noise,
    misfit: Misfit<'a>,
    work: Work,
    tried: Variant,
    known: Deformation,
}

impl<'a> OtherPositions<'a> {
    /// Of a problem beside a deformation, with these positions in the log.
    ///
    /// # Errors
    /// Invalid parameters of camera or mirror.
    pub fn new(
        problem: &'a Problem,
        deformation: &Deformation,
        noise: Noise,
        recorded: Variant,
    ) -> Result<Self> {
        let misfit = Misfit::given(problem, deformation)?;
        let all: Vec<usize> = (0..problem.frames.len()).collect();
        let mut work = misfit.work();
        work.placed = misfit.placed(&recorded, &all);
        let (eye, known) = (problem.eye(deformation)?, deformation.clone());
        Ok(Self { problem, eye, noise, misfit, work, tried: recorded, known })
    }

    /// The joint that alone corrects a frame. With `beyond` (observations, by index: those that the joint carries) each of them
    /// must fit then; without it the median of the frame's must.
    pub fn correcting(
        &mut self,
        exact: &mut FrameWork,
        frame: usize,
        beyond: Option<&[usize]>,
        joint_names: &[String],
    ) -> Option<Elsewhere> {
        let (problem, every) = (self.problem, beyond.is_some());
        let can_be = |node: NodeId| beyond.is_none_or(|b| moves_these(problem, node, frame, b));
        let step_of = |node: NodeId| {
            if problem.scene.body.nodes[node].prismatic { (STEP_M, "m") } else { (STEP_RAD, "rad") }
        };
        let joints = seen_joints(&problem.scene.body, &problem.scene.relevant).into_iter();
        let tried = joints.filter(|(_, node)| can_be(*node)).map(|(joint, node)| {
            let steps = (core::f64::consts::PI / STEP_RAD) as i32;
            let positions = (-steps..=steps).map(|k| f64::from(k) * step_of(node).0);
            let distances = positions.map(|by| (self.distance_at((frame, joint, node), by, every), by));
            (distances.fold((f64::INFINITY, 0.0), |a, b| if b.0 < a.0 { b } else { a }), joint, node)
        });
        let ((_, at), joint, node) = tried.min_by(|a, b| a.0.0.total_cmp(&b.0.0))?;
        let mut moved = self.known.clone();
        let mut deviations_at = |by: f64| {
            let change = self.known.joint_delta(frame, node) + by - moved.joint_delta(frame, node);
            moved.add_joint_delta(frame, node, change);
            let task = Task::of_residuals(problem, &moved, self.eye.as_ref(), self.noise);
            if !exact.evaluate(problem, &task, frame) {
                return f64::INFINITY;
            }
            let mut sizes = Vec::new();
            exact.raw_residuals(|_, measured, r| {
                sizes.push(r.norm() / if measured { self.noise.point_m } else { self.noise.marker_px });
            });
            largest_or_median(sizes, every)
        };
        let (step, unit) = step_of(node);
        let by = least(at - step, at + step, &mut deviations_at);
        (deviations_at(by) < SURE_DEVIATIONS).then(|| Elsewhere {
            joint: joint_names[joint].clone(),
            by,
            unit,
        })
    }

    /// The markers' distance in a frame with a joint moved, m: the largest of `every`, else the median.
    fn distance_at(&mut self, (frame, joint, node): (usize, usize, NodeId), by: f64, every: bool) -> f64 {
        let recorded = self.tried.positions[frame][joint];
        self.tried.positions[frame][joint] += by / self.problem.scene.body.nodes[node].command.1;
        let mut sizes = Vec::new();
        self.misfit.of_frame(&mut self.work, &self.tried, frame, |_, size_m| sizes.push(size_m));
        self.tried.positions[frame][joint] = recorded;
        largest_or_median(sizes, every)
    }
}

/// The largest of `every` size, else the median; infinite where there is none.
fn largest_or_median(mut sizes: Vec<f64>, every: bool) -> f64 {
    sizes.sort_by(f64::total_cmp);
    let told = if every { sizes.last() } else { sizes.get(sizes.len() / 2) };
    told.copied().unwrap_or(f64::INFINITY)
}

/// Whether a joint moves just these observations of a frame against what sees them, and no board.
fn moves_these(problem: &Problem, node: NodeId, frame: usize, these: &[usize]) -> bool {
    let (scene, joint) = (&problem.scene, Atom::Joint(node));
    let camera = problem.camera_site.and_then(|s| s.node);
    let moves_board = problem.board.is_some_and(|b| moves_against(joint, scene, b.node, camera));
    let is_moved = |observation: &Observation| {
        let observer = match observation {
            Observation::Pixel { .. } => camera,
            Observation::Point { .. } => problem.points_site.and_then(|s| s.node),
        };
        observation
            .marker()
            .is_some_and(|m| moves_against(joint, scene, problem.marker_sites[m].node, observer))
    };
    let others = problem.frames[frame].others.iter().enumerate();
    !moves_board
        && others.filter(|(_, o)| o.marker().is_some()).all(|(i, o)| is_moved(o) == these.contains(&i))
}
