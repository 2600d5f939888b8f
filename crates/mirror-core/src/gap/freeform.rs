//! Free-form errors: smooth functions that stand for any law that the vocabulary has not.
//!
//! At each joint the error may be any smooth function of its own position, of its load, of its direction of motion, of time,
//! or of another joint; at the camera and at each marker any small shift that varies with time or posture. They are never
//! causes: they say where the unexplained part lives and on what it depends.

use super::atoms::{Atom, Column, Weight};
use super::effects::{Effect, Place};
use super::scene::Scene;

/// What a free-form error depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum On {
    Position,
    Load,
    Direction,
    Time,
    Posture,
}

/// Smooth functions a dependence has.
const KNOTS: usize = 6;

struct FreeJoint(On);

struct FreeMarker(On);

impl On {
    fn word(self) -> &'static str {
        match self {
            Self::Position => "position",
            Self::Load => "load",
            Self::Direction => "direction",
            Self::Time => "time",
            Self::Posture => "posture",
        }
    }
}

/// Hat functions over the range of a quantity: a piecewise linear function with `KNOTS` free values.
fn hats(values: &[f64]) -> Vec<Vec<f64>> {
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let step = (high - low).max(1e-12) / (KNOTS - 1) as f64;
    (0..KNOTS)
        .map(|k| {
            let knot = low + step * k as f64;
            values.iter().map(|v| (1.0 - (v - knot).abs() / step).max(0.0)).collect()
        })
        .collect()
}

fn quantity(scene: &Scene, n: usize, on: On) -> Vec<f64> {
    (0..scene.frames)
        .map(|f| match on {
            On::Position | On::Direction => scene.q(f, n),
            On::Load => scene.torque(f, n),
            On::Time | On::Posture => scene.time_s[f],
        })
        .collect()
}

impl Effect for FreeJoint {
    fn name(&self) -> &str {
        self.0.word()
    }

    fn parameters(&self) -> Vec<String> {
        (0..KNOTS).map(|k| format!("value_{k}_rad")).collect()
    }

    fn places(&self, scene: &Scene) -> Vec<Place> {
        (0..scene.nodes())
            .filter(|&n| scene.relevant[n])
            .filter(|&n| match self.0 {
                On::Position => scene.moves(n),
                On::Direction => scene.ordered && scene.moves(n),
                On::Load => scene.largest_torque(n) > 1e-6,
                On::Time | On::Posture => true,
            })
            .map(Place::Joint)
            .collect()
    }

    fn prior_std(&self, scene: &Scene, place: Place) -> Vec<f64> {
        let prismatic = place.node().is_some_and(|n| scene.body.nodes[n].prismatic);
        vec![if prismatic { 0.03 * scene.reach_m } else { 0.03 }; KNOTS]
    }

    fn columns(&self, scene: &Scene, place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        let Some(n) = place.node() else { return Vec::new() };
        hats(&quantity(scene, n, self.0))
            .into_iter()
            .map(|mut weights| {
                if self.0 == On::Direction {
                    for (f, w) in weights.iter_mut().enumerate() {
                        *w *= scene.direction(f, n);
                    }
                }
                Column { atom: Atom::Joint(n), weight: Weight::Frames(weights) }
            })
            .collect()
    }

    fn words(&self) -> &str {
        "a smooth function"
    }
}

impl Effect for FreeMarker {
    fn name(&self) -> &str {
        self.0.word()
    }

    fn parameters(&self) -> Vec<String> {
        (0..3 * 3).map(|k| format!("value_{k}_m")).collect()
    }

    fn places(&self, scene: &Scene) -> Vec<Place> {
        (0..scene.marker_names.len()).map(Place::Marker).collect()
    }

    fn prior_std(&self, _scene: &Scene, _place: Place) -> Vec<f64> {
        vec![0.005; 9]
    }

    /// The marker hangs loose: its shift follows the direction of gravity in its mount's frame, linearly; or time.
    fn columns(&self, scene: &Scene, place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        let Place::Marker(m) = place else { return Vec::new() };
        let mut out = Vec::new();
        for k in 0..3 {
            for axis in 0..3 {
                let weights = (0..scene.frames)
                    .map(|f| match self.0 {
                        On::Posture => scene.down_in_mount(f, m)[axis],
                        _ => {
                            let span = (scene.time_s[scene.frames - 1] - scene.time_s[0]).max(1e-9);
                            let t = (scene.time_s[f] - scene.time_s[0]) / span;
                            t.powi(axis as i32)
                        }
                    })
                    .collect();
                out.push(Column { atom: Atom::MarkerShift(m, k), weight: Weight::Frames(weights) });
            }
        }
        out
    }

    fn words(&self) -> &str {
        "a smooth function"
    }
}

/// All free-form errors.
pub(crate) fn free_forms() -> Vec<Box<dyn Effect>> {
    vec![
        Box::new(FreeJoint(On::Position)),
        Box::new(FreeJoint(On::Load)),
        Box::new(FreeJoint(On::Direction)),
        Box::new(FreeJoint(On::Time)),
        Box::new(FreeMarker(On::Posture)),
        Box::new(FreeMarker(On::Time)),
    ]
}
