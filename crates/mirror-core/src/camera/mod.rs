//! Camera with lens distortion, pinhole or fisheye: points to pixels and pixels to rays, each with its Jacobians.

mod distorted;
mod distortion;
mod equidistant;
mod fixed_steps;
mod pinhole;

pub(crate) use fixed_steps::FixedSteps;

pub use distortion::Distortion;
pub use pinhole::{Camera, Projection, Unprojection};
