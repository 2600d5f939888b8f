//! The fits of one model without each part of the frames, as cross-validation needs them.
//!
//! All begin at the same parameters. There the normal equations of all frames but a part's are those of the other parts added
//! up: `H₋ᵣ = Σ Hₛ, s ≠ r`. So their first step together takes one pass over the frames, not one for each part; mostly it is
//! the only one ([`Until::WithinDeviations`]), from the fit to all frames.

use crate::diagnose::criteria::regions::{all_but, frames_of, only};
use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::likelihood::fit::{Fit, FitOptions, Group, Until, fit, fit_on, linearise};
use crate::diagnose::likelihood::normal_equations::Normal;
use crate::diagnose::model::problem::Problem;
use crate::error::Result;
use rayon::prelude::*;

/// The model fitted to all frames but each part's; `labels`: the part of each frame, counted from 0. A single part is fitted to
/// itself, to its best.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn fit_without_each(
    problem: &Problem,
    catalogue: &Catalogue,
    group: &Group,
    start: &Model,
    options: FitOptions,
    labels: &[usize],
    until: Until,
) -> Result<Vec<Fit>> {
    let count = frames_of(labels).len();
    if count < 2 {
        return Ok(vec![fit(problem, catalogue, group, start, options, None)?]);
    }
    let planes = start.planes.as_deref();
    let of_part = |part: usize| {
        let own = only(labels, part);
        linearise(problem, catalogue, group, start, options.noise, planes, Some(&own))
    };
    let parts = (0..count).into_par_iter().map(of_part).collect::<Result<Vec<_>>>()?;
    let without = |part: usize| {
        let others = parts.iter().enumerate().filter(|(other, _)| *other != part);
        let normal = Normal::of_parts(&others.map(|(_, (normal, _))| normal).collect::<Vec<_>>());
        let first = (start, (normal, parts[part].1.clone()));
        fit_on(problem, catalogue, group, first, options, Some(&all_but(labels, part)), until)
    };
    Ok((0..count).into_par_iter().map(without).collect())
}
