//! How good a model is: on regions that were held out, and against the noise.

pub(super) mod cross_validation;
pub(super) mod lack_of_fit;
pub(super) mod marker_shift;
pub(super) mod regions;
