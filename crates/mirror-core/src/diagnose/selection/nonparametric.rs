//! Non-parametric search: the same search with free-form errors as hypotheses, and what is reported where they are
//! needed.
//!
//! A gap that no effect explains is absorbed piece by piece by false causes: an unmodelled lens by links of other
//! lengths, an unknown law of a joint by three laws of its neighbours. A free-form error at the right place explains
//! it better and with fewer parameters. So the search is repeated with [free
//! forms](crate::diagnose::random_effects::free_form) as hypotheses like any other, at longer odds than the
//! vocabulary's. If the best of those models needs one, the vocabulary is not sufficient.

use crate::diagnose::criteria::lack_of_fit::Adequacy;
use crate::diagnose::criteria::marker_shift::marker_shift;
use crate::diagnose::data::depends_on::DependsOn;
use crate::diagnose::data::diagnosis::Where;
use crate::diagnose::effects::Place;
use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::likelihood::score_sums::ScoreSums;
use crate::diagnose::likelihood::score_test::scored;
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::problem::Noise;
use crate::diagnose::model::scene::Scene;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::model::work_budget::A_STAGE;
use crate::diagnose::principles::{LOG_PRIOR_FREE, LOG_PRIOR_STRUCTURE, TEMPER, Threshold};
use crate::diagnose::selection::candidates::{LEAST_REACH, REACH};
use crate::diagnose::selection::free_form_start::free_form_start;
use crate::diagnose::selection::search::{Found, Search, SearchOptions};
use crate::error::Result;

/// A cause with a free-form error at its own joint is kept only if its shift, squared, is this many times the
/// error's.
pub(crate) const IMITATOR_SHARE: Threshold = 4.0;

/// Where the unexplained part lives: the place that matters most first.
#[derive(Debug, Clone, Default)]
pub(crate) struct Unexplained {
    pub places: Vec<UnexplainedPlace>,
}

impl Unexplained {
    /// A joint with an independent error in each posture.
    pub fn erratic(node: NodeId) -> Self {
        let place = Some(Place::Joint(node));
        Self {
            places: vec![UnexplainedPlace { place, depends_on: Some(DependsOn::EachPosture), shift: 1.0 }],
        }
    }

    /// All joints with an independent error in each posture.
    pub fn scattered() -> Self {
        let place = UnexplainedPlace { place: None, depends_on: Some(DependsOn::EachPosture), shift: 1.0 };
        Self { places: vec![place] }
    }

    /// Whether the remainder has neither a known law nor a place: of no place, or independent in each posture.
    pub fn is_lawless(&self) -> bool {
        let by_itself = |p: &UnexplainedPlace| p.depends_on == Some(DependsOn::EachPosture);
        self.places.iter().all(|p| p.place.is_none() || by_itself(p))
    }

    /// Free-form errors; none where there are none.
    pub fn at(all: &Catalogue, hypotheses: &[usize]) -> Option<Self> {
        let place = |&h: &usize| UnexplainedPlace {
            place: Some(all.hypotheses[h].place),
            depends_on: all.effect(h).depends_on().cloned(),
            shift: 1.0,
        };
        (!hypotheses.is_empty()).then(|| Self { places: hypotheses.iter().map(place).collect() })
    }

    /// A remainder without a place.
    pub fn anywhere() -> Self {
        Self { places: vec![UnexplainedPlace { place: None, depends_on: None, shift: 0.0 }] }
    }
}

/// A place at which the vocabulary is not enough.
#[derive(Debug, Clone)]
pub(crate) struct UnexplainedPlace {
    /// None where it could not be found, or is the whole robot.
    pub place: Option<Place>,
    pub depends_on: Option<DependsOn>,
    /// Sum over the markers' observations of the squared shift that the free-form error makes, in variances.
    pub shift: f64,
}

impl UnexplainedPlace {
    /// The place in the public vocabulary.
    pub fn name(&self, scene: &Scene) -> String {
        match (self.place, &self.depends_on) {
            (Some(place), _) => place.name(scene),
            (None, Some(_)) => Where::ROBOT.into(),
            (None, None) => Where::NOWHERE.into(),
        }
    }
}

/// Whether there is reason for models beyond the vocabulary.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn is_suspicious(
    search: &Search<'_>,
    found: &Found,
    all: &Catalogue,
    adequacy: &Adequacy,
    many_false: bool,
) -> Result<bool> {
    let terms = found.fit.model.terms.len();
    // Several causes may together imitate one unknown law.
    if adequacy.significant || adequacy.corners_significant || many_false || terms > 1 {
        return Ok(true);
    }
    Ok(gain_of_free_form(search, found, all)? > -LOG_PRIOR_FREE)
}

/// How much more probable the likeliest free-form error makes what was found, to first order: its log Bayes factor with its prior
/// among hypotheses.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn gain_of_free_form(search: &Search<'_>, found: &Found, all: &Catalogue) -> Result<f64> {
    let wide = Search { catalogue: all, ..search.clone() };
    let (group, start) = wide.loosened(&found.fit.model, None);
    let free = (all, all.first_free()..all.hypotheses.len());
    let sums = ScoreSums::of(&search.problem, free, &group, &start, found.noise, search.mask)?;
    let own: Vec<usize> = start.terms.iter().map(|t| t.hypothesis).collect();
    let scores = scored(&sums, all, &own, &[]).scores;
    let gains = scores.iter().map(|s| s.log_bayes + all.hypotheses[s.hypothesis].log_prior);
    Ok(gains.fold(f64::NEG_INFINITY, f64::max))
}

/// The search with free-form errors as hypotheses, and its log posterior odds against what was found.
pub(crate) struct BesideFreeForms<'a> {
    pub search: Search<'a>,
    pub found: Found,
    pub log_odds: f64,
}

impl BesideFreeForms<'_> {
    /// By what factor it is more probable than the causes that were found, at the weight of all evidence here; none
    /// where it has no free-form error.
    pub fn weight(&self) -> Option<f64> {
        let free = |h: usize| self.search.catalogue.is_free(h);
        let unnamed = self.found.fit.model.terms.iter().any(|t| free(t.hypothesis));
        unnamed.then(|| (TEMPER * self.log_odds).min(0.0).exp())
    }
}

/// The search with free-form errors as hypotheses, from the nominal model and from the causes found; none where no
/// work is left for it.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn beside_free_forms<'a>(
    search: &Search<'a>,
    found: &Found,
    all: &'a Catalogue,
    nominal: &Model,
    enough: bool,
) -> Result<Option<BesideFreeForms<'a>>> {
    if search.problem.budget.is_spent() {
        return Ok(None);
    }
    let terms = found.fit.model.terms.len();
    // Where the causes suffice, with or without displaced mounts, free-form errors must do with no more.
    let most_causes = if enough { terms.max(1) } else { search.options.most_causes };
    // Beside a free warp of all pictures an offset of the markers' alone would take a part of that.
    let own = |h: usize| found.fit.model.terms.iter().any(|t| t.hypothesis == h);
    let of_detection = (0..all.hypotheses.len()).filter(|&h| all.effect(h).is_of_detection() && !own(h));
    // What a free mount does is no error without a law.
    let of_mounts = (0..all.hypotheses.len()).filter(|&h| !own(h) && is_in_group(search, all, h));
    let left_out = search.options.left_out.iter().copied().chain(of_detection).chain(of_mounts).collect();
    let wide = Search {
        catalogue: all,
        options: SearchOptions { most_causes, left_out, named_only: false, ..search.options.clone() },
        ties: Vec::new(),
        ..search.clone()
    };
    let Some((beside, result)) = searched_beside(&wide, found, nominal, enough)? else { return Ok(None) };
    let (beside, result) = with_or_without_mounts((beside, result), nominal)?;
    let odds = log_odds((&beside, &result), (search, found))?;
    let free = result.fit.model.terms.iter().any(|t| all.is_free(t.hypothesis));
    // Laws are never exact, and data that contradict them are many: a free-form error may absorb only that. Several
    // causes, or causes and displaced mounts, that suffice are pieces that together may imitate one law: what takes
    // the place of several absorbs nothing.
    let pieces = |model: &Model| model.terms.len() + usize::from(!model.group.is_empty());
    let in_place_of_pieces = enough && pieces(&result.fit.model) < pieces(&found.fit.model);
    let prior = if free && !in_place_of_pieces { LOG_PRIOR_STRUCTURE } else { 0.0 };
    Ok(Some(BesideFreeForms { search: beside, found: result, log_odds: odds + prior }))
}

/// Whether a free-form error has no columns but the group's.
fn is_in_group(search: &Search<'_>, all: &Catalogue, hypothesis: usize) -> bool {
    let unscaled = all.hypotheses[hypothesis].variants.first().copied().unwrap_or_default();
    let with = Model::nominal(&search.problem).with(all, hypothesis, unscaled);
    all.is_free(hypothesis)
        && with
            .terms
            .last()
            .is_some_and(|term| search.group.contains(&all.columns(&search.problem.scene, term)))
}

/// The search with free-form errors. Beside causes that are `enough` it is from the most probable set of one linear model of
/// what was found; none where that shows that no such error can compete with them. Otherwise it is from the causes found and from
/// the nominal model, and what is more probable counts; where that is much work, from that set, or from the causes found if no such error is in it.
fn searched_beside<'a>(
    wide: &Search<'a>,
    found: &Found,
    nominal: &Model,
    enough: bool,
) -> Result<Option<(Search<'a>, Found)>> {
    let from = |start: &Model| {
        let mut beside = wide.clone();
        let result = beside.run(start.clone())?;
        Ok((beside, result))
    };
    if enough && let Some(choice) = free_form_start(wide, found)? {
        let in_reach = choice.log_odds > -(LEAST_REACH + REACH * choice.gain.max(0.0));
        return if choice.has_free && in_reach { from(&choice.model).map(Some) } else { Ok(None) };
    }
    // From the nominal model it takes as long as all that was done before, and mounts must be displaced again: where that is much,
    // the start is the most probable linear model. With neither causes nor displaced mounts the nominal model is what was found.
    let has_causes = !found.fit.model.terms.is_empty();
    let much = has_causes && wide.problem.budget.share_of_session() > A_STAGE;
    let costly = much || !found.fit.model.group.is_empty();
    if costly && let Some(choice) = free_form_start(wide, found)? {
        return from(if choice.has_free { &choice.model } else { &found.fit.model }).map(Some);
    }
    let best = from(nominal)?;
    if enough || !has_causes || wide.problem.budget.is_spent() {
        return Ok(Some(best));
    }
    let other = from(&found.fit.model)?;
    let better = log_odds((&other.0, &other.1), (&best.0, &best.1))? > 0.0;
    Ok(Some(if better { other } else { best }))
}

/// Mounts were displaced where no free-form error was known: beside one they are as modelled where that is more probable.
fn with_or_without_mounts<'a>(
    (displaced, result): (Search<'a>, Found),
    nominal: &Model,
) -> Result<(Search<'a>, Found)> {
    let free = |h: usize| displaced.catalogue.is_free(h);
    let columns = result.fit.model.group.len() - nominal.group.len().min(result.fit.model.group.len());
    if columns == 0 || !result.fit.model.terms.iter().any(|t| free(t.hypothesis)) {
        return Ok((displaced, result));
    }
    // The mounts are the first columns.
    let mut as_modelled = displaced.clone();
    as_modelled.group = displaced.group.after(columns);
    let model = Model { group: nominal.group.clone(), ..result.fit.model.clone() };
    let fit = as_modelled.fit(&model, result.noise, SOLVER.loose_steps)?;
    let mut without = Found { fit, ..result.clone() };
    if log_odds((&displaced, &result), (&as_modelled, &without))? + LOG_PRIOR_STRUCTURE > 0.0 {
        return Ok((displaced, result));
    }
    without.trace.push("beside free-form errors the mounts are as modelled".into());
    // What was found beside displaced mounts may be needless beside mounts as modelled, or something may be in its place.
    let mut found = as_modelled.run(without.fit.model)?;
    found.trace.splice(0..0, without.trace);
    Ok((as_modelled, found))
}

/// Log posterior odds of one search's result against another's, both at the smaller of their noises.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn log_odds(one: (&Search<'_>, &Found), other: (&Search<'_>, &Found)) -> Result<f64> {
    let noise = smaller(one.1.noise, other.1.noise);
    Ok(log_posterior_at(one, noise)? - log_posterior_at(other, noise)?)
}

/// Log of a result's evidence times prior at a noise, with exact laws or with their discrepancy, whichever is more
/// probable.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn log_posterior_at((search, found): (&Search<'_>, &Found), noise: Noise) -> Result<f64> {
    let exact = search.fit(&found.fit.model, noise, SOLVER.loose_steps)?;
    let loose = search.fit_with_slack(&found.fit.model, None, noise, SOLVER.loose_steps)?;
    Ok(search.log_posterior(&exact).max(search.log_posterior(&loose)))
}

/// The smaller noise of two.
pub(crate) fn smaller(a: Noise, b: Noise) -> Noise {
    let size = |n: &Noise| n.marker_px + 1e3 * n.point_m;
    if size(&a) < size(&b) { a } else { b }
}

/// The unexplained part of the result: its free-form errors, or a remainder without a place; none where the named
/// causes have `reached` the floor and there are no such errors.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn unexplained(
    search: &Search<'_>,
    found: &Found,
    adequacy: &Adequacy,
    reached: bool,
) -> Result<Option<Unexplained>> {
    let scene = &search.problem.scene;
    let all = search.deformation(&found.fit.model);
    let mut out = Unexplained::default();
    for (i, term) in found.fit.model.terms.iter().enumerate() {
        if !search.catalogue.is_free(term.hypothesis) {
            continue;
        }
        let without = search.deformation(&found.fit.model.without(i));
        let shift = marker_shift(&search.problem, &without, &all, search.measured_noise)?.iter().sum();
        out.places.push(UnexplainedPlace {
            place: Some(search.catalogue.hypotheses[term.hypothesis].place),
            depends_on: search.catalogue.effect(term.hypothesis).depends_on().cloned(),
            shift,
        });
    }
    out.places.sort_by(|a, b| b.shift.total_cmp(&a.shift));
    if out.places.is_empty() {
        // A small remainder that no free form finds a structure in is scatter: coloured noise, postures not quite settled.
        let named = found.fit.model.explains();
        if reached {
            return Ok(None);
        }
        let large = adequacy.significant && (named || adequacy.excess >= adequacy.stands_out_from);
        if !large && !adequacy.corners_significant {
            return Ok(None);
        }
        let place = (adequacy.corners_significant && scene.has_camera).then_some(Place::Camera);
        out.places.push(UnexplainedPlace { place, depends_on: None, shift: 0.0 });
    }
    Ok(Some(out))
}

/// Removes causes at the joint or link of a free-form error of comparable size: together they imitate a law that
/// the vocabulary lacks, and none of them is credible.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn retract_imitators(search: &Search<'_>, found: &mut Found) -> Result<()> {
    if !found.fit.model.terms.iter().any(|t| search.catalogue.is_free(t.hypothesis)) {
        return Ok(());
    }
    let all = search.deformation(&found.fit.model);
    let shifts = (0..found.fit.model.terms.len())
        .map(|i| {
            let without = search.deformation(&found.fit.model.without(i));
            Ok(marker_shift(&search.problem, &without, &all, search.measured_noise)?.iter().sum())
        })
        .collect::<Result<Vec<f64>>>()?;
    let terms = &found.fit.model.terms;
    let node = |i: usize| search.catalogue.hypotheses[terms[i].hypothesis].place.node();
    let is_free = |i: usize| search.catalogue.is_free(terms[i].hypothesis);
    let imitates = |i: usize| {
        !is_free(i)
            && node(i).is_some()
            && (0..terms.len())
                .any(|k| is_free(k) && node(k) == node(i) && shifts[i] < IMITATOR_SHARE * shifts[k])
    };
    let retracted: Vec<usize> = (0..terms.len()).filter(|&i| imitates(i)).collect();
    if retracted.is_empty() {
        return Ok(());
    }
    let mut rest = found.fit.model.clone();
    for &i in retracted.iter().rev() {
        let name = search.catalogue.name(&search.problem.scene, terms[i].hypothesis);
        found.trace.push(format!("drop {name}: it imitates a law that the vocabulary lacks"));
        rest.terms.remove(i);
    }
    found.fit = search.fit(&rest, found.noise, SOLVER.without_steps)?;
    Ok(())
}

/// Whether a model has free-form errors at places that are not places of these causes.
pub(crate) fn elsewhere(all: &Catalogue, with_free: &Model, causes: &Model) -> bool {
    let place = |h: usize| all.hypotheses[h].place;
    let has_cause = |at: Place| causes.terms.iter().any(|c| are_together(place(c.hypothesis), at));
    let mut free = with_free.terms.iter().filter(|t| all.is_free(t.hypothesis));
    free.any(|t| !has_cause(place(t.hypothesis)))
}

/// Whether two places are the same, or the joint and the link of one node.
pub(crate) fn are_together(one: Place, other: Place) -> bool {
    one == other || (one.node().is_some() && one.node() == other.node())
}
