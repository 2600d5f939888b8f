//! Models beyond single causes: free-form errors where there is reason for doubt, a joint with an independent error
//! in each posture, and small errors everywhere where a remainder or many causes are left.

use crate::diagnose::criteria::cross_validation::size;
use crate::diagnose::criteria::lack_of_fit::adequacy;
use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::likelihood::noise::trimmed_share;
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::model::work_budget::A_STAGE;
use crate::diagnose::prepare::false_observations::without_false;
use crate::diagnose::principles::ABOVE_SCATTER;
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::selection::erratic_joint::beside_erratic_joint;
use crate::diagnose::selection::law_remainder::{MANY_CAUSES, only_their_laws};
use crate::diagnose::selection::nonparametric::{
    BesideFreeForms, Unexplained, beside_free_forms, is_suspicious, retract_imitators,
};
use crate::diagnose::selection::search::{Found, Search};
use crate::diagnose::selection::with_tolerances::{BesideGeometry, beside_geometry, small_errors_help};
use crate::error::Result;

/// What was seen on the way.
pub(crate) struct Extended {
    /// Small errors everywhere, where they are part of the answer.
    pub geometry: Option<Geometry>,
    /// The joint with an independent error in each posture.
    pub erratic: Option<NodeId>,
    /// Places where free-form errors explain more than the reported small errors.
    pub unnamed: Option<Unexplained>,
    /// A free-form error that is less probable than the causes found, which suffice.
    pub unnamed_law: Option<UnnamedLaw>,
    /// The causes that a search without free-form errors found, if it came to its end before one with them took its place: hypotheses.
    pub ended_with: Option<Vec<usize>>,
    /// The problem without the observations that the best model shows to be false.
    pub clean: Problem,
}

/// A free-form error that could be in the place of causes.
pub(crate) struct UnnamedLaw {
    /// How probable it is: a multiple of how probable the causes are, 1 at most.
    pub weight: f64,
    /// The causes that it leaves as they are: hypotheses.
    pub beside: Vec<usize>,
}

impl Extended {
    /// Nothing beyond what was found, and small errors.
    pub fn with(geometry: Option<Geometry>, clean: Problem) -> Self {
        Self { geometry, erratic: None, unnamed: None, unnamed_law: None, ended_with: None, clean }
    }

    /// Nothing beyond what was found with free mounts.
    pub fn nothing(search: &Search<'_>, found: &Found, setup: &Geometry) -> Result<Self> {
        let (clean, _) = without_false(&search.problem, &search.deformation(&found.fit.model), found.noise)?;
        let geometry = Some(setup.clone()).filter(|_| !found.fit.model.group.is_empty());
        Ok(Self::with(geometry, clean))
    }
}

impl UnnamedLaw {
    fn of(beside: &BesideFreeForms<'_>) -> Option<Self> {
        let terms = beside.found.fit.model.terms.iter().map(|t| t.hypothesis).collect();
        beside.weight().map(|weight| Self { weight, beside: terms })
    }
}

/// Whether the gap that the named causes leave on held-out regions, without the free-form errors, which cannot be added
/// to a model, is far above the noise. It is asked where residuals of the fit cannot show it: with free-form errors, or
/// where the noise of measured points is only stated, and no views show it.
fn hangs_on_no_name(search: &Search<'_>, found: &Found) -> Result<bool> {
    let terms = &found.fit.model.terms;
    let free = terms.iter().any(|t| search.catalogue.is_free(t.hypothesis));
    if !free && (terms.is_empty() || search.problem.camera.is_some()) {
        return Ok(false);
    }
    let left = size(&search.held_out_of_causes(&found.fit.model, found.noise)?);
    Ok(left.rms_m > ABOVE_SCATTER * left.floor_m)
}

/// Searches models beyond single causes and replaces what was found if one is more probable; `setup` are the mounts
/// that were set free.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn extend_models<'a>(
    (search, found): (&mut Search<'a>, &mut Found),
    all: &'a Catalogue,
    nominal: &Model,
    setup: Option<Geometry>,
    with_geometry: bool,
) -> Result<Extended> {
    let without_false = |search: &Search<'_>, found: &Found| {
        without_false(&search.problem, &search.deformation(&found.fit.model), found.noise)
    };
    let left = |search: &Search<'_>, found: &Found, clean: &Problem| {
        adequacy(clean, &search.deformation(&found.fit.model), search.measured_noise)
    };
    let budget = search.problem.budget.clone();
    budget.allow(1.0 - A_STAGE);
    // Displaced mounts may have taken it: what has no name would be told as the mounts and pieces that nearly absorb it.
    if budget.is_spent() {
        budget.allow_more(A_STAGE);
    }
    let freed = setup.is_some();
    let mut geometry = setup;
    let (mut clean, false_share) = without_false(search, found)?;
    let mut fits_noise = left(search, found, &clean)?;
    let named = search.clone();
    let doubtful = fits_noise.significant;
    let many_false = false_share > trimmed_share();
    let enough = !fits_noise.significant && !fits_noise.corners_significant && !many_false;
    let mut unnamed_law = None;
    let mut has_free_forms = false;
    let mut ended_with = None;
    if (freed || is_suspicious(search, found, all, &fits_noise, many_false)?)
        && let Some(beside) = beside_free_forms(search, found, all, nominal, enough)?
    {
        found.trace.push(format!("with free-form errors: log odds {:.1}", beside.log_odds));
        if beside.log_odds <= 0.0 {
            unnamed_law = UnnamedLaw::of(&beside).filter(|_| enough);
        } else if !only_their_laws(search, found, (&beside.search, &beside.found), all)? {
            let trace = core::mem::take(&mut found.trace);
            let causes = found.fit.model.terms.iter().map(|t| t.hypothesis).collect();
            ended_with = (!found.cut_off).then_some(causes);
            (*search, *found) = (beside.search, beside.found);
            found.trace.splice(0..0, trace);
            has_free_forms = true;
            (clean, _) = without_false(search, found)?;
            fits_noise = left(search, found, &clean)?;
        }
    }
    budget.allow(1.0);
    let mut erratic = None;
    if doubtful && let Some(beside) = beside_erratic_joint(search, found, nominal)? {
        erratic = Some(beside.node);
        has_free_forms = false;
        (*search, *found) = (beside.search, beside.found);
        (clean, _) = without_false(search, found)?;
    }
    let mut unnamed = None;
    let many = found.fit.model.terms.len() > MANY_CAUSES;
    let free = found.fit.model.terms.iter().any(|t| search.catalogue.is_free(t.hypothesis));
    let in_residuals = fits_noise.significant || many;
    let hangs = !in_residuals && with_geometry && hangs_on_no_name(search, found)?;
    let seen = in_residuals || hangs && free || with_geometry && small_errors_help(search, found)?;
    let doubtful = seen || hangs;
    if erratic.is_none() && with_geometry && doubtful {
        // Where the residuals of a few causes show nothing, their laws' own errors may be what is left on held-out
        // regions: only evidence counts then.
        let enough = |beside: &BesideGeometry<'_>| seen || beside.settled;
        if let Some(beside) = beside_geometry(&named, (search, found), nominal)?.filter(enough) {
            geometry = Some(beside.geometry);
            (unnamed, unnamed_law) = (beside.unnamed, None);
            has_free_forms = false;
            (*search, *found) = (beside.search, beside.found);
        }
        (clean, _) = without_false(search, found)?;
    }
    // Only now: what competes with a law that is imitated competes with all that describes it.
    if has_free_forms {
        retract_imitators(search, found)?;
        (clean, _) = without_false(search, found)?;
    }
    geometry = geometry.filter(|_| !found.fit.model.group.is_empty());
    Ok(Extended { geometry, erratic, unnamed, unnamed_law, ended_with, clean })
}
