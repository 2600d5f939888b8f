//! A ray tracer that renders a robot in front of a mirror, with the truth of what it rendered.
//!
//! It exists to test detection and measurement on pictures whose truth is known. Therefore it shares no formula with
//! what it tests: it never projects a point. Every pixel is made of rays that leave the camera, pass the lens
//! ([`Eye`] inverts the published distortion polynomial by a separate fixed point), enter the mirror's glass, meet
//! its silver, leave the glass ([`Pane`]) and hit the scene. The exact pixel of a point ([`pixel_of`]) is the one
//! whose traced ray passes through it, found by searching over traced rays.
//!
//! The scene's frame is the robot's root: z up. Light is linear until [`Sensor`] turns it into 8-bit values.

mod dress;
mod eye;
mod lamps;
mod light;
mod pane;
mod render;
mod scene;
mod sensor;
mod shape;
mod truth;

pub use dress::{Dress, DressedVisual};
pub use eye::Eye;
pub use lamps::{Lamp, Lights};
pub use pane::{Pane, PaneOptions, PanePath};
pub use render::{LightField, Sampling, render};
pub use scene::{Body, Material, Paint, Scene, furnish};
pub use sensor::Sensor;
pub use shape::{Shape, Touch};
pub use truth::{BallTruth, CornerTruth, ViaTruth, ball_truth, corner_truth, pixel_of};

/// Red, green and blue, linear light, 1 is a white sheet in full light.
pub type Colour = nalgebra::Vector3<f64>;

/// A half-line of the tracer: start (m) and unit direction in the scene's frame.
///
/// A separate type, not [`crate::geometry::Ray`]: the tracer shares no code with the geometry that it tests.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Beam {
    /// Where it starts, m.
    pub from: nalgebra::Vector3<f64>,
    /// Unit direction.
    pub along: nalgebra::Vector3<f64>,
}
