//! Criteria for a model: its prediction of held-out regions, and its residuals against the noise.

pub(super) mod cross_validation;
pub(super) mod fit_without_each;
pub(super) mod lack_of_fit;
pub(super) mod marker_shift;
pub(super) mod regions;
