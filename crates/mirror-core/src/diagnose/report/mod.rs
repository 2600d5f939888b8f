//! From the findings to the report and its plots.

mod another_resolution;
pub(super) mod board_shape;
pub(super) mod build;
mod doubts;
pub(super) mod fields;
mod free_numbers;
pub(super) mod gap_steps;
mod joint_signatures;
mod members;
pub(super) mod missing_rows;
pub(super) mod named_causes;
pub(super) mod noise_warnings;
pub(crate) mod optics_together;
mod places;
pub(super) mod plots;
pub(super) mod point_scale;
pub(super) mod reservations;
pub(super) mod rms_shift;
pub(super) mod rounded_positions;
pub(super) mod seen_markers;
pub(super) mod sentence;
pub(super) mod setup_causes;
pub(super) mod signature;
pub(super) mod spoilt_column;
pub(super) mod warnings;
