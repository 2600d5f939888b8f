//! Single causes before anything else is known: the likeliest by the score test, fitted.
//!
//! Where one small cause explains everything to the noise, no slip can explain more, which is compared with small errors
//! of every kind at once: it need not be searched. Nor need other gross mistakes, unless the cause is larger than such an
//! error usually is: then it may be a part of one.

use super::verify::all_at_once;
use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::effects::{Effect, vocabulary};
use crate::diagnose::likelihood::fit::{FitOptions, Group, fit};
use crate::diagnose::likelihood::noise::{effective, estimate};
use crate::diagnose::likelihood::nominal_sums::NominalSums;
use crate::diagnose::likelihood::score_test::{Score, Screening, screen};
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::{A_GAP, SURE_DEVIATIONS};
use crate::error::Result;
use std::sync::Arc;

/// Set free where the parts are mounted by hand: mounts alone leave no gap small enough to see a spring in.
const MOUNTS: [&str; 4] = ["board_mount", "camera_mount", "marker_mount", "joint_offset"];

/// What the nominal model leaves, and the single cause of the vocabulary that is likeliest to explain it.
#[derive(Clone)]
pub(super) struct Alone {
    pub noise: Noise,
    pub likeliest: Option<Likeliest>,
    pub sums: Arc<NominalSums>,
}

/// The likeliest single cause, with everything else mounted as modelled; none where the nominal model leaves no gap.
///
/// # Errors
/// Invalid parameters of camera or mirror.
pub(super) fn alone(problem: &Problem) -> Result<Option<Alone>> {
    let exact = Beside::nothing(problem);
    let Some(noise) = exact.gap(problem)? else { return Ok(None) };
    let catalogue = catalogue(problem, vocabulary());
    let sums = Arc::new(NominalSums::at(problem, &catalogue, noise)?);
    let screening = sums.screening(&catalogue);
    Ok(Some(Alone { noise, likeliest: first_possible(problem.clone(), catalogue, &exact, &screening), sums }))
}

/// What explains a session's gap.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Explained {
    /// No single cause.
    Not,
    /// A single cause that is larger than such an error usually is, and may be a part of a gross mistake.
    ByLarge,
    /// A single cause of a usual size, or nothing is needed.
    ByUsual,
}

/// Whether nothing, or a single cause of the vocabulary, leaves no more than the noise: the stated one, or what the views
/// of a posture show among themselves.
///
/// # Errors
/// Invalid parameters of camera or mirror.
pub(super) fn explained(problem: &Problem, alone: Option<Alone>) -> Result<Explained> {
    let Some(Alone { noise, likeliest, .. }) = alone else { return Ok(Explained::ByUsual) };
    let Some(best) = likeliest else { return Ok(Explained::Not) };
    let best = best.fitted(noise)?;
    let is_enough = !is_gap(problem, best.left) || {
        let of_views = estimate(problem, &best.deformation(), problem.noise)?;
        problem.of_observations(best.left) < A_GAP * problem.of_observations(of_views)
    };
    let usual = best.model.terms.iter().all(|term| best.catalogue.deviations(term) <= SURE_DEVIATIONS);
    Ok(match (is_enough, usual) {
        (false, _) => Explained::Not,
        (true, false) => Explained::ByLarge,
        (true, true) => Explained::ByUsual,
    })
}

/// Whether what is left is a gap.
fn is_gap(problem: &Problem, left: Noise) -> bool {
    problem.of_observations(left) >= A_GAP * problem.of_observations(problem.noise)
}

/// What is free besides a cause, and where its fit starts.
pub(super) struct Beside {
    pub group: Group,
    pub start: Model,
}

impl Beside {
    /// Everything mounted as modelled.
    pub fn nothing(problem: &Problem) -> Self {
        Self { group: Group::default(), start: Model::nominal(problem) }
    }

    /// Mounts and zeros, fitted alone.
    ///
    /// # Errors
    /// Invalid parameters of camera or mirror.
    pub fn mounts(problem: &Problem) -> Result<Self> {
        let effects = vocabulary().into_iter().filter(|e| MOUNTS.contains(&e.name()));
        let catalogue = Catalogue::new(&problem.scene, effects.map(Arc::from).collect(), &[]);
        let group = all_at_once(problem, &catalogue);
        let mut start = Model::nominal(problem);
        start.group = vec![0.0; group.columns.len()];
        for _ in 0..SOLVER.rounds {
            let deformation = start.deformation(problem, &catalogue, &group.columns);
            let noise = effective(problem, &deformation, problem.noise, None)?;
            let options = FitOptions { noise, steps: SOLVER.loose_steps };
            start = fit(problem, &catalogue, &group, &start, options, None)?.model;
        }
        Ok(Self { group, start })
    }

    /// The noise at which what is left would be as large as it is; none where that is no gap.
    ///
    /// # Errors
    /// Invalid parameters of camera or mirror.
    pub fn gap(&self, problem: &Problem) -> Result<Option<Noise>> {
        let none = Catalogue::new(&problem.scene, Vec::new(), &[]);
        let deformation = self.start.deformation(problem, &none, &self.group.columns);
        let noise = effective(problem, &deformation, problem.noise, None)?;
        Ok(is_gap(problem, noise).then_some(noise))
    }
}

/// The best single cause, by the score test.
#[derive(Clone)]
pub(super) struct Likeliest {
    problem: Problem,
    group: Group,
    catalogue: Arc<Catalogue>,
    /// At the linear estimate.
    model: Model,
    pub log_bayes: f64,
}

/// The same, fitted.
#[derive(Clone)]
pub(super) struct Best {
    problem: Problem,
    group: Group,
    catalogue: Arc<Catalogue>,
    model: Model,
    /// What it leaves.
    pub left: Noise,
}

impl Likeliest {
    /// Fitted from there, with the value of its discrete unknown that leaves less: the score test cannot tell whether a
    /// joint comes to each row straight from the row before.
    ///
    /// # Errors
    /// Invalid parameters of camera or mirror.
    pub fn fitted(self, noise: Noise) -> Result<Best> {
        let beside = self.variant_beside();
        let Self { problem, group, catalogue, model, .. } = self;
        let mut best = Best { left: problem.noise, problem, group, catalogue, model };
        let start = best.model.clone();
        best.fit(noise)?;
        if let Some(variant) = beside {
            let mut other = Best { model: start, ..best.clone() };
            other.model.terms.iter_mut().for_each(|term| term.variant = variant);
            other.fit(noise)?;
            if other.problem.of_observations(other.left) < best.problem.of_observations(best.left) {
                return Ok(other);
            }
        }
        Ok(best)
    }

    fn variant_beside(&self) -> Option<f64> {
        let term = self.model.terms.last()?;
        let place = self.catalogue.hypotheses[term.hypothesis].place;
        let effect = self.catalogue.effect(term.hypothesis);
        effect.variant_beside(&self.problem.scene, place, term.variant, &term.parameters)
    }
}

impl Best {
    /// Fits it from where it is, and sees what is left.
    fn fit(&mut self, noise: Noise) -> Result<()> {
        let options = FitOptions { noise, steps: SOLVER.loose_steps };
        self.model = fit(&self.problem, &self.catalogue, &self.group, &self.model, options, None)?.model;
        self.left = effective(&self.problem, &self.deformation(), self.problem.noise, None)?;
        Ok(())
    }

    fn deformation(&self) -> Deformation {
        self.model.deformation(&self.problem, &self.catalogue, &self.group.columns)
    }

    /// Log marginal likelihood at a noise.
    ///
    /// # Errors
    /// Invalid parameters of camera or mirror.
    pub fn log_evidence(&self, noise: Noise) -> Result<f64> {
        let options = FitOptions { noise, steps: SOLVER.loose_steps };
        Ok(fit(&self.problem, &self.catalogue, &self.group, &self.model, options, None)?.log_evidence)
    }
}

/// The likeliest of some effects at any place, none where there is none to try.
///
/// # Errors
/// Invalid parameters of camera or mirror.
pub(super) fn likeliest(
    problem: Problem,
    effects: Vec<Box<dyn Effect>>,
    beside: &Beside,
    noise: Noise,
) -> Result<Option<Likeliest>> {
    let catalogue = catalogue(&problem, effects);
    let screening = screen(&problem, &catalogue, &beside.group, &beside.start, noise, None)?;
    Ok(first_possible(problem, catalogue, beside, &screening))
}

fn catalogue(problem: &Problem, effects: Vec<Box<dyn Effect>>) -> Catalogue {
    Catalogue::new(&problem.scene, effects.into_iter().map(Arc::from).collect(), &[])
}

/// The likeliest hypothesis that can be, at its estimate.
fn first_possible(
    problem: Problem,
    catalogue: Catalogue,
    beside: &Beside,
    screening: &Screening,
) -> Option<Likeliest> {
    let (group, model) = (beside.group.clone(), &beside.start);
    // What is free already is no cause.
    let is_free = |h: usize| !group.columns.is_empty() && MOUNTS.contains(&catalogue.effect(h).name());
    let at_estimate = |score: &Score| {
        let along = screening.moved_along(score).map(|values| screening.active.model(model, &values));
        let moved = along.unwrap_or_else(|| model.clone());
        let mut with = moved.with(&catalogue, score.hypothesis, score.variant);
        if let Some(term) = with.terms.last_mut() {
            let positive = catalogue.effect(score.hypothesis).is_positive();
            term.parameters =
                score.parameters.iter().map(|p| if positive { p.max(0.0) } else { *p }).collect();
        }
        with
    };
    // A linear estimate may be no camera, or no pane.
    let is_possible = |with: &Model| {
        let deformation = with.deformation(&problem, &catalogue, &group.columns);
        problem.eye(&deformation).is_ok()
    };
    let others = screening.scores.iter().filter(|s| !is_free(s.hypothesis));
    let mut possible = others.map(|s| (s.log_bayes, at_estimate(s))).filter(|(_, with)| is_possible(with));
    let (log_bayes, model) = possible.next()?;
    drop(possible);
    Some(Likeliest { problem, group, catalogue: Arc::new(catalogue), model, log_bayes })
}
