//! Planes, reflections, rays and rotations: exact geometry that knows nothing of cameras or robots.

pub mod directions;
mod improper;
mod plane;
mod ray;
mod reflection;
pub mod rotation;

pub use improper::ImproperIsometry;
pub use plane::Plane;
pub use ray::{Ray, RayHit};
pub use reflection::Reflection;
