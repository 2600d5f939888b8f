//! Tests of the core from outside: properties, statistics, references. Those of the diagnosis are a program of their own
//! (`diagnosis.rs`): two are compiled at once.

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
