//! One scale of all measured points, in place of the causes that were named.
//!
//! A tracker or a wand whose scale is off by f measures `(1 + f) p`. The vocabulary has no word for it. It is told as many lengths and
//! mounts, each with confidence, for all of these are off in proportion. So the model without these is compared with points that are
//! divided by `1 + f`: with the session's unknowns and the other causes fitted, the mean square of what is left is
//! `g(f) = g₀ + c (f − f₀)²`, and three values of f tell f₀, its standard deviation `σ/√(n c)` with σ² the mean square that is left of
//! n points, and what it leaves.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::criteria::cross_validation::{in_sample, seen_size};
use crate::diagnose::data::diagnosis::Diagnosis;
use crate::diagnose::effects::hypothesis::Model;
use crate::diagnose::likelihood::fit::Group;
use crate::diagnose::likelihood::probability::unfinished;
use crate::diagnose::model::problem::{Observation, Problem};
use crate::diagnose::principles::{A_GAP, FAR_DEVIATIONS, Grid};
use crate::diagnose::selection::search::Search;
use crate::error::Result;

/// The scales that are tried about none, and about the best of these.
const STEP: Grid = 0.005;

/// A factor of all measured points, with its standard deviation, and what it leaves (root mean square, m).
struct Scale {
    factor: f64,
    std: f64,
    left_m: f64,
}

/// Limits what is told where one scale of the points leaves no more than several causes do: each may be a part of it.
///
/// # Errors
/// Invalid parameters of a model.
pub(crate) fn beside_one_scale(diagnosis: &mut Diagnosis, findings: &Findings<'_>) -> Result<()> {
    let (search, found) = (&findings.search, &findings.found.fit.model);
    let lengths = diagnosis.causes.iter().filter(|c| is_of_lengths(&c.effect)).count();
    let several = lengths > 1 || !found.group.is_empty();
    if search.problem.camera.is_some() || !several {
        return Ok(());
    }
    let mut others = Model { group: Vec::new(), ..found.clone() };
    others.terms.retain(|term| !is_of_lengths(search.catalogue.effect(term.hypothesis).name()));
    let problem = &search.problem;
    let with_causes = seen_size(&in_sample(problem, &search.deformation(found), problem.noise)?);
    let told = |s: &Scale| s.factor.abs() >= FAR_DEVIATIONS * s.std && s.left_m <= A_GAP * with_causes;
    let Some(scale) = best_scale(search, &others)?.filter(told) else {
        return Ok(());
    };
    for cause in diagnosis.causes.iter_mut().filter(|c| is_of_lengths(&c.effect)) {
        cause.probability = unfinished(cause.probability);
    }
    diagnosis.warnings.push(format!(
        "one scale of all measured points, {:+.3} ± {:.3} %, leaves {:.2} mm {}, and the causes named leave {:.2} mm: measure a distance that is known before \
         lengths or mounts are changed",
        scale.factor * 100.0,
        scale.std * 100.0,
        scale.left_m * 1e3,
        if others.terms.is_empty() { "with nothing else wrong" } else { "in place of lengths and mounts" },
        with_causes * 1e3
    ));
    Ok(())
}

/// Whether an effect is off in proportion where the points' scale is.
fn is_of_lengths(effect: &str) -> bool {
    ["link_length", "marker_mount", "joint_origin", "geometry"].contains(&effect)
}

/// The scale with which a model of the other causes leaves least; none where the points do not show it.
fn best_scale(search: &Search<'_>, others: &Model) -> Result<Option<Scale>> {
    let (mut middle, mut curvature) = (0.0, 0.0);
    // What is false at the wrong scale has no weight there, so the vertex is looked for again where it is.
    for _ in 0..2 {
        let less = left_by(search, others, middle - STEP)?;
        let more = left_by(search, others, middle + STEP)?;
        curvature = (less + more - 2.0 * left_by(search, others, middle)?) / (2.0 * STEP * STEP);
        middle += (less - more) / (4.0 * STEP * curvature);
        if !(curvature > 0.0 && middle.abs() < 1.0) {
            return Ok(None);
        }
    }
    let left = left_by(search, others, middle)?;
    let points = search.problem.frames.iter().map(|frame| frame.others.len()).sum::<usize>() as f64;
    Ok(Some(Scale { factor: middle, std: (left / (points * curvature)).sqrt(), left_m: left.sqrt() }))
}

/// Mean square, m², of what a model leaves of points divided by `1 + factor`.
fn left_by(search: &Search<'_>, model: &Model, factor: f64) -> Result<f64> {
    let scaled = scaled(&search.problem, factor);
    let group = Group::default();
    let its = Search { problem: scaled, group, mask: None, scatter: None, ..search.clone() };
    let (fit, _) = its.fit_at_its_scatter(model)?;
    let gaps = in_sample(&its.problem, &its.deformation(&fit.model), its.problem.noise)?;
    Ok(seen_size(&gaps).powi(2))
}

fn scaled(problem: &Problem, factor: f64) -> Problem {
    let mut problem = problem.clone();
    for observation in problem.frames.iter_mut().flat_map(|frame| frame.others.iter_mut()) {
        if let Observation::Point { position, .. } = observation {
            *position /= 1.0 + factor;
        }
    }
    problem
}
