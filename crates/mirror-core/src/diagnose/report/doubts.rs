//! What a cause could be instead, found outside of its own search: a gross mistake, the zeros of both joints of a link.

use crate::diagnose::data::diagnosis::Cause;
use crate::diagnose::prepare::first_day::Doubt;

/// Reports what could replace a cause among its alternatives, and reduces its probability by theirs.
pub(super) fn doubted(cause: &mut Cause, doubts: &[Doubt]) {
    let of_it = |d: &&Doubt| d.of.0 == cause.effect && d.of.1 == cause.at;
    let mistakes: Vec<_> = doubts.iter().filter(of_it).map(|d| d.mistake.clone()).collect();
    let left = 1.0 - mistakes.iter().map(|m| m.probability).sum::<f64>();
    cause.probability *= left.max(0.0);
    // The search may have compared the same with other priors.
    cause.alternatives.retain(|a| !mistakes.iter().any(|m| m.effect == a.effect && m.at == a.at));
    cause.alternatives.extend(mistakes);
}
