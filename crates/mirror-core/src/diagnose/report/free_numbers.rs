//! The parameters of gross mistakes, as fitted together with all causes.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::data::diagnosis::Cause;
use crate::diagnose::effects::hypothesis::nuisances;
use crate::diagnose::model::elementary::Atom;

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
}
