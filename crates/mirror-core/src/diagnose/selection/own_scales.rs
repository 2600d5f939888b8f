//! A model beside small errors everywhere whose scales are estimated anew with it: with other causes they are others.

use crate::diagnose::effects::hypothesis::Model;
use crate::diagnose::likelihood::fit::{Fit, FitOptions};
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::selection::search::Search;
use crate::error::Result;

/// A fitted model with its own scales, and the search beside these.
pub(crate) struct AtOwnScales<'a> {
    pub search: Search<'a>,
    pub geometry: Geometry,
    pub fit: Fit,
}

impl<'a> AtOwnScales<'a> {
    /// Fits a model; its scales start from those of the group.
    ///
    /// # Errors
    /// Invalid parameters of the camera or mirror.
    pub fn fitted(
        search: &Search<'a>,
        geometry: &Geometry,
        start: &Model,
        options: FitOptions,
    ) -> Result<Self> {
        let mut geometry = geometry.clone();
        let fit = geometry.fit(&search.problem, search.catalogue, start, options, search.mask)?;
        let search = Search { group: geometry.group.clone(), ..search.clone() };
        Ok(Self { search, geometry, fit })
    }

    /// Log of its evidence times prior.
    pub fn log_posterior(&self) -> f64 {
        self.search.log_posterior(&self.fit)
    }
}
