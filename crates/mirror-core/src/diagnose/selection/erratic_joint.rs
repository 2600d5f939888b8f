//! A joint with an independent error in each posture: friction, play or a slipping clutch, for which no static law
//! predicts the rest position.
//!
//! Each posture p has its own error at the joint, `δ_p ~ N(0, s²)`. With `h_p = xᵀx` and `g_p = xᵀr` of the joint's
//! column x in the frames of the posture, mirrors projected out, its log Bayes factor against none is, to first
//! order and with everything else as found, `Σ ½ [s² g_p² / (1 + s² h_p) − ln(1 + s² h_p)]`.
//! To first order this finds a few candidate joints, but not which one it is: large errors of one joint project on all
//! joints of its limb. So the errors of each of the best few are fitted robustly to convergence, with s estimated from
//! them, and the joint with the highest evidence is the place. If that explains the
//! remainder best at some joint, the search is repeated with these errors free. Causes elsewhere and smooth
//! free-form errors that only absorbed them are then no longer found. Small errors everywhere are the competing
//! explanation of a gap that is everywhere: they explain what is smooth over the postures, and no independent
//! errors.
//!
//! Source: a variance component by its score, Rao (1973).

use crate::diagnose::effects::hypothesis::Model;
use crate::diagnose::likelihood::fit::FitOptions;
use crate::diagnose::likelihood::noise_scale::NoiseScale;
use crate::diagnose::likelihood::normal_equations::{changes_sight, counts, inner};
use crate::diagnose::likelihood::saturated::postures;
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::elementary::{Atom, Column, Weight};
use crate::diagnose::model::frame::{FrameWork, PROJECTED, Task};
use crate::diagnose::model::problem::Noise;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::prepare::first_day::column;
use crate::diagnose::principles::{LEAST_LOG_ODDS, LOG_PRIOR_STRUCTURE, MAJORITY, Size};
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::selection::nonparametric::{log_posterior_at, smaller};
use crate::diagnose::selection::search::{Found, Search};
use crate::error::Result;
use rayon::prelude::*;

/// Scales that are tried, rad or m, in a geometric sequence: from a tenth of an encoder's line to a column that is
/// unrelated to its joint.
const SPREADS: (f64, f64, usize) = (2e-4, 1.5, 23);

/// Candidate joints whose errors are fitted.
const TRIED: Size = 3;

/// The result of a search with an independent joint error in each posture.
pub(crate) struct ErraticJoint<'a> {
    pub node: NodeId,
    pub search: Search<'a>,
    pub found: Found,
}

/// Whether a joint's column is unrelated to the joint: its independent errors are more than half of what the column
/// moves, root mean squares over the postures that were searched.
pub(crate) fn column_says_nothing(search: &Search<'_>, found: &Found, node: NodeId) -> bool {
    let scene = &search.problem.scene;
    // A column of the group is one posture's error.
    let posture = |column: &Column| match &column.weight {
        Weight::Frames(weights) if column.atom == Atom::Joint(node) => weights.iter().position(|w| *w > 0.0),
        _ => None,
    };
    let columns = search.group.columns.iter().zip(&found.fit.model.group);
    let of_postures = columns.filter_map(|(column, error)| Some((posture(column)?, *error)));
    let (positions, errors): (Vec<f64>, Vec<f64>) =
        of_postures.map(|(frame, error)| (scene.commanded[frame * scene.nodes() + node], error)).unzip();
    let mean = positions.iter().sum::<f64>() / positions.len().max(1) as f64;
    let moved: f64 = positions.iter().map(|q| (q - mean).powi(2)).sum();
    let elsewhere: f64 = errors.iter().map(|e| e * e).sum();
    elsewhere.sqrt() > MAJORITY * moved.sqrt()
}

/// The search with independent errors at the joint of the largest part of the remainder; none where what was found
/// explains it better.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn beside_erratic_joint<'a>(
    search: &Search<'a>,
    found: &Found,
    nominal: &Model,
) -> Result<Option<ErraticJoint<'a>>> {
    let here = best_joint(search, &found.fit.model, found.noise)?;
    if !here.is_some_and(is_probable) {
        return Ok(None);
    }
    // Without causes, so that none that only absorbed a part of it decides the place.
    let (bare, scatter) = without_causes(search, nominal)?;
    let joints = by_first_order(search, &bare, scatter)?;
    let Some(&(_, _, log_bayes)) = joints.first() else { return Ok(None) };
    if small_errors_take_it(search, nominal, scatter, log_bayes)? {
        return Ok(None);
    }
    let Some(Free { node, spread, mut beside, start }) = likeliest(search, nominal, &joints)? else {
        return Ok(None);
    };
    beside.options.named_only = true;
    let mut its = beside.run(start)?;
    drop_its_own(&beside, &mut its, (node, search.group.columns.len()))?;
    let deformation = search.deformation(&found.fit.model);
    let scale = NoiseScale::new(&search.problem, &deformation, search.measured_noise, search.mask)?;
    let value = |of: &Search<'_>, its: &Found| log_posterior_with_noise((of, its), &scale);
    let odds = value(&beside, &its)? - value(search, found)?;
    let joint = &search.problem.scene.body.nodes[node].joint;
    let mut trace = found.trace.clone();
    trace.append(&mut its.trace);
    trace.push(format!(
        "joint:{joint} with an independent error in each posture ({:.2} mrad): log odds {odds:.1}",
        spread * 1e3
    ));
    its.trace = trace;
    let is_told = odds + LOG_PRIOR_STRUCTURE > LEAST_LOG_ODDS;
    Ok(is_told.then_some(ErraticJoint { node, search: beside, found: its }))
}

/// Log posterior of a search's result at the noise that it leaves: errors that are independent in each posture absorb
/// a part of any noise, and a noise that is larger than known explains that too.
fn log_posterior_with_noise(result: (&Search<'_>, &Found), scale: &NoiseScale) -> Result<f64> {
    let noise = result.1.noise;
    Ok(log_posterior_at(result, noise)? + scale.log_density(noise, result.0.measured_noise))
}

/// The model without causes, with the mounts that are free where the data put them, and the scatter that it leaves:
/// beside mounts where the URDF has them the scatter of displaced ones hides every joint.
fn without_causes(search: &Search<'_>, nominal: &Model) -> Result<(Model, Noise)> {
    let mut bare = Model { group: vec![0.0; search.group.columns.len()], ..nominal.clone() };
    let mut scatter = search.effective(&bare)?;
    if !bare.group.is_empty() {
        for _ in 0..2 {
            bare = search.fit(&bare, scatter, SOLVER.final_steps)?.model;
            scatter = search.effective(&bare)?;
        }
    }
    Ok((bare, scatter))
}

/// A joint with fitted errors: the search with them free, and their values.
struct Free<'a> {
    node: NodeId,
    spread: f64,
    beside: Search<'a>,
    start: Model,
}

/// The candidate whose fitted errors have the highest evidence.
fn likeliest<'a>(
    search: &Search<'a>,
    nominal: &Model,
    joints: &[(NodeId, f64, f64)],
) -> Result<Option<Free<'a>>> {
    let mut tried = Vec::new();
    for &(node, spread, log_bayes) in joints.iter().take(TRIED) {
        if is_probable((node, spread, log_bayes)) {
            let free = given_its_errors(search, nominal, node, spread)?;
            tried.push((free.beside.effective(&free.start)?, free));
        }
    }
    // All at one noise: the smallest that any of them leaves.
    let Some(noise) = tried.iter().map(|t| t.0).reduce(smaller) else { return Ok(None) };
    let mut best: Option<(f64, Free<'a>)> = None;
    for (_, free) in tried {
        let fit = free.beside.fit(&free.start, noise, SOLVER.final_steps)?;
        if best.as_ref().is_none_or(|b| fit.log_evidence > b.0) {
            best = Some((fit.log_evidence, Free { start: fit.model, ..free }));
        }
    }
    Ok(best.map(|b| b.1))
}

/// A joint's errors in each posture, fitted from zero at the remaining scatter, and again with their own spread.
fn given_its_errors<'a>(search: &Search<'a>, nominal: &Model, node: NodeId, spread: f64) -> Result<Free<'a>> {
    let mut beside = search.clone();
    let own = beside.group.columns.len();
    for frames in postures(&search.problem).iter().filter(|p| p.iter().any(|&f| counts(search.mask, f))) {
        beside.group.columns.push(column(&search.problem, node, frames));
    }
    beside.group.prior_std.resize(beside.group.columns.len(), spread);
    let mut start = nominal.clone();
    start.group = vec![0.0; beside.group.columns.len()];
    for _ in 0..2 {
        let noise = beside.effective(&start)?;
        start = beside.fit(&start, noise, SOLVER.final_steps)?.model;
        let errors = &start.group[own..];
        let square = errors.iter().map(|e| e * e).sum::<f64>() / errors.len().max(1) as f64;
        let spread = square.sqrt().max(SPREADS.0);
        beside.group.prior_std[own..].fill(spread);
    }
    let spread = beside.group.prior_std.last().copied().unwrap_or(spread);
    Ok(Free { node, spread, beside, start })
}

/// Removes causes at the joint itself that leave more than half of its errors. A column that is unrelated to its
/// joint makes causes probable that reduce its influence: a coupling that cancels it, or a zero in between.
fn drop_its_own(beside: &Search<'_>, its: &mut Found, (node, first_error): (NodeId, usize)) -> Result<()> {
    let own = |model: &Model| model.group[first_error..].iter().map(|e| e * e).sum::<f64>().sqrt();
    let mut i = 0;
    while i < its.fit.model.terms.len() {
        let term = &its.fit.model.terms[i];
        if beside.catalogue.hypotheses[term.hypothesis].place.node() != Some(node) {
            i += 1;
            continue;
        }
        let rest = beside.fit(&its.fit.model.without(i), its.noise, SOLVER.final_steps)?;
        if own(&its.fit.model) < MAJORITY * own(&rest.model) {
            i += 1;
            continue;
        }
        let name = beside.catalogue.name(&beside.problem.scene, term.hypothesis);
        its.trace
            .push(format!("drop {name}: the joint's error is independent in each posture, also without it"));
        its.fit = rest;
    }
    Ok(())
}

/// Whether small errors everywhere explain most of what the independent errors of one joint would explain; true
/// independent errors would remain. Errors that are not small explain nothing here.
fn small_errors_take_it(search: &Search<'_>, nominal: &Model, noise: Noise, log_bayes: f64) -> Result<bool> {
    // Displaced mounts are no small errors of the robot, and nothing is explained without them.
    let with_setup = !search.group.columns.is_empty();
    let mut geometry = Geometry::new(&search.problem, search.catalogue, with_setup);
    let options = FitOptions { noise, steps: SOLVER.loose_steps };
    let fit = geometry.fit(&search.problem, search.catalogue, nominal, options, search.mask)?;
    if geometry.is_at_its_bound() {
        return Ok(false);
    }
    let beside = Search { group: geometry.group, ..search.clone() };
    let left = best_joint(&beside, &fit.model, noise)?.map_or(0.0, |(_, _, log_bayes)| log_bayes);
    Ok(left < MAJORITY * log_bayes)
}

/// Whether independent errors of a joint are more probable than none, to first order.
fn is_probable((_, _, log_bayes): (NodeId, f64, f64)) -> bool {
    log_bayes + LOG_PRIOR_STRUCTURE > 0.0
}

/// The joint whose independent errors explain most of the remainder: its scale and log Bayes factor.
fn best_joint(search: &Search<'_>, model: &Model, noise: Noise) -> Result<Option<(NodeId, f64, f64)>> {
    Ok(by_first_order(search, model, noise)?.into_iter().next())
}

/// All joints with the likeliest spread of each and its log Bayes factor to first order, the best first.
fn by_first_order(search: &Search<'_>, model: &Model, noise: Noise) -> Result<Vec<(NodeId, f64, f64)>> {
    let problem = &search.problem;
    let scene = &problem.scene;
    let deformation = search.deformation(model);
    let eye = problem.eye(&deformation)?;
    let joints: Vec<NodeId> = (0..scene.nodes()).filter(|&n| scene.relevant[n]).collect();
    let columns: Vec<Column> = joints.iter().map(|&n| Column::constant(Atom::Joint(n))).collect();
    let residuals = Task::of_residuals(problem, &deformation, eye.as_ref(), noise);
    let with_board = residuals.with_board || changes_sight(problem, &columns);
    let task = Task { gaussian: false, with_board, ..residuals };
    // By posture and joint: the information on the joint's error there, and its gradient.
    let of_posture = |(work, column): &mut (FrameWork, Vec<f64>), frames: &Vec<usize>| {
        let mut sums = vec![(0.0, 0.0); joints.len()];
        for &frame in frames.iter().filter(|&&f| counts(search.mask, f)) {
            if !work.evaluate(problem, &task, frame) {
                continue;
            }
            column.resize(work.row_count + PROJECTED, 0.0);
            for (sums, &n) in sums.iter_mut().zip(&joints) {
                if work.column(problem, &deformation, Atom::Joint(n), column) {
                    sums.0 += inner(column, column);
                    sums.1 += inner(column, &work.residual);
                }
            }
        }
        sums
    };
    let own_work = || (FrameWork::new(problem), Vec::new());
    let by_posture: Vec<Vec<(f64, f64)>> =
        postures(problem).par_iter().map_init(own_work, |work, frames| of_posture(work, frames)).collect();
    problem.cancel.check()?;
    let (least, factor, count) = SPREADS;
    let spreads = (0..count).map(|k| least * factor.powi(k as i32));
    let log_bayes = |joint: usize, s: f64| -> f64 {
        let of = |(h, g): (f64, f64)| {
            let told = s * s * h;
            0.5 * (s * s * g * g / (1.0 + told) - told.ln_1p())
        };
        by_posture.iter().map(|sums| of(sums[joint])).sum()
    };
    let best_of = |(joint, &n): (usize, &NodeId)| {
        let of_spreads = spreads.clone().map(|s| (n, s, log_bayes(joint, s)));
        of_spreads.max_by(|a, b| a.2.total_cmp(&b.2))
    };
    let mut all: Vec<(NodeId, f64, f64)> = joints.iter().enumerate().filter_map(best_of).collect();
    all.sort_by(|a, b| b.2.total_cmp(&a.2));
    Ok(all)
}
