//! The linear model of a planned session: all effects of the vocabulary at the nominal model, beside a free set-up.

use crate::cancel::Cancel;
use crate::diagnose::assessment::limits::{Postures, free_setup};
use crate::diagnose::data::recording::Recording;
use crate::diagnose::effects::hypothesis::{Catalogue, Model, Term, nuisances};
use crate::diagnose::effects::{Place, vocabulary};
use crate::diagnose::likelihood::fit::Group;
use crate::diagnose::model::elementary::Column;
use crate::diagnose::model::problem::Problem;
use crate::error::Result;
use crate::robot::Robot;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Postures with the pixels that the nominal model predicts for them, arranged.
pub struct PlannedSession {
    pub(crate) problem: Problem,
    pub(crate) catalogue: Catalogue,
    pub(crate) group: Group,
    pub(crate) model: Model,
    /// All columns: nuisances, the free set-up, then each effect's.
    pub(crate) columns: Vec<Column>,
    /// Their priors' standard deviations.
    pub(crate) prior_std: Vec<f64>,
    /// The sizes that they commonly have: of a mount that of its effect, not the tolerance that a session states.
    pub(crate) usual: Vec<f64>,
    /// Where those of the effects begin: before them are the nuisances and the free set-up.
    pub(crate) first_effect: usize,
    /// Which columns are an effect's, by hypothesis.
    pub(crate) of: BTreeMap<usize, Vec<usize>>,
}

impl PlannedSession {
    /// Arranges postures. The recording holds the predicted pixels and states the noise expected; frames without
    /// pixels only tell from where a joint arrives in the next one.
    ///
    /// # Errors
    /// Unknown links; a camera or mirror with invalid parameters.
    pub fn new(robot: &Robot, recording: &Recording, cancel: Cancel) -> Result<Self> {
        let mut problem = Problem::new(robot, recording)?;
        problem.cancel = cancel;
        let effects = vocabulary().into_iter().map(Arc::from).collect();
        let catalogue = Catalogue::new(&problem.scene, effects, &[]);
        let group = free_setup(&problem);
        let mut model = Model::nominal(&problem);
        model.group = vec![0.0; group.columns.len()];
        let mut out = Self {
            columns: Vec::new(),
            prior_std: Vec::new(),
            usual: Vec::new(),
            first_effect: 0,
            of: BTreeMap::new(),
            problem,
            catalogue,
            group,
            model,
        };
        out.collect_columns();
        Ok(out)
    }

    fn collect_columns(&mut self) {
        for (column, std) in nuisances(&self.problem) {
            self.columns.push(column);
            self.prior_std.push(std);
        }
        let first = self.columns.len();
        self.columns.extend(self.group.columns.iter().cloned());
        self.prior_std.extend(&self.group.prior_std);
        self.first_effect = self.columns.len();
        self.usual.clone_from(&self.prior_std);
        let moved = |columns: &Vec<usize>| columns.iter().map(|k| first + k).collect();
        self.of = self.postures().in_group().iter().map(|(h, columns)| (*h, moved(columns))).collect();
        for (h, columns) in &self.of {
            let usual = &self.catalogue.hypotheses[*h].prior_std;
            columns.iter().zip(usual).for_each(|(&column, usual)| self.usual[column] = *usual);
        }
        for h in 0..self.catalogue.hypotheses.len() {
            if self.of.contains_key(&h) || !is_planned_for(&self.catalogue, h) {
                continue;
            }
            let entry = &self.catalogue.hypotheses[h];
            let parameters = vec![0.0; entry.prior_std.len()];
            // Values of a discrete unknown differ little in what they show.
            let variant = entry.variants.first().copied().unwrap_or(0.0);
            let term = Term { hypothesis: h, variant, parameters, prior_scale: 1.0 };
            let own = self.columns.len()..self.columns.len() + entry.prior_std.len();
            self.prior_std.extend(&entry.prior_std);
            self.usual.extend(&entry.prior_std);
            self.columns.extend(self.catalogue.columns(&self.problem.scene, &term));
            self.of.insert(h, own.collect());
        }
    }

    pub(crate) fn postures(&self) -> Postures<'_> {
        Postures {
            problem: &self.problem,
            catalogue: &self.catalogue,
            group: &self.group,
            model: &self.model,
            noise: self.problem.noise,
            mask: None,
        }
    }
}

/// Whether postures are chosen for an effect at a place. Not for a coupling of each joint with each other one: they
/// would outnumber all else.
fn is_planned_for(catalogue: &Catalogue, hypothesis: usize) -> bool {
    !matches!(catalogue.hypotheses[hypothesis].place, Place::JointPair(..))
}
