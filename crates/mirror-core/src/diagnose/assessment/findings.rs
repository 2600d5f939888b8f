//! Everything that was found, before it is put into words.

use crate::diagnose::criteria::cross_validation::PostureGap;
use crate::diagnose::data::diagnosis::Cause;
use crate::diagnose::likelihood::fit::Fit;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::prepare::first_day::Doubt;
use crate::diagnose::prepare::row_slip::Slip;
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::selection::alternatives::Standing;
use crate::diagnose::selection::nonparametric::Unexplained;
use crate::diagnose::selection::search::{Found, Search};
use crate::error::Result;

/// Everything that was found, before it is put into words.
pub(crate) struct Findings<'a> {
    pub search: Search<'a>,
    pub found: Found,
    pub geometry: Option<Geometry>,
    pub slip: Option<Slip>,
    pub before: Vec<PostureGap>,
    pub after: Vec<PostureGap>,
    pub unexplained: Option<Unexplained>,
    /// How sure each cause is; none for free-form errors.
    pub standings: Vec<Option<Standing>>,
    /// Share of the markers' observations that were left out as false.
    pub false_share: f64,
    /// Whole mistakes of model or log, which are undone in the search's problem.
    pub mistakes: Vec<Cause>,
    /// Mistakes that could stand for a small error.
    pub doubts: Vec<Doubt>,
}

impl Findings<'_> {
    /// What differs from the nominal model by the causes that have a name, and the small errors beside them.
    pub fn known(&self) -> Deformation {
        let mut model = self.found.fit.model.clone();
        model.terms.retain(|t| !self.search.catalogue.is_free(t.hypothesis));
        self.search.deformation(&model)
    }

    /// A fit of the findings' model, for those who need its covariance anew.
    ///
    /// # Errors
    /// Invalid parameters of the camera or mirror.
    pub fn refit(&self) -> Result<Fit> {
        self.search.fit(&self.found.fit.model, self.found.noise, 6)
    }
}
