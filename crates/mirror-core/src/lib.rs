//! A robot looks at itself in a flat mirror: geometry, measurement, correction and diagnosis of its posture.
//!
//! The mathematics of the `mirror-posture` product, without Python and without OpenCV. Each module uses only modules
//! above it:
//!
//! | module | what it is |
//! | --- | --- |
//! | [`geometry`] | planes, reflections, rays, rotations |
//! | [`camera`] | pinhole camera with lens distortion: project and unproject, with Jacobians |
//! | [`mirror`] | the board and its pose, the mirror estimators (Eq. 1, Eq. 2, maximum likelihood), the virtual camera |
//! | [`triangulate`] | virtual rays to points, with covariance |
//! | [`joint`] | all views of a session at once (bundle adjustment): mirrors, camera–board transform, markers |
//! | [`calibrate`] | the camera–board transform from mirror views alone, or with a second camera |
//! | `picture` | (feature `picture`) ray tracer: pictures of a robot in front of a mirror, with their truth |
//! | [`measure`] | a session by one mirror estimator: mirrors, then markers |
//! | [`view_check`] | whether pictures are what they claim to be, and which usual mistake was made |
//! | [`outline`] | coloured balls in pictures: their outline and centre, with covariance |
//! | [`robot`] | URDF to a validated tree; kinematics, Jacobians, gravity torques |
//! | [`joint_log`] | a log of joints beside pictures: moments of rest, the offset between both clocks |
//! | [`correct`] | the correction loop: damped steps from marker errors to commands, and its stop reasons |
//! | [`diagnose`] | the diagnosis: forward model, effects, screening, search, evidence, verdict |
//!
//! `README.md` has a table that says where each formula is, and names four runnable examples.
//!
//! Conventions (tested, and described in full in `docs/conventions.md`): `a_from_b` maps coordinates in frame b to
//! coordinates in frame a; `point_in_a`; SI units; a camera's optical frame has z forward, x right, y down; pixel
//! (0, 0) is the centre of the top-left pixel; tangents put rotation before translation.

// Tests inside and outside share one maker of recordings, which calls the crate by its name.
#[cfg(test)]
extern crate self as mirror_core;

pub mod calibrate;
pub mod camera;
mod cancel;
pub mod correct;
pub mod diagnose;
mod error;
pub mod geometry;
pub mod joint;
pub mod joint_log;
mod least_squares;
pub mod measure;
pub mod mirror;
pub mod outline;
#[cfg(feature = "picture")]
pub mod picture;
mod random;
pub mod robot;
mod statistics;
pub mod triangulate;
pub mod view_check;

pub use cancel::Cancel;
pub use error::{Error, Result};
