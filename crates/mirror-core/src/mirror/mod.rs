//! Mirrors: the forward optics of what a camera sees in one, and the estimators of where it stands.

mod curved;
mod glass;
mod optics;
mod sphere;

pub use curved::Curvature;
pub use glass::GlassPane;
pub use optics::{ApparentPoint, MirrorOptics, SeenPixel};
pub use sphere::{Sphere, SphereProjection};
