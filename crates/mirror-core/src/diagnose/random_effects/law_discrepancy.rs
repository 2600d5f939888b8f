//! Discrepancy terms of the causes' laws: no real spring is linear, and no real play is the same under every load.
//!
//! The difference between a real law and its textbook law looks like small further causes that move the same
//! markers. So wherever a further cause is tested, the laws of the present causes may err smoothly, in load,
//! direction or time, by a share of what they move: one column for each knot, with that share as its prior scale.
//! What these columns can imitate is no evidence for a further cause; what they cannot imitate (the board's corners
//! by a joint's law, for example) counts fully.

use crate::diagnose::effects::LawFreedom;
use crate::diagnose::effects::hypothesis::{Catalogue, Model, Term};
use crate::diagnose::likelihood::fit::Group;
use crate::diagnose::model::elementary::Column;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::random_effects::law_columns::{LAW_SHARE, law_columns};
use core::ops::Range;

/// A group with the discrepancy terms of a model's causes behind its own columns, but that of the cause that is `in_question`.
pub(crate) fn with_slack(
    problem: &Problem,
    catalogue: &Catalogue,
    group: &Group,
    model: &Model,
    in_question: Option<usize>,
) -> Group {
    let mut out = group.clone();
    if model.group.is_empty() {
        // A group that is not in the model has no values for its columns.
        out = Group::default();
    }
    let others = model.terms.iter().enumerate().filter(|(i, _)| in_question != Some(*i));
    for (columns, std) in others.filter_map(|(_, term)| discrepancy(problem, catalogue, term)) {
        out.prior_std.extend(core::iter::repeat_n(std, columns.len()));
        out.columns.extend(columns);
    }
    out
}

/// Where each cause's discrepancy terms are among the parameters of a model whose group begins at `first_group`.
pub(crate) fn slack_of_each(
    problem: &Problem,
    catalogue: &Catalogue,
    model: &Model,
    first_group: usize,
) -> Vec<Range<usize>> {
    let mut at = first_group + model.group.len();
    let own = |term| {
        let first = at;
        at += discrepancy(problem, catalogue, term).map_or(0, |(columns, _)| columns.len());
        first..at
    };
    model.terms.iter().map(own).collect()
}

/// The discrepancy terms of a cause's law, and their prior scale; none where its law is exact or moves nothing.
fn discrepancy(problem: &Problem, catalogue: &Catalogue, term: &Term) -> Option<(Vec<Column>, f64)> {
    let effect = catalogue.effect(term.hypothesis);
    let freedom = effect.law_freedom();
    let place = catalogue.hypotheses[term.hypothesis].place;
    let node = place.node().filter(|_| freedom != LawFreedom::Exact)?;
    let mut alone = problem.nominal();
    effect.deform(&problem.scene, place, term.variant, &term.parameters, &mut alone);
    let largest = (0..problem.scene.frames)
        .map(|f| alone.joint_delta(f, node).abs() + alone.bend(f, node).map_or(0.0, |b| b.norm()))
        .fold(0.0, f64::max);
    (largest > 0.0).then(|| (law_columns(&problem.scene, place, freedom), LAW_SHARE * largest))
}
