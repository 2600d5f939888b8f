//! Lamps and the light of the room.

use super::Colour;
use nalgebra::Vector3;

/// A round lamp.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lamp {
    /// Its centre, m.
    pub at: Vector3<f64>,
    /// Its radius, m: how soft its shadows are.
    pub radius_m: f64,
    /// Light that it throws on a surface facing it at 1 m.
    pub power: Colour,
}

/// All light of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Lights {
    /// The lamps.
    pub lamps: Vec<Lamp>,
    /// Light from above, everywhere.
    pub sky: Colour,
    /// Light from below, everywhere.
    pub ground: Colour,
}

impl Default for Lights {
    /// A bright key lamp high before the robot, a weaker one low on the other side, a pale room.
    fn default() -> Self {
        let lamp = |at, radius_m, power: f64, warmth: f64| Lamp {
            at,
            radius_m,
            power: Colour::new(power * (1.0 + warmth), power, power * (1.0 - warmth)),
        };
        Self {
            lamps: vec![
                lamp(Vector3::new(0.50, 0.38, 0.72), 0.08, 0.62, 0.01),
                lamp(Vector3::new(0.48, -0.62, 0.34), 0.10, 0.20, -0.01),
            ],
            sky: Colour::new(0.27, 0.27, 0.275),
            ground: Colour::new(0.13, 0.128, 0.125),
        }
    }
}
