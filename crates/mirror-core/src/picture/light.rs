//! Light: soft shadows, and what a surface makes of the light that reaches it.

use super::scene::{Meeting, Scene};
use super::{Beam, Colour};
use nalgebra::Vector3;

/// Exponent of the highlight: that of a satin plastic.
const HIGHLIGHT_EXPONENT: i32 = 40;

/// The secondary rays of one sample of a pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Probe {
    /// Place on each lamp's disc, unit circle.
    pub on_lamp: [f64; 2],
    /// By how much this sample counts for the pane's two ghosts; most samples leave them out.
    pub ghost_weight: f64,
}

impl Probe {
    /// The place on a lamp, from two numbers in [0, 1): even over the disc.
    pub fn on_lamp(radial: f64, turn: f64) -> [f64; 2] {
        let (sine, cosine) = (turn * std::f64::consts::TAU).sin_cos();
        [cosine * radial.sqrt(), sine * radial.sqrt()]
    }
}

/// The light that a met surface sends back along the beam.
#[inline]
pub(super) fn shade(scene: &Scene, beam: &Beam, meeting: &Meeting, probe: Probe) -> Colour {
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
        // A place on the lamp's disc, which faces the scene's origin.
        let side = perpendicular(&lamp.at);
        let other = lamp.at.cross(&side) / lamp.at.norm();
        let [x, y] = probe.on_lamp;
        let to = to_center + (side * x + other * y) * lamp.radius_m;
        let distance = to.norm();
        let towards = to / distance;
        let facing = towards.dot(&normal);
        if facing <= 0.0 {
            continue;
        }
        // The start is moved off the surface, so that it does not shade itself.
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
fn beyond(scene: &Scene, beam: &Beam, probe: Probe) -> (Colour, Option<usize>) {
    match scene.first_meeting(beam) {
        Some(meeting) => (shade(scene, beam, &meeting, probe), Some(meeting.body)),
        None => (scene.lights.sky * 0.5, None),
    }
}

/// The result of a beam from the camera: the light, and the body on which its main path ends (for edges).
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    /// Light of the main path.
    pub colour: Colour,
    /// Light of the mirror's ghosts, weighted.
    pub ghosts: Colour,
    pub body: Option<usize>,
    pub in_mirror: bool,
}

/// Follows a beam from the eye, through the mirror where it meets it.
#[inline]
pub(super) fn look(scene: &Scene, beam: &Beam, probe: Probe) -> Seen {
    let mirror = scene.pane.as_ref().and_then(|pane| pane.distance_m(beam).map(|t| (pane, t)));
    let mut seen =
        Seen { colour: Colour::zeros(), ghosts: Colour::zeros(), body: None, in_mirror: mirror.is_some() };
    if let Some(meeting) = scene.first_before(beam, mirror.map(|(_, t)| t)) {
        seen.colour = shade(scene, beam, &meeting, probe);
        seen.body = Some(meeting.body);
        seen.in_mirror = false;
    } else if let Some((pane, _)) = mirror {
        if let Some(path) = pane.main_path(beam) {
            let (colour, body) = beyond(scene, &path.beam, probe);
            seen.colour = colour * path.share;
            seen.body = body;
        }
        if probe.ghost_weight > 0.0 {
            for path in pane.ghosts(beam).into_iter().flatten() {
                seen.ghosts += beyond(scene, &path.beam, probe).0 * (path.share * probe.ghost_weight);
            }
        }
    } else {
        seen.colour = scene.lights.sky * 0.5;
    }
    seen
}
