//! Members of the group of small errors that are too large for it: single causes that only hide among the others.

use crate::diagnose::effects::hypothesis::{Catalogue, Model, Term};
use crate::diagnose::random_effects::geometric_tolerances::{Geometry, KINDS, kind, single_effect};
use std::collections::BTreeMap;

/// One error with this share of the squares of all of its kind is no member of a group: of tens that are spread alike the largest
/// has a tenth or a third.
const OUTLYING_SHARE: f64 = 0.6;

/// Of fewer errors than this one is easily the largest by far.
const FEWEST: usize = 5;

/// Takes the one error that outweighs all others of its kind (lengths, angles) out of the group's values and names it as a cause
/// of its own; false where there is none.
pub(crate) fn name_outlying(geometry: &Geometry, catalogue: &Catalogue, model: &mut Model) -> bool {
    let mut totals = [0.0; KINDS];
    let mut errors: BTreeMap<usize, (usize, Vec<usize>)> = BTreeMap::new();
    for (k, column) in geometry.group.columns.iter().enumerate() {
        let its_kind = kind(column.atom);
        totals[its_kind] += model.group[k].powi(2);
        let Some((effect, place, _)) = single_effect(column.atom) else { continue };
        if let Some(h) = catalogue.find(effect, place) {
            errors.entry(h).or_insert((its_kind, Vec::new())).1.push(k);
        }
    }
    let square = |columns: &[usize]| columns.iter().map(|&k| model.group[k].powi(2)).sum::<f64>();
    let outlying = errors.iter().find(|(h, (its_kind, columns))| {
        let known = model.terms.iter().any(|t| t.hypothesis == **h);
        let others = errors.values().filter(|(kind, _)| kind == its_kind).count();
        !known && others >= FEWEST && square(columns) > OUTLYING_SHARE * totals[*its_kind].max(1e-30)
    });
    let Some((&hypothesis, (_, columns))) = outlying else { return false };
    // Several joints of one link may each have a shift of their own there: no single cause is all of these.
    if columns.len() != catalogue.hypotheses[hypothesis].prior_std.len() {
        return false;
    }
    let parameters = columns.iter().map(|&k| core::mem::take(&mut model.group[k])).collect();
    model.terms.push(Term { hypothesis, variant: 0.0, parameters, prior_scale: 1.0 });
    true
}
