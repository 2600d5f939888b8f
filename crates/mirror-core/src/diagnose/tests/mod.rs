//! Tests of what the diagnosis keeps to itself.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod adequacy;
pub(super) mod column_world;
mod false_together;
mod far_larger;
#[path = "../../../../../tests/rust/gap_world/mod.rs"]
#[allow(dead_code)]
pub(super) mod gap_world;
mod jacobians;
mod joint_scatter;
mod linear_models;
mod many_columns;
mod missing_rows;
mod near_ties;
mod noise;
mod nominal_sums;
mod places;
mod planning;
mod principles;
mod prior;
mod rows;
mod score_sums;
mod shortcuts;
mod springs;
mod statistics;
mod thresholds;
mod transmission;
mod work_limit;
mod zeros;
