//! The score test of all hypotheses alone: for benches, and for a quick look at a session.

use crate::diagnose::data::diagnosis::Ranked;
use crate::diagnose::data::recording::Recording;
use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::effects::vocabulary;
use crate::diagnose::likelihood::fit::Group;
use crate::diagnose::likelihood::noise;
use crate::diagnose::likelihood::score_test::screen;
use crate::diagnose::model::problem::{Noise, Problem};
use crate::error::Result;
use crate::robot::Robot;
use std::sync::Arc;

/// A recording arranged for screening: mirrors fitted, noise estimated.
pub struct Screening {
    problem: Problem,
    catalogue: Catalogue,
    noise: Noise,
}

/// Arranges a recording for screening.
///
/// # Errors
/// As [`crate::diagnose::diagnose`].
pub fn screen_once(robot: &Robot, recording: &Recording) -> Result<Screening> {
    let mut problem = Problem::new(robot, recording)?;
    let nominal = problem.nominal();
    problem.noise = noise::estimate(&problem, &nominal, problem.noise)?;
    let noise = noise::effective(&problem, &nominal, problem.noise, None)?;
    let catalogue = Catalogue::new(&problem.scene, vocabulary().into_iter().map(Arc::from).collect(), &[]);
    Ok(Screening { problem, catalogue, noise })
}

impl Screening {
    /// How many hypotheses (effect × place) are scored.
    pub fn hypotheses(&self) -> usize {
        self.catalogue.hypotheses.len()
    }

    /// Scores all of them against the nominal model, best first; each discrete unknown on its own.
    ///
    /// # Errors
    /// Invalid parameters of the camera or mirror.
    pub fn run(&self) -> Result<Vec<Ranked>> {
        let model = Model::nominal(&self.problem);
        let scores =
            screen(&self.problem, &self.catalogue, &Group::default(), &model, self.noise, None)?.scores;
        Ok(scores
            .into_iter()
            .map(|s| Ranked {
                effect: self.catalogue.effect(s.hypothesis).name().to_owned(),
                at: self.catalogue.hypotheses[s.hypothesis].place.name(&self.problem.scene),
                log_bayes: s.log_bayes,
            })
            .collect())
    }
}
