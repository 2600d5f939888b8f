//! Tests of the diagnosis from outside: sessions of a simulated robot with known causes.

// A test may panic: that is how it fails.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod gap_beside_causes;
mod gap_claims;
mod gap_effects;
mod gap_first_day;
mod gap_geared_joints;
mod gap_gravity;
mod gap_heavy_links;
mod gap_long;
mod gap_mounts;
mod gap_moving_base;
mod gap_no_name;
mod gap_other_session;
mod gap_panels;
mod gap_permuted_names;
mod gap_pushed_marker;
mod gap_resting_joints;
mod gap_sessions;
mod gap_setup;
mod gap_several_mistakes;
mod gap_spoilt_log;
mod gap_warming;
mod gap_world;
