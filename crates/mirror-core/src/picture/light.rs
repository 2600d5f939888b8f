//! Light: lamps with soft shadows, the light of the room, and what a surface makes of it.

use super::scene::{Meeting, Scene};
use super::{Beam, Colour};
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

/// Exponent of the highlight: that of a satin plastic.
const HIGHLIGHT_EXPONENT: i32 = 40;

/// Where on each lamp a sample looks: two numbers in [0, 1).
#[derive(Debug, Clone, Copy)]
pub(super) struct LampPlace {
    pub radial: f64,
    pub turn: f64,
}

/// The light that a met surface sends back along the beam.
#[inline]
pub(super) fn shade(scene: &Scene, beam: &Beam, meeting: &Meeting, place: LampPlace) -> Colour {
    let at = beam.from + beam.along * meeting.distance_m;
    let normal = meeting.normal;
    let colour = scene.colour_at(meeting.body, &at);
    let gloss = scene.bodies[meeting.body].material.gloss;
    let upward = 0.5 + 0.5 * normal.z;
    let mut diffuse = scene.lights.ground * (1.0 - upward) + scene.lights.sky * upward;
    let mut highlight = Colour::zeros();
    for lamp in &scene.lights.lamps {
        let to_center = lamp.at - at;
        if to_center.dot(&normal) <= 0.0 {
            continue;
        }
        // A place on the lamp's disc as seen from here.
        let (sine, cosine) = (place.turn * std::f64::consts::TAU).sin_cos();
        let side = perpendicular(&to_center);
        let other = to_center.cross(&side).normalize();
        let to = to_center + (side * cosine + other * sine) * (lamp.radius_m * place.radial.sqrt());
        let distance = to.norm();
        let towards = to / distance;
        let facing = towards.dot(&normal);
        if facing <= 0.0 {
            continue;
        }
        // Lift the start off the surface, so that it does not shade itself.
        if scene.is_blocked(&Beam { from: at + normal * 1e-6, along: towards }, distance) {
            continue;
        }
        let arriving = lamp.power / (distance * distance);
        diffuse += arriving * facing;
        if gloss > 0.0 {
            let half = (towards - beam.along).normalize();
            highlight += arriving * (gloss * half.dot(&normal).max(0.0).powi(HIGHLIGHT_EXPONENT));
        }
    }
    colour.component_mul(&diffuse) + highlight
}

/// A unit vector across another.
#[inline]
fn perpendicular(v: &Vector3<f64>) -> Vector3<f64> {
    let axis = if v.x.abs() < v.y.abs().min(v.z.abs()) { Vector3::x() } else { Vector3::z() };
    let across = v.cross(&axis);
    let length = across.norm();
    if length > 0.0 { across / length } else { Vector3::x() }
}

/// The light that arrives along a beam after it has left the mirror.
#[inline]
fn beyond(scene: &Scene, beam: &Beam, place: LampPlace) -> (Colour, Option<usize>) {
    match scene.first_meeting(beam) {
        Some(meeting) => (shade(scene, beam, &meeting, place), Some(meeting.body)),
        None => (scene.lights.sky * 0.5, None),
    }
}

/// What a beam from the eye sees: the light, and which body its main path ends on (tells edges).
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    pub colour: Colour,
    pub body: Option<usize>,
    pub in_mirror: bool,
}

/// Follows a beam from the eye, through the mirror where it meets it.
#[inline]
pub(super) fn look(scene: &Scene, beam: &Beam, place: LampPlace) -> Seen {
    let direct = scene.first_meeting(beam);
    let mirror = scene.pane.as_ref().and_then(|pane| pane.distance_m(beam).map(|t| (pane, t)));
    match (direct, mirror) {
        (direct, Some((pane, t))) if direct.is_none_or(|m| m.distance_m > t) => {
            let mut seen = Seen { colour: Colour::zeros(), body: None, in_mirror: true };
            if let Some(path) = pane.main_path(beam) {
                let (colour, body) = beyond(scene, &path.beam, place);
                seen.colour += colour * path.share;
                seen.body = body;
            }
            for path in pane.ghosts(beam).into_iter().flatten() {
                seen.colour += beyond(scene, &path.beam, place).0 * path.share;
            }
            seen
        }
        (Some(meeting), _) => {
            Seen { colour: shade(scene, beam, &meeting, place), body: Some(meeting.body), in_mirror: false }
        }
        (None, _) => Seen { colour: scene.lights.sky * 0.5, body: None, in_mirror: false },
    }
}
