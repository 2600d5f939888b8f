//! Everything that was found, before the report is written.

use crate::diagnose::assessment::resampled::Resampled;
use crate::diagnose::criteria::cross_validation::PostureGap;
use crate::diagnose::data::diagnosis::Cause;
use crate::diagnose::likelihood::fit::Fit;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::prepare::first_day::{Doubt, Step};
use crate::diagnose::prepare::row_slip::Slip;
use crate::diagnose::principles::FAR_DEVIATIONS;
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::selection::nonparametric::Unexplained;
use crate::diagnose::selection::search::{Found, Search};
use crate::diagnose::selection::standing::Standing;
use crate::error::Result;

/// Everything that was found, before the report is built.
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
    /// Whole mistakes of model or log, which are undone in the search's problem.
    pub mistakes: Vec<Cause>,
    /// Mistakes that a small error could be instead.
    pub doubts: Vec<Doubt>,
    /// Probable causes that are not named, because they make the gap smaller in the picture only: their effects and places.
    pub in_picture_only: Vec<(String, String)>,
    /// A step of a joint's zero that is undone in the search's problem, and the session as it was logged.
    pub step: Option<(Step, Problem)>,
    /// The searches on resampled postures that were made last.
    pub resampled: Option<Resampled>,
}

impl Findings<'_> {
    /// The session of which the gap is reported: as it was logged.
    pub fn reported(&self) -> &Problem {
        self.step.as_ref().map_or(&self.search.problem, |(_, as_logged)| as_logged)
    }

    /// The deformation by the named causes and the small errors, without causes that are far larger than such an
    /// error usually is; and whether there are any of those.
    pub fn known(&self) -> (Deformation, bool) {
        let catalogue = self.search.catalogue;
        let mut model = self.found.fit.model.clone();
        model.terms.retain(|t| !catalogue.is_free(t.hypothesis));
        let named = model.terms.len();
        model.terms.retain(|t| catalogue.deviations(t) <= FAR_DEVIATIONS);
        (self.search.deformation(&model), model.terms.len() < named)
    }

    /// A fit of the findings' model, for callers that need its covariance.
    ///
    /// # Errors
    /// Invalid parameters of the camera or mirror.
    pub fn refit(&self) -> Result<Fit> {
        self.search.fit(&self.found.fit.model, self.found.noise, 6)
    }
}
