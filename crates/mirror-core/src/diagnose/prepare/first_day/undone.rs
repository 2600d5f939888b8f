//! The session with its mistakes undone, and what is reported of them.

use super::background;
use super::memory::Memory;
use super::mistake::Mistake;
use super::outlying;
use super::reported::reported;
use super::spoilt::{Lost, Step};
use crate::diagnose::data::diagnosis::{Alternative, Cause};
use crate::diagnose::data::left_out::{LeftOut, Reason};
use crate::diagnose::data::recording::{Frame, Recording, Target};
use crate::diagnose::likelihood::noise::trimmed_share;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::prepare::boards::leave_out_wrong_grids;
use crate::error::Result;
use crate::robot::Robot;

/// The session with its mistakes undone.
pub(crate) struct Undone {
    pub robot: Robot,
    pub recording: Recording,
    pub problem: Problem,
    pub told: Vec<Cause>,
    /// How it went, a line a step.
    pub trace: Vec<String>,
    /// Mistakes that a small error could be instead, where the data do not decide.
    pub doubts: Vec<Doubt>,
    /// False observations, and data that a mistake leaves unknown.
    pub left_out: Vec<LeftOut>,
    /// Boards that no mirror explains with the mistakes undone; none where nothing was undone.
    pub wrong_grids: Option<Vec<LeftOut>>,
    /// Whether boards that no mirror explains are still in the problem: rows contain other rows' pictures.
    pub all_boards: bool,
    /// The mistakes, in the order in which they were undone.
    pub(super) mistakes: Vec<Mistake>,
    /// Whether rows contain other rows' measurements, or the board's squares have another size. Later stages handle
    /// both; until then they would look like slips and false observations.
    pub(super) unsettled: bool,
    /// A joint whose column is unrelated to it.
    pub lost: Option<Lost>,
    /// A joint that has another zero from a row on, which is undone, and the session before that.
    pub step: Option<(Step, Problem)>,
    /// Whether a spring under another direction of gravity explains more than any single cause: a diagnosis under it may explain
    /// all.
    pub loads_may_be_turned: bool,
}

/// What a small error could be instead: a mistake, or the zeros of two joints.
#[derive(Debug, Clone)]
pub(crate) struct Doubt {
    /// The small error: effect and place.
    pub of: (String, String),
    pub mistake: Alternative,
}

impl Undone {
    /// Leaves out what no small error explains: digits, labels, rows whose joints were elsewhere. Where much is, it widens the
    /// scale by which the rest is judged, so that the rest is judged again.
    pub(super) fn leave_out_false(&mut self, memory: &mut Memory) -> Result<()> {
        let names = names(&self.robot);
        let rounds = || -> Result<Vec<Vec<outlying::False>>> {
            let (mut problem, mut recording) = (self.problem.clone(), self.recording.clone());
            let mut rounds = Vec::new();
            for _ in 0..SOLVER.rounds {
                let observations = problem.frames.iter().map(|f| f.others.len()).sum::<usize>() as f64;
                let found = outlying::find(&problem, &recording, &names, problem.noise)?;
                let many = found.iter().map(|f| f.indices.len()).sum::<usize>() as f64
                    > trimmed_share() * observations;
                leave_out(&mut problem, &mut recording, &found);
                rounds.push(found);
                if !many {
                    break;
                }
            }
            Ok(rounds)
        };
        for found in memory.outlying.remembered(&self.mistakes, rounds)? {
            self.leave_out(found);
        }
        Ok(())
    }

    /// Leaves out what stands still in the picture while the marker of its name moves.
    pub(super) fn leave_out_background(&mut self) -> Result<()> {
        self.leave_out(background::find(&self.problem)?);
        Ok(())
    }

    fn leave_out(&mut self, found: Vec<outlying::False>) {
        leave_out(&mut self.problem, &mut self.recording, &found);
        self.left_out.extend(found.into_iter().flat_map(|f| f.told));
    }

    /// Undoes a mistake, and reports it.
    pub(super) fn undo(&mut self, mistake: &Mistake, probability: f64) -> Result<()> {
        self.mistakes.push(mistake.clone());
        self.told.extend(reported(mistake, &self.robot, &self.recording, &self.problem, probability));
        let mut free = core::mem::take(&mut self.problem.mistake_parameters);
        free.extend(mistake.free_parameters(&self.recording, &self.problem, &names(&self.robot)));
        let before = self.recording.frames.clone();
        mistake.undo(&mut self.robot, &self.problem, &mut self.recording)?;
        self.tell_taken_away(&before, &mistake.takes_away_since());
        let slips = core::mem::take(&mut self.problem.slips);
        self.problem = arranged_again(&self.robot, &self.recording, &self.problem)?;
        self.problem.slips = slips;
        self.problem.mistake_parameters = free;
        if !self.problem.slips.is_empty() {
            self.problem.fit_boards()?;
        }
        mistake.on_problem(&mut self.problem)?;
        // A mirror may explain a board once it is known to have slipped.
        self.wrong_grids = Some(leave_out_wrong_grids(&mut self.problem));
        Ok(())
    }
}

impl Undone {
    /// Lists the data that undoing a mistake left unknown in some frames: each marker once, and the board.
    fn tell_taken_away(&mut self, before: &[Frame], why: &Reason) {
        for (before, after) in before.iter().zip(&self.recording.frames) {
            let count = |frame: &Frame, target: Target| {
                let points = frame.points.iter().map(|p| Target::Marker(p.marker));
                frame.sightings.iter().map(|s| s.target).chain(points).filter(|t| *t == target).count()
            };
            let total = |frame: &Frame| frame.sightings.len() + frame.points.len();
            // Exchanged names leave nothing unknown.
            if total(after) == total(before) {
                continue;
            }
            let markers = self.problem.scene.marker_names.iter().enumerate();
            let lost =
                markers.filter(|(m, _)| count(before, Target::Marker(*m)) > count(after, Target::Marker(*m)));
            let board = (corners(before) > corners(after)).then_some("board");
            let targets = board.into_iter().chain(lost.map(|(_, name)| name.as_str()));
            self.left_out.extend(targets.map(|target| LeftOut {
                frame: before.number,
                target: target.to_owned(),
                deviations: None,
                why: why.clone(),
            }));
        }
    }
}

/// Removes observations of a session, given by their index among a frame's arranged ones.
fn leave_out(problem: &mut Problem, recording: &mut Recording, found: &[outlying::False]) {
    for outlying::False { frame, indices, .. } in found {
        outlying::remove(&mut recording.frames[*frame], indices);
        let mut at = 0;
        problem.frames[*frame].others.retain(|_| {
            at += 1;
            !indices.contains(&(at - 1))
        });
    }
}

fn corners(frame: &Frame) -> usize {
    frame.sightings.iter().filter(|s| matches!(s.target, Target::Corner(_))).count()
}

/// A changed robot and recording arranged as before: with the markers where they were found to be, and the same token and limit of work.
pub(super) fn arranged_again(robot: &Robot, recording: &Recording, before: &Problem) -> Result<Problem> {
    let mut problem = Problem::new(robot, recording)?;
    problem.marker_sites.clone_from(&before.marker_sites);
    problem.marker_mounts.clone_from(&before.marker_mounts);
    problem.scene.mount_known.clone_from(&before.scene.mount_known);
    // A marker on another link is moved by other joints than the model says.
    problem.markers_moved();
    (problem.cancel, problem.budget) = (before.cancel.clone(), before.budget.clone());
    Ok(problem)
}

pub(super) fn names(robot: &Robot) -> Vec<String> {
    robot.position_names().map(str::to_owned).collect()
}
