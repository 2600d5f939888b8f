//! A session ready for the search: gross mistakes undone, the noise known, slipped rows left out.

use super::boards::leave_out_wrong_grids;
use super::first_day::{self, Doubt, Lost, Memory, Step, Suspects, Undone};
use super::first_result::FirstResult;
use super::options::DiagnoseOptions;
use super::row_slip::{self, Slip};
use crate::diagnose::data::diagnosis::Cause;
use crate::diagnose::data::left_out::LeftOut;
use crate::diagnose::data::recording::Recording;
use crate::diagnose::likelihood::noise;
use crate::diagnose::likelihood::nominal_sums::NominalSums;
use crate::diagnose::model::problem::{Noise, Problem};
use crate::error::Result;
use crate::robot::Robot;
use std::sync::Arc;

/// A session ready for the search.
pub(crate) struct Prepared {
    /// As it was given.
    pub given: Problem,
    /// With its mistakes undone.
    pub arranged: Problem,
    /// The same without slipped rows, at the noise that the data show.
    pub problem: Problem,
    /// The noise that the session states.
    pub stated: Noise,
    pub slip: Option<Slip>,
    pub left_out: Vec<LeftOut>,
    /// The score test's sums at the nominal model, where nothing was changed since they were summed.
    pub nominal_sums: Option<Arc<NominalSums>>,
    /// Whether an earlier diagnosis named small errors everywhere, so that they are tried in place of all causes.
    pub had_small_errors: bool,
    undone: Option<Undone>,
}

impl Prepared {
    /// Prepares a session; `known`: the result of a first diagnosis, with which smaller gross mistakes can be
    /// found. `suspects`: rows that repeat a measurement may be named by a second diagnosis without slipped rows too.
    /// `memory`: the results of earlier preparations of the same session.
    ///
    /// # Errors
    /// A recording that is not valid, links that do not exist, invalid parameters of the camera.
    pub fn new(
        robot: &Robot,
        recording: &Recording,
        options: &DiagnoseOptions,
        known: Option<&FirstResult>,
        suspects: Suspects,
        memory: &mut Memory,
    ) -> Result<Self> {
        let mut problem = Problem::new(robot, recording)?;
        problem.cancel = options.cancel.clone();
        problem.progress = options.progress.clone();
        problem.budget = memory.next_budget(&problem.budget);
        let stated = problem.noise;
        let mut left_out = leave_out_wrong_grids(&mut problem);
        let given = problem.clone();
        let undone =
            first_day::undone(robot, recording, &problem, &options.without, known, suspects, memory)?;
        if let Some(undone) = &undone {
            problem = undone.problem.clone();
            problem.cancel = given.cancel.clone();
            problem.budget = given.budget.clone();
            problem.progress = given.progress.clone();
            options.progress.tell_mistakes(&undone.told);
            if let Some(of_these) = &undone.wrong_grids {
                left_out.clone_from(of_these);
            }
            left_out.extend(undone.left_out.iter().cloned());
        }
        let arranged = problem.clone();
        let nominal = problem.nominal();
        problem.noise = noise::estimate(&problem, &nominal, stated)?;
        // With an unknown joint, rows fit other rows by chance.
        let in_doubt = undone.as_ref().is_some_and(|u| u.lost.is_some());
        let slip = if options.allows("pairing") && !in_doubt {
            let scatter = noise::effective(&problem, &nominal, problem.noise, None)?;
            let found = row_slip::find(&problem, scatter)?;
            found.map(|slip| row_slip::with_overwritten_rows(&problem, slip)).transpose()?
        } else {
            None
        };
        if let Some(slip) = &slip {
            problem.leave_out(slip.first..=slip.last);
        }
        if undone.as_ref().is_some_and(|u| u.all_boards) {
            left_out.extend(leave_out_wrong_grids(&mut problem));
        }
        if slip.is_some() {
            problem.noise = noise::estimate(&problem, &nominal, stated)?;
        }
        let unchanged = undone.is_none() && slip.is_none();
        let nominal_sums = if unchanged { memory.nominal_sums() } else { None };
        Ok(Self {
            given,
            arranged,
            problem,
            stated,
            slip,
            left_out,
            nominal_sums,
            had_small_errors: false,
            undone,
        })
    }

    /// The robot with its mistakes undone.
    pub fn robot<'a>(&'a self, given: &'a Robot) -> &'a Robot {
        self.undone.as_ref().map_or(given, |u| &u.robot)
    }

    /// The recording with its mistakes undone.
    pub fn recording<'a>(&'a self, given: &'a Recording) -> &'a Recording {
        self.undone.as_ref().map_or(given, |u| &u.recording)
    }

    /// Another session, as it is arranged, with the mistakes undone that this one has and that are not of its rows alone.
    ///
    /// # Errors
    /// Invalid parameters of camera or mirror.
    pub fn in_another_session(
        &self,
        robot: &Robot,
        recording: &Recording,
        arranged: Problem,
    ) -> Result<Problem> {
        match &self.undone {
            Some(undone) => undone.undone_in(robot, recording, arranged),
            None => Ok(arranged),
        }
    }

    /// Whole mistakes of model or log.
    pub fn mistakes(&self) -> &[Cause] {
        self.undone.as_ref().map_or(&[], |u| &u.told)
    }

    /// The joint whose column is unrelated to it.
    pub fn lost(&self) -> Option<&Lost> {
        self.undone.as_ref().and_then(|u| u.lost.as_ref())
    }

    /// The joint that has another zero from a row on, which is undone, and the session before that.
    pub fn step(&self) -> Option<&(Step, Problem)> {
        self.undone.as_ref().and_then(|u| u.step.as_ref())
    }

    /// Whether a diagnosis under another direction of gravity may explain all.
    pub fn loads_may_be_turned(&self) -> bool {
        self.undone.as_ref().is_some_and(|u| u.loads_may_be_turned)
    }

    /// Mistakes that a small error could be instead.
    pub fn doubts(&self) -> &[Doubt] {
        self.undone.as_ref().map_or(&[], |u| &u.doubts)
    }

    /// How they were found, a line a step.
    pub fn trace(&self) -> &[String] {
        self.undone.as_ref().map_or(&[], |u| &u.trace)
    }
}
