//! The plots of a cause, or of an unexplained part, that is not a joint's position: tracks over the postures for
//! markers, links, axes and the camera; fields over image and board for lens, board and mirror.
//!
//! A point of a track is the value that one component alone would need in that posture: the fitted value plus the
//! contribution of the posture's own residual, `δ_k = fitted_k + ⟨x_k, r⟩ / ⟨x_k, x_k⟩`, with everything else as in
//! the model (a partial residual plot).

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::data::depends_on::DependsOn;
use crate::diagnose::data::diagnosis::{Cause, Field, Track, TrackAxis, TrackPoint};
use crate::diagnose::effects::Place;
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::elementary::{Atom, Weight};
use crate::diagnose::model::scene::Scene;
use crate::diagnose::model::solver::NEGLIGIBLE;
use crate::diagnose::principles::Size;
use crate::diagnose::report::fields::{Over, field};
use crate::diagnose::report::signature::free_errors_of;
use crate::error::Result;

/// Joints between camera and board against which a camera's errors are drawn.
const MOST_JOINTS: Size = 2;

/// The signatures of the places that are not joints.
#[derive(Debug, Clone, Default)]
pub(crate) struct Panels {
    pub tracks: Vec<Track>,
    pub fields: Vec<Field>,
}

/// What an error's components are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    Marker(usize),
    LinkShift(Option<NodeId>),
    LinkTurn(NodeId),
    JointRock(NodeId),
    Tilt(NodeId),
    CameraTurn,
    CameraShift,
    Focal,
}

/// The variable against which a track is plotted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Quantity {
    Time,
    Position(NodeId),
    Torque(NodeId),
    Moment(NodeId, usize),
    Down(usize, usize),
}

const AXES: [&str; 3] = ["x", "y", "z"];

impl Part {
    fn of(atom: Atom) -> Option<Self> {
        Some(match atom {
            Atom::MarkerShift(m, _) => Self::Marker(m),
            Atom::LinkShift(n, _) => Self::LinkShift(n),
            Atom::Bend(n) | Atom::Beam(n) | Atom::Turn(n, _) | Atom::Across(n, _) => Self::LinkTurn(n),
            Atom::Rock(n, _) => Self::JointRock(n),
            Atom::Tilt(n, _) => Self::Tilt(n),
            Atom::CameraMount(k) if k < 3 => Self::CameraTurn,
            Atom::CameraMount(_) => Self::CameraShift,
            Atom::Focal => Self::Focal,
            _ => return None,
        })
    }

    fn atoms(self) -> Vec<Atom> {
        match self {
            Self::Marker(m) => (0..3).map(|k| Atom::MarkerShift(m, k)).collect(),
            Self::LinkShift(n) => (0..3).map(|k| Atom::LinkShift(n, k)).collect(),
            Self::LinkTurn(n) => (0..3).map(|k| Atom::Turn(n, k)).collect(),
            Self::JointRock(n) => (0..2).map(|k| Atom::Rock(n, k)).collect(),
            Self::Tilt(n) => (0..2).map(|k| Atom::Tilt(n, k)).collect(),
            Self::CameraTurn => (0..3).map(Atom::CameraMount).collect(),
            Self::CameraShift => (3..6).map(Atom::CameraMount).collect(),
            Self::Focal => vec![Atom::Focal],
        }
    }

    /// What it is, and its unit.
    fn words(self) -> (&'static str, &'static str) {
        match self {
            Self::Marker(_) | Self::LinkShift(_) | Self::CameraShift => ("shift", "m"),
            Self::LinkTurn(_) | Self::JointRock(_) | Self::CameraTurn => ("turn", "rad"),
            Self::Tilt(_) => ("tilt", "rad"),
            Self::Focal => ("focal", "1"),
        }
    }

    fn components(self) -> Vec<String> {
        match self {
            Self::Focal => vec!["focal length".into()],
            Self::Tilt(_) | Self::JointRock(_) => vec!["1".into(), "2".into()],
            _ => AXES.iter().map(|a| (*a).to_owned()).collect(),
        }
    }

    /// Its components in a deformation, in one frame.
    fn values(self, scene: &Scene, deformation: &Deformation, frame: usize) -> Vec<f64> {
        match self {
            Self::Marker(m) => deformation.marker_shift_in(frame, m).as_slice().to_vec(),
            Self::LinkShift(n) => {
                // The base's shift is stored after those of the nodes.
                let shift = deformation.link_shift_in(frame, n.unwrap_or(scene.nodes()));
                (0..3).map(|k| scene.body.length_axis(n, k).dot(&shift)).collect()
            }
            Self::LinkTurn(n) => {
                deformation.bend(frame, n).map_or_else(|| vec![0.0; 3], |b| b.as_slice().to_vec())
            }
            Self::JointRock(n) => {
                deformation.rock(frame, n).map_or_else(|| vec![0.0; 2], |r| r.as_slice().to_vec())
            }
            Self::Tilt(n) => deformation.tilt[n].as_slice().to_vec(),
            Self::CameraTurn => deformation.camera_mount_in(frame).as_slice()[..3].to_vec(),
            Self::CameraShift => deformation.camera_mount_in(frame).as_slice()[3..].to_vec(),
            Self::Focal => vec![deformation.focal_scale_error_in(frame)],
        }
    }

    /// The variables: first the joint on which it depends.
    fn against(self, scene: &Scene, between: &[NodeId], other: Option<NodeId>) -> Vec<Quantity> {
        let mut out: Vec<Quantity> = other.map(Quantity::Position).into_iter().collect();
        match self {
            Self::Marker(m) => out.extend((0..3).map(|k| Quantity::Down(m, k))),
            Self::LinkTurn(n) | Self::JointRock(n) => {
                out.extend((0..3).map(|k| Quantity::Moment(n, k)).chain([Quantity::Position(n)]));
            }
            Self::LinkShift(Some(n)) | Self::Tilt(n) => {
                out.extend([Quantity::Position(n), Quantity::Torque(n)]);
            }
            Self::LinkShift(None) => {}
            Self::CameraTurn | Self::CameraShift | Self::Focal => {
                out.extend(between.iter().take(MOST_JOINTS).map(|&n| Quantity::Position(n)));
            }
        }
        out.retain(|q| {
            let (low, high) = (0..scene.frames)
                .map(|f| q.at(scene, f))
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
            high - low > NEGLIGIBLE
        });
        let mut once = Vec::new();
        out.into_iter().chain([Quantity::Time]).for_each(|q| {
            if !once.contains(&q) {
                once.push(q);
            }
        });
        once
    }
}

impl Quantity {
    fn at(self, scene: &Scene, frame: usize) -> f64 {
        match self {
            Self::Time => scene.time_s[frame],
            Self::Position(n) => scene.q(frame, n),
            Self::Torque(n) => scene.torque(frame, n),
            Self::Moment(n, k) => scene.moment(frame, n)[k],
            Self::Down(m, k) => scene.down_in_mount(frame, m)[k],
        }
    }

    fn axis(self, scene: &Scene) -> TrackAxis {
        let joint = |n: NodeId| &scene.body.nodes[n].joint;
        let (name, unit) = match self {
            Self::Time => ("time".into(), "s"),
            Self::Position(n) => (
                format!("position of joint:{}", joint(n)),
                if scene.body.nodes[n].prismatic { "m" } else { "rad" },
            ),
            Self::Torque(n) => (format!("torque of joint:{}", joint(n)), "N m"),
            Self::Moment(_, k) => (format!("moment of gravity, {}", AXES[k]), "N m"),
            Self::Down(_, k) => (format!("direction of gravity, {}", AXES[k]), ""),
        };
        TrackAxis { name, unit: unit.into() }
    }
}

/// The panels of all causes and of the unexplained part; `causes` in their reported order.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn panels(findings: &Findings<'_>, causes: &[Cause]) -> Result<Panels> {
    let search = &findings.search;
    let (scene, model) = (&search.problem.scene, &findings.found.fit.model);
    let full = search.deformation(model);
    let mut out = Panels::default();
    for (i, term) in model.terms.iter().enumerate() {
        let place = search.catalogue.hypotheses[term.hypothesis].place;
        let effect = search.catalogue.effect(term.hypothesis).name();
        let at = place.name(scene);
        let cause = causes.iter().position(|c| c.effect == effect && c.at == at);
        let is_free = search.catalogue.is_free(term.hypothesis);
        if cause.is_none() && !is_free {
            continue;
        }
        let cause = cause.filter(|_| !is_free);
        let without = search.deformation(&model.without(i));
        let columns = search.catalogue.columns(scene, term);
        let mut parts: Vec<Part> = Vec::new();
        for part in columns.iter().filter_map(|c| Part::of(c.atom)) {
            if !parts.contains(&part) {
                parts.push(part);
            }
        }
        let other = match search.catalogue.effect(term.hypothesis).depends_on() {
            Some(DependsOn::PositionOf(name)) => scene.body.nodes.iter().position(|n| n.joint == *name),
            _ => None,
        };
        for part in parts {
            out.tracks.push(track(findings, (cause, &at), part, other, (&without, &full))?);
        }
        // What varies from frame to frame is no picture.
        let in_picture = columns.iter().any(|c| c.atom.is_in_picture() && c.weight == Weight::One);
        if in_picture {
            let over = if place == Place::Board { Over::Board } else { Over::Image };
            let drawn = field(&search.problem, search.measured_noise, over, &without, Some(&full))?;
            out.fields.extend(drawn.map(|f| Field { cause, at: at.clone(), ..f }));
        }
    }
    // Optics of which only the corners' remainder gives evidence, and no free-form error.
    let bare = findings.unexplained.iter().flat_map(|u| &u.places);
    if bare.clone().any(|p| p.place == Some(Place::Camera) && p.depends_on.is_none()) {
        let drawn = field(&search.problem, search.measured_noise, Over::Image, &full, None)?;
        out.fields.extend(drawn.map(|f| Field { cause: None, at: "camera".into(), ..f }));
    }
    // In the order of the causes; the unexplained part last.
    out.tracks.sort_by_key(|t| t.cause.unwrap_or(usize::MAX));
    out.fields.sort_by_key(|f| f.cause.unwrap_or(usize::MAX));
    Ok(out)
}

fn track(
    findings: &Findings<'_>,
    (cause, at): (Option<usize>, &str),
    part: Part,
    other: Option<NodeId>,
    (without, full): (&Deformation, &Deformation),
) -> Result<Track> {
    let problem = &findings.search.problem;
    let scene = &problem.scene;
    let between: Vec<NodeId> =
        problem.between_camera_and_board.iter().copied().filter(|&n| scene.moves(n)).collect();
    let quantities = part.against(scene, &between, other);
    let noise = findings.search.measured_noise;
    let points = free_errors_of(problem, full, noise, &part.atoms())?
        .into_iter()
        .map(|e| {
            let (all, rest) = (part.values(scene, full, e.frame), part.values(scene, without, e.frame));
            let fitted: Vec<f64> = all.iter().zip(&rest).map(|(a, b)| a - b).collect();
            TrackPoint {
                frame: problem.frame_numbers[e.frame],
                against: quantities.iter().map(|q| q.at(scene, e.frame)).collect(),
                error: e.values.iter().zip(&fitted).map(|(left, value)| left + value).collect(),
                std: e.stds,
                fitted,
            }
        })
        .collect();
    let (what, unit) = part.words();
    Ok(Track {
        cause,
        at: at.to_owned(),
        what: what.into(),
        unit: unit.into(),
        components: part.components(),
        against: quantities.iter().map(|q| q.axis(scene)).collect(),
        points,
    })
}
