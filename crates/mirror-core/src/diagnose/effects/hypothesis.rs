//! Hypotheses (effect × place), and models: a set of causes with their parameters.

use crate::diagnose::effects::{Effect, Place};
use crate::diagnose::model::camera_and_mirror::FootPoints;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::problem::Problem;
use crate::diagnose::model::scene::Scene;
use crate::diagnose::principles::{LEAST_LOG_ODDS, LOG_PRIOR_FREE, Prior};
use std::sync::Arc;

/// Prior standard deviation of an unknown mount, or of the pose of an unknown frame, from its start value, rad and
/// m.
pub(crate) const UNKNOWN_STD: Prior = 1.0;

/// An effect at a place.
#[derive(Debug, Clone)]
pub(crate) struct Hypothesis {
    /// Index into [`Catalogue::effects`].
    pub effect: usize,
    pub place: Place,
    pub variants: Vec<f64>,
    pub prior_std: Vec<f64>,
    /// Log prior probability of this cause: all effects are equally probable (with those of columns where the robot
    /// has one) unless they tell otherwise, and so are the places of an effect.
    pub log_prior: f64,
}

/// All hypotheses of a scene.
pub(crate) struct Catalogue {
    pub effects: Vec<Arc<dyn Effect>>,
    pub hypotheses: Vec<Hypothesis>,
    /// Hypotheses from this one on are free-form errors, not causes.
    first_free: usize,
}

impl Catalogue {
    /// All places of all effects; `without` names effects that are switched off.
    pub fn new(scene: &Scene, effects: Vec<Arc<dyn Effect>>, without: &[String]) -> Self {
        let mut hypotheses = Vec::new();
        let on: Vec<(usize, Vec<Place>)> = (0..effects.len())
            .filter(|&e| !without.iter().any(|w| w == effects[e].name()))
            .map(|e| (e, effects[e].places(scene)))
            .collect();
        let may_be = |(e, places): &&(usize, Vec<Place>)| !places.is_empty() || !effects[*e].is_of_columns();
        // As many as are equally probable: a less probable one counts by its share.
        let count: f64 = on.iter().filter(may_be).map(|(e, _)| effects[*e].log_prior().exp()).sum();
        for (effect, places) in on {
            let log_prior = effects[effect].log_prior() - (count * places.len().max(1) as f64).ln();
            for place in places {
                hypotheses.push(Hypothesis {
                    effect,
                    place,
                    variants: effects[effect].variants(scene, place),
                    prior_std: effects[effect].prior_std(scene, place),
                    log_prior,
                });
            }
        }
        Self { effects, first_free: hypotheses.len(), hypotheses }
    }

    /// How many of their prior's deviations the largest of a cause's parameters is.
    pub fn deviations(&self, term: &Term) -> f64 {
        let stds = self.prior_stds(term.hypothesis, term.variant);
        term.parameters.iter().zip(stds).map(|(value, std)| (value / std).abs()).fold(0.0, f64::max)
    }

    /// The standard deviations of the prior of a hypothesis, at a value of its discrete unknown.
    pub fn prior_stds(&self, hypothesis: usize, variant: f64) -> impl Iterator<Item = f64> {
        let scale = if self.effect(hypothesis).is_scaled_by_variant() { variant } else { 1.0 };
        self.hypotheses[hypothesis].prior_std.iter().map(move |std| scale * std)
    }

    /// The values of a hypothesis' discrete unknown that have columns of their own: one where it is only the scale of the prior.
    pub fn laws(&self, hypothesis: usize) -> &[f64] {
        let variants = &self.hypotheses[hypothesis].variants;
        if self.effect(hypothesis).is_scaled_by_variant() {
            &variants[..variants.len().min(1)]
        } else {
            variants
        }
    }

    /// The scales that the prior of a hypothesis may have, with the value of its discrete unknown at each.
    pub fn prior_scales(&self, hypothesis: usize) -> &[f64] {
        let scaled = self.effect(hypothesis).is_scaled_by_variant();
        if scaled { &self.hypotheses[hypothesis].variants } else { &[1.0] }
    }

    /// A catalogue with free-form errors behind its own hypotheses, whose indices stay.
    pub fn with_free_forms(base: &Self, scene: &Scene, free: Vec<Box<dyn Effect>>) -> Self {
        let mut out = Self {
            effects: Vec::new(),
            hypotheses: base.hypotheses.clone(),
            first_free: base.hypotheses.len(),
        };
        out.effects.extend(base.effects.iter().cloned());
        let first = out.effects.len();
        let added = Self::new(scene, free.into_iter().map(Arc::from).collect(), &[]);
        out.effects.extend(added.effects);
        out.hypotheses.extend(added.hypotheses.into_iter().map(|h| Hypothesis {
            effect: h.effect + first,
            log_prior: h.log_prior + LOG_PRIOR_FREE,
            ..h
        }));
        out
    }

    /// Whether a hypothesis is a free-form error, not a cause of the vocabulary.
    pub fn is_free(&self, hypothesis: usize) -> bool {
        hypothesis >= self.first_free
    }

    /// The first free-form error; those of the vocabulary are before it.
    pub fn first_free(&self) -> usize {
        self.first_free
    }

    pub fn effect(&self, hypothesis: usize) -> &dyn Effect {
        self.effects[self.hypotheses[hypothesis].effect].as_ref()
    }

    /// Log prior probability of a variant of a hypothesis: a variant that equals a simpler hypothesis is less
    /// probable than that.
    pub fn log_prior(&self, scene: &Scene, hypothesis: usize, variant: f64) -> f64 {
        let of = &self.hypotheses[hypothesis];
        let simpler = self.effect(hypothesis).is_like_a_simpler_one(scene, of.place, variant);
        of.log_prior - if simpler { LEAST_LOG_ODDS } else { 0.0 }
    }

    pub fn columns(&self, scene: &Scene, term: &Term) -> Vec<Column> {
        let place = self.hypotheses[term.hypothesis].place;
        self.effect(term.hypothesis).columns(scene, place, term.variant, &term.parameters)
    }

    /// The hypothesis of an effect by its name at a place.
    pub fn find(&self, effect: &str, place: Place) -> Option<usize> {
        (0..self.hypotheses.len())
            .find(|&h| self.hypotheses[h].place == place && self.effect(h).name() == effect)
    }

    /// `effect@place`, as in the public vocabulary.
    pub fn name(&self, scene: &Scene, hypothesis: usize) -> String {
        format!("{}@{}", self.effect(hypothesis).name(), self.hypotheses[hypothesis].place.name(scene))
    }
}

/// A cause with its parameters.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Term {
    pub hypothesis: usize,
    pub variant: f64,
    pub parameters: Vec<f64>,
    /// Factor on the prior's standard deviations: below 1 for a cause that is only tolerated, not found.
    pub prior_scale: f64,
}

/// Causes and nuisances: everything that deforms the nominal model.
#[derive(Debug, Clone)]
pub(crate) struct Model {
    /// Values of [`nuisances`], in their order.
    pub nuisances: Vec<f64>,
    /// Values of the group of small errors (`geometry`), in the order of its columns; empty where it is not in the model.
    pub group: Vec<f64>,
    pub terms: Vec<Term>,
    /// Whether causes and group are held as they are and only nuisances are fitted.
    pub frozen: bool,
    /// Where the frames' mirrors were when this model, or one like it, was fitted last: where the next fit starts.
    pub planes: Option<Arc<FootPoints>>,
}

/// Nuisance parameters of every model: mounts that are stated as unknown, the frame of the measured points. Columns
/// with their prior.
pub(crate) fn nuisances(problem: &Problem) -> Vec<(Column, f64)> {
    let mut out = Vec::new();
    for m in (0..problem.marker_sites.len()).filter(|&m| !problem.scene.mount_known[m]) {
        for k in 0..3 {
            out.push((Column::constant(Atom::MarkerShift(m, k)), UNKNOWN_STD));
        }
    }
    if problem.unknown_frame.is_some() {
        for k in 0..6 {
            out.push((Column::constant(Atom::FramePose(k)), UNKNOWN_STD));
        }
    }
    out.extend(problem.ground.iter().cloned());
    out.extend(problem.mistake_parameters.iter().map(|l| (l.column.clone(), l.std)));
    out
}

impl Model {
    /// The nominal model.
    pub fn nominal(problem: &Problem) -> Self {
        Self {
            nuisances: vec![0.0; nuisances(problem).len()],
            group: Vec::new(),
            terms: Vec::new(),
            frozen: false,
            planes: None,
        }
    }

    /// Whether it has causes, or small errors everywhere.
    pub fn explains(&self) -> bool {
        !self.terms.is_empty() || !self.group.is_empty()
    }

    /// This model with one more cause, at zero.
    pub fn with(&self, catalogue: &Catalogue, hypothesis: usize, variant: f64) -> Self {
        let parameters = vec![0.0; catalogue.hypotheses[hypothesis].prior_std.len()];
        let mut next = self.clone();
        next.terms.push(Term { hypothesis, variant, parameters, prior_scale: 1.0 });
        next
    }

    /// This model without its i-th cause.
    pub fn without(&self, i: usize) -> Self {
        let mut next = self.clone();
        next.terms.remove(i);
        next
    }

    /// Everything together, as the forward model reads it.
    pub fn deformation(&self, problem: &Problem, catalogue: &Catalogue, group: &[Column]) -> Deformation {
        let mut deformation = problem.nominal();
        for ((column, _), value) in nuisances(problem).iter().zip(&self.nuisances) {
            column.add(*value, &problem.scene, &mut deformation);
        }
        for (column, value) in group.iter().zip(&self.group) {
            column.add(*value, &problem.scene, &mut deformation);
        }
        for term in &self.terms {
            let place = catalogue.hypotheses[term.hypothesis].place;
            catalogue.effect(term.hypothesis).deform(
                &problem.scene,
                place,
                term.variant,
                &term.parameters,
                &mut deformation,
            );
        }
        deformation
    }

    /// The causes of this model in the catalogue of another scene of the same robot, by their names; those that it lacks are
    /// left out.
    pub fn causes_in(
        &self,
        (catalogue, scene): (&Catalogue, &Scene),
        (other, other_scene): (&Catalogue, &Scene),
    ) -> Vec<Term> {
        let find = |term: &Term| {
            let name = catalogue.name(scene, term.hypothesis);
            let hypothesis = (0..other.hypotheses.len()).find(|&h| other.name(other_scene, h) == name)?;
            Some(Term { hypothesis, ..term.clone() })
        };
        self.terms.iter().filter_map(find).collect()
    }
}
