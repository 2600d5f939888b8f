//! Planes, reflections, rays and rotations: exact geometry, independent of cameras and robots.

pub mod directions;
mod improper;
mod plane;
mod ray;
mod reflection;
pub mod rotation;

pub use improper::ImproperIsometry;
pub use plane::Plane;
pub(crate) use plane::SHORTEST_DIRECTION;
pub use ray::{Ray, RayHit};
pub use reflection::Reflection;
