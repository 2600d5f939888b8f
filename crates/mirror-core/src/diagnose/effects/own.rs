//! Effects that a user defines: tables of weights, one number for each frame and parameter, at the places where they
//! are suspected.
//!
//! `change of the place in frame f = Σ_p parameter_p · weight[p][f]`, along the parameter's axis. Such an effect is
//! a hypothesis like those of the vocabulary: it is screened, fitted, compared with all others, and dropped if it
//! does not help.

use crate::diagnose::data::recording::Recording;
use crate::diagnose::effects::{Effect, Place, vocabulary};
use crate::diagnose::model::elementary::{Atom, Column, Weight};
use crate::diagnose::model::problem::Problem;
use crate::diagnose::model::scene::Scene;
use crate::error::{Error, Result, finite, positive};
use crate::robot::Robot;

/// A parameter of an own effect.
#[derive(Debug, Clone, PartialEq)]
pub struct OwnParameter {
    /// Its name, with its unit as suffix.
    pub name: String,
    /// Standard deviation of its prior: the size that it commonly has.
    pub prior_std: f64,
    /// The axis along (or about) which it acts; none at a joint, whose position it changes.
    pub axis: Option<OwnAxis>,
}

/// An axis of the frame of a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OwnAxis {
    /// Shift along x, y or z (0 to 2), m.
    Along(usize),
    /// Turn about x, y or z (0 to 2), rad.
    About(usize),
}

/// An own effect at one place.
#[derive(Debug, Clone, PartialEq)]
pub struct OwnPlace {
    /// `joint:J`, `marker:M`, `link:L` or `camera`.
    pub at: String,
    /// A weight for each frame, one list for each parameter.
    pub weights: Vec<Vec<f64>>,
}

/// An effect that a user brings.
#[derive(Debug, Clone, PartialEq)]
pub struct OwnEffect {
    /// Its name.
    pub name: String,
    /// What happens, in a sentence.
    pub words: String,
    /// Its parameters.
    pub parameters: Vec<OwnParameter>,
    /// The places where it may occur, with its weights there.
    pub places: Vec<OwnPlace>,
}

/// The quantities on which an effect may depend, as the diagnosis itself reads them.
///
/// Tables are `[frame][joint]`, `[frame][link]` (of the joint that moves it) or `[frame][marker]`.
#[derive(Debug, Clone, PartialEq)]
pub struct Quantities {
    /// Movable joints, in the order of the columns.
    pub joint_names: Vec<String>,
    /// The link that each joint moves.
    pub link_names: Vec<String>,
    /// Whether the joint moves the observed markers relative to the observer; others cannot be diagnosed.
    pub seen: Vec<bool>,
    /// Markers, in the order of their columns.
    pub marker_names: Vec<String>,
    /// Commanded positions, rad or m.
    pub position: Vec<Vec<f64>>,
    /// Sign of the last commanded change; 0 before the first, and where the rows are not in order.
    pub direction: Vec<Vec<f64>>,
    /// Gravity's torque on the joint at the nominal posture, N m: positive pushes the position upward.
    pub torque_nm: Vec<Vec<f64>>,
    /// Gravity's moment on the link about its middle, in its frame, N m.
    pub moment_nm: Vec<Vec<[f64; 3]>>,
    /// Direction of gravity in the frame of each marker's mount.
    pub down: Vec<Vec<[f64; 3]>>,
    /// Time since the first frame, s.
    pub time_s: Vec<f64>,
}

/// Tabulates the quantities of a recording.
///
/// # Errors
/// As [`crate::diagnose::diagnose`].
pub fn quantities(robot: &Robot, recording: &Recording) -> Result<Quantities> {
    let problem = Problem::new(robot, recording)?;
    let scene = &problem.scene;
    let (nodes, markers) = (scene.nodes(), scene.marker_names.len());
    let table = |of: &dyn Fn(usize, usize) -> f64| -> Vec<Vec<f64>> {
        (0..scene.frames).map(|f| (0..nodes).map(|n| of(f, n)).collect()).collect()
    };
    Ok(Quantities {
        joint_names: scene.body.nodes.iter().map(|n| n.joint.clone()).collect(),
        link_names: scene.body.nodes.iter().map(|n| n.link.clone()).collect(),
        seen: scene.relevant.clone(),
        marker_names: scene.marker_names.clone(),
        position: table(&|f, n| scene.q(f, n)),
        direction: table(&|f, n| scene.direction(f, n)),
        torque_nm: table(&|f, n| scene.torque(f, n)),
        moment_nm: (0..scene.frames)
            .map(|f| (0..nodes).map(|n| (*scene.moment(f, n)).into()).collect())
            .collect(),
        down: (0..scene.frames)
            .map(|f| (0..markers).map(|m| (*scene.down_in_mount(f, m)).into()).collect())
            .collect(),
        time_s: scene.time_s.iter().map(|t| t - scene.time_s[0]).collect(),
    })
}

/// An own effect, checked against a scene.
struct Tabulated {
    name: String,
    words: String,
    parameters: Vec<OwnParameter>,
    places: Vec<(Place, Vec<Column>)>,
}

impl Effect for Tabulated {
    fn name(&self) -> &str {
        &self.name
    }

    fn parameters(&self) -> Vec<String> {
        self.parameters.iter().map(|p| p.name.clone()).collect()
    }

    fn places(&self, _scene: &Scene) -> Vec<Place> {
        self.places.iter().map(|(place, _)| *place).collect()
    }

    fn prior_std(&self, _scene: &Scene, _place: Place) -> Vec<f64> {
        self.parameters.iter().map(|p| p.prior_std).collect()
    }

    fn columns(&self, _scene: &Scene, place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        self.places.iter().find(|(p, _)| *p == place).map_or_else(Vec::new, |(_, columns)| columns.clone())
    }

    fn is_tabulated(&self) -> bool {
        true
    }

    fn words(&self) -> &str {
        &self.words
    }
}

/// A user's effects as hypotheses of a scene.
///
/// # Errors
/// A name of the vocabulary or a duplicate name; a place that does not exist; weights of another length, not
/// finite, or zero throughout; an axis that is missing or does not fit the place; a prior that is not above 0.
pub(crate) fn own_effects(own: &[OwnEffect], scene: &Scene) -> Result<Vec<Box<dyn Effect>>> {
    let mut taken: Vec<String> = vocabulary().iter().map(|e| e.name().to_owned()).collect();
    taken.extend(["geometry".to_owned(), "pairing".to_owned(), "none".to_owned()]);
    let mut out: Vec<Box<dyn Effect>> = Vec::new();
    for effect in own {
        if effect.name.is_empty() || taken.contains(&effect.name) {
            return Err(Error::NameTaken { what: "own effect", got: effect.name.clone() });
        }
        taken.push(effect.name.clone());
        out.push(Box::new(tabulated(effect, scene)?));
    }
    Ok(out)
}

fn tabulated(effect: &OwnEffect, scene: &Scene) -> Result<Tabulated> {
    let of = |what: &str| format!("own effect {}: {what}", effect.name);
    for (what, got) in [("parameters", effect.parameters.len()), ("places", effect.places.len())] {
        if got == 0 {
            return Err(Error::TooFew { what: of(what), got, needed: 1 });
        }
    }
    for parameter in &effect.parameters {
        positive(&of(&format!("prior_std of {}", parameter.name)), parameter.prior_std)?;
    }
    let mut places: Vec<(Place, Vec<Column>)> = Vec::new();
    for entry in &effect.places {
        let place = place_named(&entry.at, scene)?;
        if places.iter().any(|(p, _)| *p == place) {
            return Err(Error::NameTaken { what: "place of an own effect", got: entry.at.clone() });
        }
        let at = |what: &str| of(&format!("{what} at {}", entry.at));
        if entry.weights.len() != effect.parameters.len() {
            return Err(Error::LengthMismatch {
                what: at("columns of weights, one a parameter,"),
                got: entry.weights.len(),
                needed: effect.parameters.len(),
            });
        }
        let mut columns = Vec::new();
        for (parameter, weights) in effect.parameters.iter().zip(&entry.weights) {
            if weights.len() != scene.frames {
                return Err(Error::LengthMismatch {
                    what: at("weights, one a frame,"),
                    got: weights.len(),
                    needed: scene.frames,
                });
            }
            let mut largest = 0.0_f64;
            for weight in weights {
                largest = largest.max(finite(&at("weight"), *weight)?.abs());
            }
            if largest < f64::EPSILON {
                return Err(Error::OutOfRange {
                    what: at(&format!("largest weight of {}", parameter.name)),
                    got: largest,
                    needed: "a basis that is not 0 in every frame; leave the place out where it cannot act"
                        .into(),
                });
            }
            let atom = atom(place, parameter.axis).ok_or_else(|| Error::UnknownName {
                what: "axis of a parameter of an own effect",
                got: format!("{} at {}", axis_name(parameter.axis), entry.at),
                valid: "none at a joint; x, y, z (shift) at a marker; rx, ry, rz (turn) at a link; all six at the camera"
                    .into(),
            })?;
            columns.push(Column { atom, weight: Weight::Frames(weights.clone()) });
        }
        places.push((place, columns));
    }
    Ok(Tabulated {
        name: effect.name.clone(),
        words: effect.words.clone(),
        parameters: effect.parameters.clone(),
        places,
    })
}

fn axis_name(axis: Option<OwnAxis>) -> String {
    match axis {
        None => "no axis".into(),
        Some(OwnAxis::Along(k)) => ["x", "y", "z"].get(k).copied().unwrap_or("?").into(),
        Some(OwnAxis::About(k)) => ["rx", "ry", "rz"].get(k).copied().unwrap_or("?").into(),
    }
}

fn atom(place: Place, axis: Option<OwnAxis>) -> Option<Atom> {
    match (place, axis) {
        (Place::Joint(n), None) => Some(Atom::Joint(n)),
        (Place::Marker(m), Some(OwnAxis::Along(k @ 0..=2))) => Some(Atom::MarkerShift(m, k)),
        (Place::Link(Some(n)), Some(OwnAxis::About(k @ 0..=2))) => Some(Atom::Turn(n, k)),
        (Place::Camera, Some(OwnAxis::About(k @ 0..=2))) => Some(Atom::CameraMount(k)),
        (Place::Camera, Some(OwnAxis::Along(k @ 0..=2))) => Some(Atom::CameraMount(3 + k)),
        _ => None,
    }
}

/// The place of a name, where these observations can show it.
fn place_named(at: &str, scene: &Scene) -> Result<Place> {
    let mut valid: Vec<Place> = Vec::new();
    for n in (0..scene.nodes()).filter(|&n| scene.is_seen(n)) {
        valid.extend([Place::Joint(n), Place::Link(Some(n))]);
    }
    valid.extend((0..scene.marker_names.len()).map(Place::Marker));
    if scene.has_camera {
        valid.push(Place::Camera);
    }
    valid.iter().copied().find(|p| p.name(scene) == at).ok_or_else(|| Error::UnknownName {
        what: "place of an own effect",
        got: at.to_owned(),
        valid: valid.iter().map(|p| p.name(scene)).collect::<Vec<_>>().join(", "),
    })
}
