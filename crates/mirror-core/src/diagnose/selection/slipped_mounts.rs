//! A displaced mount of what slipped. The motions of slips are free in every model, so without the mount in the model they
//! take its part in all rows behind the slip, and the rows before it look false: a mount that starts at none then gains
//! nothing. It starts at the part that the motions took, and they where they were found.

use crate::diagnose::effects::hypothesis::Model;
use crate::diagnose::model::elementary::Weight;
use crate::diagnose::selection::search::Search;

impl Search<'_> {
    /// A model whose last cause has what the slips of the same place moved by since they were found; none where nothing
    /// slipped there.
    pub(super) fn with_what_its_slips_took(&self, model: &Model) -> Option<Model> {
        let problem = &self.problem;
        let columns = self.catalogue.columns(&problem.scene, model.terms.last()?);
        let mut next = Model { planes: None, ..model.clone() };
        let own = next.terms.last_mut()?;
        own.parameters.fill(0.0);
        let mut any = false;
        let first = next.nuisances.len() - problem.mistake_parameters.len();
        let of_mistakes = problem.mistake_parameters.iter().zip(&mut next.nuisances[first..]);
        for (slip, value) in of_mistakes.filter(|(mistake, _)| mistake.effect == "slip") {
            let at =
                columns.iter().position(|c| c.atom == slip.column.atom && matches!(c.weight, Weight::One));
            let Some(parameter) = at.and_then(|k| own.parameters.get_mut(k)) else { continue };
            // Behind the last of several slips each of them counts.
            *parameter += core::mem::take(value);
            any = true;
        }
        any.then_some(next)
    }
}
