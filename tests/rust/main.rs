//! Tests of the core from outside: properties, statistics, references.

// A test may panic: that is how it fails.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod architecture;
mod calibrate;
mod camera;
mod correct;
mod correct_loop;
mod correct_stops;
mod examples;
mod feed_forward;
mod fuzz_corpus;
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
mod gap_sessions;
mod gap_setup;
mod gap_several_mistakes;
mod gap_spoilt_log;
mod gap_warming;
mod gap_world;
mod glass;
mod joint;
mod joint_log;
mod measure;
mod mirror;
mod montecarlo;
mod outline;
mod outline_blurred;
mod outline_curve;
mod picture;
mod planar;
mod reflection;
mod robot_gravity;
mod robot_kinematics;
mod robot_upright;
mod robot_urdf;
mod sphere;
mod traced;
mod triangulate;
mod where_it_stands;
