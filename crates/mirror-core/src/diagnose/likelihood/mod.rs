//! The noise, the normal equations, the fit of a model with its evidence, the score test of single hypotheses.

mod constant_columns;
pub(super) mod covariance;
pub(super) mod factor;
pub(super) mod fit;
pub(super) mod frame_factor;
pub(super) mod joint_scatter;
pub(super) mod linearised;
pub(super) mod noise;
pub(super) mod noise_correlation;
pub(super) mod noise_scale;
pub(super) mod nominal_sums;
pub(super) mod normal_equations;
pub(super) mod probability;
pub(super) mod saturated;
pub(super) mod score_sums;
pub(super) mod score_test;
mod secant;
