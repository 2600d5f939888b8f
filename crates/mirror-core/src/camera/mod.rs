//! Pinhole camera with lens distortion: points to pixels and pixels to rays, each with its Jacobians.

mod distortion;
mod pinhole;

pub use distortion::Distortion;
pub use pinhole::{Camera, Projection, Unprojection};
