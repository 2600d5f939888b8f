//! The search for causes where all joints come to rest elsewhere in each posture ([`crate::diagnose::likelihood::joint_scatter`]):
//! a robot that repeats badly, or a log that was rounded.
//!
//! No law describes such errors, and at the measured noise each of them is evidence of something: the search then adds
//! causes, free-form errors and small errors everywhere that describe some of the postures, to its limit of work. Where
//! what was found is less probable than few causes beside the joints' scatter, the search is repeated at the noise at
//! which a posture's observations are as uncertain as they are, and the scatter is told as what is left.

use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::likelihood::fit::FitOptions;
use crate::diagnose::likelihood::joint_scatter::{JointScatter, Scatter, scattering_joints};
use crate::diagnose::likelihood::noise::SETTLED;
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::problem::Noise;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::model::work_budget::A_STAGE;
use crate::diagnose::prepare::options::DiagnoseOptions;
use crate::diagnose::principles::{LEAST_LOG_ODDS, LOG_PRIOR_STRUCTURE};
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::selection::extended_models::{Extended, extend_models};
use crate::diagnose::selection::scatter_evidence::{Weighed, scatter_stands_out};
use crate::diagnose::selection::search::{Found, Search};
use crate::diagnose::selection::with_setup::with_or_without_setup;
use crate::error::Result;

/// The result of a search beside the joints' scatter.
struct BesideScatter<'a> {
    search: Search<'a>,
    found: Found,
    extended: Extended,
}

/// What a search beside the joints' scatter starts from.
struct Start<'a, 's> {
    /// The search before any mount was set free.
    plain: &'s Search<'a>,
    nominal: &'s Model,
    stated: Noise,
    options: &'s DiagnoseOptions,
    /// What was found beyond single causes.
    extended: &'s Extended,
    /// All hypotheses, free-form errors included.
    all: &'a Catalogue,
}

/// What is found beyond single causes: free-form errors, small errors everywhere, a scatter of all joints. The search
/// becomes the most probable one; `setup` are the mounts that were set free.
///
/// Where joints rest elsewhere beside free mounts, free-form errors at the measured noise would describe single
/// postures, one after the other to the limit of work: the search beside the scatter then comes before them.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn beyond_single_causes<'a>(
    plain: &Search<'a>,
    (search, found): (&mut Search<'a>, &mut Found),
    setup: Option<Geometry>,
    (nominal, stated): (&Model, Noise),
    (options, all): (&DiagnoseOptions, &'a Catalogue),
) -> Result<Extended> {
    if let Some(mounts) = &setup
        && scatter_stands_out(search, found, all)?
    {
        let extended = Extended::nothing(search, found, mounts)?;
        let start = Start { plain, nominal, stated, options, extended: &extended, all };
        if let Some(beside) = beside_scatter(&start, search, found)? {
            (*search, *found) = (beside.search, beside.found);
            return Ok(beside.extended);
        }
    }
    let extended = extend_models((search, found), all, nominal, setup, options.allows("geometry"))?;
    let start = Start { plain, nominal, stated, options, extended: &extended, all };
    // It would be a whole search more.
    if search.problem.budget.is_over() {
        return Ok(extended);
    }
    let Some(beside) = beside_scatter(&start, search, found)? else { return Ok(extended) };
    (*search, *found) = (beside.search, beside.found);
    Ok(beside.extended)
}

/// The search beside a scatter of all joints; none where what was found is more probable.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
fn beside_scatter<'a>(
    start: &Start<'a, '_>,
    search: &Search<'a>,
    found: &Found,
) -> Result<Option<BesideScatter<'a>>> {
    let joints = scattering_joints(&search.problem);
    // Measured points of one posture share the error of a measured pose: joints that scatter look like that.
    if search.problem.camera.is_none() || joints.is_empty() {
        return Ok(None);
    }
    // Where no scatter can be more likely, and no noise is above the measured one that it could reduce, it need not be fitted.
    if start.extended.erratic.is_none() {
        let deformation = search.deformation(&found.fit.model);
        let (gain, noise) =
            JointScatter::gain(&search.problem, &deformation, &joints, search.measured_noise, search.mask)?;
        if noise * SETTLED <= 1.0 && SOLVER.most_hoped * gain + LOG_PRIOR_STRUCTURE < 0.0 {
            return Ok(None);
        }
    }
    let weighed = Weighed::new(search, found, &joints)?;
    let (here, beside) = weighed.with_scatter(search, &found.fit, &joints)?;
    // Beside the errors of a joint that rests anywhere no scatter of all joints shows.
    if start.extended.erratic.is_none()
        && (here + LOG_PRIOR_STRUCTURE < weighed.of_found
            || weighed.one_is_likelier(search, found, &joints, here)?)
    {
        return Ok(None);
    }
    let scatter = Scatter { std_rad: beside.std_rad, widening: beside.widening };
    let (mut beside, mut its, setup) = searched(start, search, found, &weighed, scatter, &joints)?;
    let with_geometry = start.options.allows("geometry");
    let mut trace = found.trace.clone();
    trace.append(&mut its.trace);
    its.trace = trace;
    let extended = extend_models((&mut beside, &mut its), start.all, start.nominal, setup, with_geometry)?;
    // A law without a name may have taken the scatter's place.
    let (value, JointScatter { std_rad, .. }) = weighed.with_scatter(&beside, &its.fit, &joints)?;
    let without = weighed.without_scatter(&beside, &its.fit, &joints)?;
    let odds = value + LOG_PRIOR_STRUCTURE - weighed.of_found.max(without);
    // Where what was found is more probable even beside a scatter, the scatter does not replace it.
    let replaces = value > here;
    its.trace.push(format!(
        "all joints with an independent error in each posture ({:.2} mrad): log odds {odds:.1}",
        std_rad * 1e3
    ));
    let told =
        replaces && odds > LEAST_LOG_ODDS && !weighed.one_is_likelier(&beside, &its, &joints, value)?;
    beside.scatter.iter_mut().for_each(|scatter| scatter.std_rad = std_rad);
    Ok(told.then_some(BesideScatter { search: beside, found: its, extended }))
}

/// A search's result and the mounts that it has free.
type Searched<'a> = (Search<'a>, Found, Option<Geometry>);

/// The search at the noise that a scatter makes, until the scatter beside what it finds is that.
fn searched<'a>(
    start: &Start<'a, '_>,
    search: &Search<'a>,
    found: &Found,
    weighed: &Weighed,
    mut scatter: Scatter,
    joints: &[NodeId],
) -> Result<Searched<'a>> {
    let measured = search.measured_noise;
    let free = start.extended.geometry.as_ref().filter(|g| g.setup_only && start.extended.erratic.is_none());
    let mut round = 0;
    loop {
        search.problem.budget.allow_more(A_STAGE);
        let widened = |mut its: Search<'a>| {
            its.noise_widening = search.noise_widening;
            its.measured_noise = scatter.widening.of(measured);
            its.problem.noise = its.measured_noise;
            its.scatter = Some(scatter);
            its
        };
        let beside = |(its, found, _): &Searched<'_>| weighed.with_scatter(its, &found.fit, joints);
        let anew = || -> Result<Searched<'a>> {
            search.problem.budget.allow_more(A_STAGE);
            let mut its = widened(start.plain.clone());
            let (few, setup) =
                with_or_without_setup(&mut its, start.nominal, start.stated, &start.options.without)?;
            Ok((its, few, setup))
        };
        // Mounts that only absorbed the scatter are not found again; displaced ones may take more work to find again than is left.
        let result = match free {
            None => anew()?,
            Some(mounts) => {
                let kept = from_free_mounts(widened(search.clone()), found, mounts.clone())?;
                if search.problem.budget.is_over() {
                    kept
                } else {
                    let other = anew()?;
                    if beside(&other)?.0 > beside(&kept)?.0 { other } else { kept }
                }
            }
        };
        let (_, left) = beside(&result)?;
        let JointScatter { std_rad, widening, .. } = left;
        round += 1;
        if widening.is_near(scatter.widening) || round == SOLVER.rounds || search.problem.budget.is_spent() {
            return Ok(result);
        }
        scatter = Scatter { std_rad, widening };
    }
}

/// The search with free mounts, from what was found with them: the causes found are pruned at the new noise first.
fn from_free_mounts<'a>(mut its: Search<'a>, found: &Found, mut mounts: Geometry) -> Result<Searched<'a>> {
    let mut model = found.fit.model.clone();
    model.terms.retain(|term| !its.catalogue.is_free(term.hypothesis));
    its.options.named_only = true;
    its.ties.clear();
    let mut again = its.run(model)?;
    let options = FitOptions { noise: again.noise, steps: SOLVER.loose_steps };
    again.fit = mounts.fit(&its.problem, its.catalogue, &again.fit.model, options, its.mask)?;
    its.group = mounts.group.clone();
    Ok((its, again, Some(mounts)))
}
