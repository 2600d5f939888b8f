//! What planned postures will show of each effect at each place.
//!
//! The limits are those of a diagnosis that finds nothing ([`assessment::limits`](super::super::assessment::limits)), with
//! the gap that the noise alone will leave.

use super::expected::PlannedSession;
use super::twins::{Rival, rivals};
use crate::diagnose::assessment::limits::{Criterion, LARGEST, gain_needed};
use crate::diagnose::likelihood::normal_equations::Normal;
use crate::diagnose::model::problem::Observation;
use crate::diagnose::model::solver::NEGLIGIBLE;
use crate::diagnose::principles::{Guard, LEAST_LOG_ODDS};
use crate::error::Result;
use std::collections::BTreeMap;

/// A twin is told only where it is separated no sooner than at so many times the size that is found.
const LATER: Guard = 2.0;

/// Another cause that looks alike.
#[derive(Debug, Clone, PartialEq)]
pub struct Twin {
    /// Its effect.
    pub effect: String,
    /// Its place, as in the public vocabulary.
    pub at: String,
    /// The size (of the first parameter) of the cause from which on both are separated; none: at no size.
    pub apart_from: Option<f64>,
}

/// What a plan shows of an effect at a place.
#[derive(Debug, Clone, PartialEq)]
pub struct Foreseen {
    /// The effect.
    pub effect: String,
    /// The place, as in the public vocabulary.
    pub at: String,
    /// Each parameter with the smallest size that will be found, all others 0; none where any size would be hidden.
    pub parameters: Vec<(String, Option<f64>)>,
    /// Other causes for which it can be taken at a size that it commonly has, those that are separated last first.
    pub twins: Vec<Twin>,
}

impl PlannedSession {
    /// The limits and twins of every effect at every place, in the order of the vocabulary.
    ///
    /// # Errors
    /// Invalid parameters of the camera or mirror; [`Error::Cancelled`](crate::Error::Cancelled).
    pub fn foresee(&self) -> Result<Vec<Foreseen>> {
        let seen = self.problem.frames.iter().flat_map(|f| &f.others).filter(|o| o.marker().is_some());
        let numbers = |o: &Observation| if matches!(o, Observation::Pixel { .. }) { 2.0 } else { 3.0 };
        let held_out = gain_needed(seen.map(numbers).sum());
        let postures = self.postures();
        let criterion = Criterion { least_log_odds: LEAST_LOG_ODDS, held_out };
        let limits = postures.limits(criterion, &postures.screened()?)?;
        let (nominal, noise) = (self.problem.nominal(), self.problem.noise);
        let normal = Normal::at(&self.problem, &nominal, noise, &self.columns, true, None, None)?;
        self.problem.cancel.check()?;
        let rivals = rivals(self, &normal.h);
        let mut limits: BTreeMap<(String, String), BTreeMap<String, Option<f64>>> =
            limits.into_iter().map(|limit| ((limit.effect, limit.at), limit.parameters)).collect();
        let foreseen = self.of.keys().filter_map(|&h| {
            let (effect, at) = self.name(h);
            let sizes = limits.remove(&(effect.clone(), at.clone()))?;
            let names = self.catalogue.effect(h).parameters().into_iter();
            let parameters: Vec<(String, Option<f64>)> =
                names.map(|name| (name.clone(), sizes.get(&name).copied().flatten())).collect();
            let twins = self.told(h, &parameters, &rivals[&h]);
            // A servo without a load has no droop: it is no number of the effect there.
            let std = &self.catalogue.hypotheses[h].prior_std;
            let some = parameters.into_iter().zip(std).filter(|(_, s)| **s > NEGLIGIBLE);
            let parameters = some.map(|(parameter, _)| parameter).collect();
            Some(Foreseen { effect, at, parameters, twins })
        });
        Ok(foreseen.collect())
    }

    fn name(&self, h: usize) -> (String, String) {
        let effect = self.catalogue.effect(h).name().to_owned();
        (effect, self.catalogue.hypotheses[h].place.name(&self.problem.scene))
    }

    /// The twins of a cause, given the smallest sizes that are found.
    fn told(&self, h: usize, parameters: &[(String, Option<f64>)], rivals: &[Rival]) -> Vec<Twin> {
        let std = &self.catalogue.hypotheses[h].prior_std;
        let sizes = parameters.iter().zip(std).filter_map(|((_, size), s)| Some((*size)? / s));
        let Some(found) = sizes.min_by(f64::total_cmp) else { return Vec::new() };
        let mut twins: Vec<Rival> =
            rivals.iter().copied().filter(|(_, apart)| *apart > 1.0_f64.max(LATER * found)).collect();
        twins.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        let twins = twins.into_iter().map(|(k, apart)| {
            let (effect, at) = self.name(k);
            Twin { effect, at, apart_from: (apart < LARGEST).then_some(apart * std[0]) }
        });
        twins.collect()
    }
}
