//! The elementary small errors of a robot and its set-up: their kinds, their columns, and each as a single effect.
//!
//! Zeros, axes and links are off, loaded joints yield, each joint's transmission has a curve of its own, and markers,
//! board and camera are displaced. Errors of one [`Kind`] have one scale.

use crate::diagnose::data::recording::{Tolerance, Tolerances};
use crate::diagnose::effects::Place;
use crate::diagnose::effects::hypothesis::Catalogue;
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::elementary::{Atom, Column, KNOTS_A_TURN, Weight};
use crate::diagnose::model::scene::Scene;
use crate::diagnose::principles::Size;
use std::collections::HashMap;

/// Angles, lengths of links, places of markers, of the board and of the camera: each kind has its own scale,
/// because mounts by hand have other tolerances than manufactured links.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Angle,
    Length,
    Marker,
    BoardTurn,
    BoardShift,
    CameraTurn,
    CameraShift,
    /// Deflection of the joint with the highest load relative to its rated torque, rad. All joints yield a little,
    /// and more if their rated torque is smaller.
    Spring,
    /// A joint's error as a function of its own position, rad: teeth of gears, scales of encoders.
    Transmission,
    /// A joint's error in one posture, if its column is unrelated to it: of a given scale, and no tolerance.
    Position,
}

pub(crate) const KINDS: Size = 10;

/// The prior of a scale: its usual size, the number of values as which it counts, and the bounds.
pub(crate) struct Habit {
    pub common: f64,
    pub worth: f64,
    pub least: f64,
    pub most: f64,
}

impl Kind {
    pub const ALL: [Self; KINDS] = [
        Self::Angle,
        Self::Length,
        Self::Marker,
        Self::BoardTurn,
        Self::BoardShift,
        Self::CameraTurn,
        Self::CameraShift,
        Self::Spring,
        Self::Transmission,
        Self::Position,
    ];

    /// Which kind an elementary small error is of.
    pub fn of(column: &Column) -> Self {
        match column.atom {
            Atom::Joint(_) if matches!(column.weight, Weight::Frames(_)) => Self::Position,
            Atom::Joint(_) if matches!(column.weight, Weight::Torque(_)) => Self::Spring,
            Atom::Joint(_) if matches!(column.weight, Weight::Knot(..)) => Self::Transmission,
            Atom::LinkShift(..) | Atom::OriginShift(..) => Self::Length,
            Atom::MarkerShift(..) => Self::Marker,
            Atom::BoardMount(k) if k < 3 => Self::BoardTurn,
            Atom::BoardMount(_) => Self::BoardShift,
            Atom::CameraMount(k) if k < 3 => Self::CameraTurn,
            Atom::CameraMount(_) => Self::CameraShift,
            _ => Self::Angle,
        }
    }

    /// Whether it is a mount by hand.
    pub fn is_of_setup(self) -> bool {
        !matches!(self, Self::Angle | Self::Length | Self::Spring | Self::Transmission | Self::Position)
    }

    /// Upper bounds (`most`): 0.1 rad and 5 cm for joints and links; larger errors are no manufacturing tolerance. For mounts by
    /// hand, of which 3 mm and 1° are common, 1.5 to 2 cm and 0.08 rad. 5 mrad for the zeros of joints beside a set-up; a larger one
    /// is a separate error.
    pub fn habit(self, setup_only: bool) -> Habit {
        let nothing_known = |common: f64, least: f64, most: f64| Habit { common, worth: 0.0, least, most };
        match self {
            Self::Angle if setup_only => Habit { common: 2.5e-3, worth: 3.0, least: 5e-6, most: 5e-3 },
            Self::Angle => nothing_known(5e-3, 5e-6, 0.1),
            Self::Length => nothing_known(1e-3, 2e-6, 0.05),
            Self::Spring | Self::Transmission => nothing_known(1e-3, 2e-6, 0.1),
            Self::Position => nothing_known(1.0, 1.0, 1.0),
            Self::Marker if setup_only => Habit { common: 3e-3, worth: 1.0, least: 2e-6, most: 0.015 },
            Self::Marker => nothing_known(1e-3, 2e-6, 0.05),
            Self::BoardTurn | Self::CameraTurn => Habit { common: 0.02, worth: 1.0, least: 5e-6, most: 0.08 },
            Self::BoardShift | Self::CameraShift => {
                Habit { common: 4e-3, worth: 1.0, least: 2e-6, most: 0.02 }
            }
        }
    }
}

/// The joint whose spring a column is.
pub(crate) fn spring_of(column: &Column) -> Option<NodeId> {
    match (Kind::of(column), column.atom) {
        (Kind::Spring, Atom::Joint(n)) => Some(n),
        _ => None,
    }
}

/// The relative compliance of each joint, rad/N m: `1 / e` with its rated torque e, scaled so that the joint with
/// the highest load relative to its rating deflects by 1 rad.
///
/// A gear of twice the torque is about twice as stiff: gears of one series wind up by about the same angle at their
/// rated torque. If the URDF does not state it, the median of the others is used. A scale from the loads of the
/// session instead would make a wrist soft because its loads are small.
pub(crate) fn softness(scene: &Scene, springs: impl Iterator<Item = NodeId>) -> HashMap<NodeId, f64> {
    let springs: Vec<NodeId> = springs.collect();
    let mut stated: Vec<f64> = springs.iter().filter_map(|&n| scene.body.nodes[n].effort_limit).collect();
    stated.sort_by(f64::total_cmp);
    let usual = stated.get(stated.len() / 2).copied().unwrap_or(1.0);
    let effort = |n: NodeId| scene.body.nodes[n].effort_limit.unwrap_or(usual);
    let most = springs.iter().map(|&n| scene.largest_torque(n) / effort(n)).fold(0.0, f64::max);
    springs.iter().map(|&n| (n, 1.0 / (effort(n) * most))).collect()
}

/// An elementary small error as a single effect: its name, place and parameter.
pub(crate) fn single_effect(column: &Column) -> Option<(&'static str, Place, String)> {
    let of_axis = |k: usize| ["dx_m", "dy_m", "dz_m"][k].to_owned();
    let of_pose = |k: usize| ["rx_rad", "ry_rad", "rz_rad", "dx_m", "dy_m", "dz_m"][k].to_owned();
    Some(match (column.atom, &column.weight) {
        (Atom::Joint(_), Weight::Frames(_)) => return None,
        (Atom::Joint(n), Weight::Torque(_)) => {
            ("joint_compliance", Place::Joint(n), "compliance_rad_per_nm".into())
        }
        (Atom::Joint(n), Weight::Knot(_, k)) => {
            ("transmission_error", Place::Joint(n), format!("at_{}_deg_rad", k * 360 / KNOTS_A_TURN))
        }
        (Atom::Joint(n), _) => ("joint_offset", Place::Joint(n), "offset_rad".into()),
        (Atom::Tilt(n, k), _) => ("axis_tilt", Place::Joint(n), format!("tilt_{}_rad", k + 1)),
        (Atom::LinkShift(n, axis), _) => ("link_length", Place::Link(n), of_axis(axis)),
        (Atom::OriginShift(n, axis), _) => ("joint_origin", Place::Joint(n), of_axis(axis)),
        (Atom::MarkerShift(m, axis), _) => ("marker_mount", Place::Marker(m), of_axis(axis)),
        (Atom::BoardMount(k), _) => ("board_mount", Place::Board, of_pose(k)),
        (Atom::CameraMount(k), _) => ("camera_mount", Place::Camera, of_pose(k)),
        _ => return None,
    })
}

/// What the session states of an elementary displacement of a mount, rad or m.
pub(crate) fn stated(tolerances: &Tolerances, atom: Atom) -> Option<f64> {
    let of = |tolerance: &Tolerance, k: usize| if k < 3 { tolerance.turn_rad } else { tolerance.shift_m };
    match atom {
        Atom::MarkerShift(m, _) => tolerances.markers.get(m)?.shift_m,
        Atom::BoardMount(k) => of(&tolerances.board, k),
        Atom::CameraMount(k) => of(&tolerances.camera, k),
        _ => None,
    }
}

/// Columns of the markers whose mounts are known.
pub(crate) fn markers(scene: &Scene) -> impl Iterator<Item = Column> + '_ {
    (0..scene.marker_names.len())
        .filter(|&m| scene.mount_known[m])
        .flat_map(|m| (0..3).map(move |k| Column::constant(Atom::MarkerShift(m, k))))
}

/// Columns of the springs of all loaded revolute joints that may have one as a cause.
pub(crate) fn springs<'a>(scene: &'a Scene, catalogue: &'a Catalogue) -> impl Iterator<Item = Column> + 'a {
    let turns = |n: &NodeId| scene.relevant[*n] && !scene.body.nodes[*n].prismatic;
    (0..scene.nodes())
        .filter(turns)
        .filter(|&n| catalogue.find("joint_compliance", Place::Joint(n)).is_some())
        .map(|n| Column { atom: Atom::Joint(n), weight: Weight::Torque(n) })
}

/// Columns of the transmission errors of all revolute joints, at the positions that the session visits.
pub(crate) fn transmission_errors(scene: &Scene) -> impl Iterator<Item = Column> + '_ {
    let turns = |n: &NodeId| scene.relevant[*n] && scene.moves(*n) && !scene.body.nodes[*n].prismatic;
    let at = |n: NodeId| (0..KNOTS_A_TURN).map(move |k| Weight::Knot(n, k));
    let weights = (0..scene.nodes()).filter(turns).flat_map(move |n| at(n).map(move |weight| (n, weight)));
    weights
        .filter(|(_, weight)| (0..scene.frames).any(|f| weight.at(scene, f) != 0.0))
        .map(|(n, weight)| Column { atom: Atom::Joint(n), weight })
}

/// Columns of board and camera.
pub(crate) fn mounts(scene: &Scene) -> impl Iterator<Item = Column> + '_ {
    let board = (0..if scene.has_board { 6 } else { 0 }).map(|k| Column::constant(Atom::BoardMount(k)));
    let camera = (0..if scene.has_camera { 6 } else { 0 }).map(|k| Column::constant(Atom::CameraMount(k)));
    board.chain(camera)
}
