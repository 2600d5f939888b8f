//! The parameters of gross mistakes, as fitted together with all causes.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::data::diagnosis::{Cause, Estimate};
use crate::diagnose::effects::hypothesis::nuisances;
use crate::diagnose::model::elementary::Atom;
use crate::diagnose::prepare::first_day::unit_near;
use crate::diagnose::principles::FAR_DEVIATIONS;

/// The parameters of a mistake (a marker's place on its true link; a zero, a ratio, a delay): the first estimate,
/// corrected by the fit with all causes; by inverse variances where several parameters determine one.
pub(super) fn with_free_numbers(cause: &mut Cause, findings: &Findings<'_>) {
    let (problem, fit) = (&findings.search.problem, &findings.found.fit);
    let columns = nuisances(problem);
    let value = |i: usize| (fit.model.nuisances[i], fit.covariance[(i, i)].max(f64::MIN_POSITIVE).sqrt());
    let own = |name: &String| cause.at.starts_with(&format!("marker:{name}<-"));
    let marker = problem.scene.marker_names.iter().position(own).filter(|_| cause.effect == "marker_parent");
    let places = columns.iter().enumerate().filter_map(|(i, (column, _))| match column.atom {
        Atom::MarkerShift(m, k) if Some(m) == marker => Some((["dx_m", "dy_m", "dz_m"][k], 1.0, i)),
        _ => None,
    });
    let first = columns.len() - problem.mistake_parameters.len();
    let numbers = problem
        .mistake_parameters
        .iter()
        .enumerate()
        .filter(|(_, l)| l.effect == cause.effect && l.at == cause.at);
    let all: Vec<(&str, f64, usize)> =
        places.chain(numbers.map(|(k, l)| (l.parameter.as_str(), l.unit, first + k))).collect();
    for (name, told) in &mut cause.parameters {
        let (mut weights, mut sum) = (0.0, 0.0);
        for &(_, unit, i) in all.iter().filter(|(parameter, ..)| parameter == name) {
            let (more, std) = value(i);
            let weight = (unit * std).powi(-2);
            weights += weight;
            sum += weight * unit * more;
        }
        if weights > 0.0 {
            told.value += sum / weights;
            told.std = weights.sqrt().recip();
        }
    }
    in_its_unit(cause);
}

/// A ratio that is another unit's, told as such: beside mounts by hand the first estimate is not exact enough to show it.
fn in_its_unit(cause: &mut Cause) {
    let scale = cause.parameters.get("scale_error").copied().filter(|_| cause.effect == "gear_ratio");
    let Some(scale) = scale else { return };
    let Some(factor) = unit_near(1.0 + scale.value, FAR_DEVIATIONS * scale.std) else { return };
    cause.effect = "joint_unit".into();
    cause.kind = "data".into();
    cause.parameters = [("factor".to_owned(), Estimate { value: factor, std: 0.0 })].into_iter().collect();
    cause.words = "the column is in another unit".into();
}
