//! Elementary changes ([`Atom`]): the elementary ways in which a model can be wrong, and where each moves a point.
//!
//! Every effect of the body is a twist at one place of the chain, times a basis that varies from frame to frame. The
//! twist is the elementary change; its derivative is computed once a frame and shared by all effects at that place.

use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::kinematics::{BeamLoad, NodePoses, tilted_axis};
use crate::diagnose::model::pose::after_turn;
use crate::diagnose::model::scene::Scene;
use crate::diagnose::principles::Size;
use nalgebra::{Vector2, Vector3};

/// An elementary change of the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Atom {
    /// The joint's position.
    Joint(NodeId),
    /// The axis' tilt 0 or 1.
    Tilt(NodeId, usize),
    /// Rotation of the node about its middle by gravity's transverse moment there, per compliance.
    Bend(NodeId),
    /// Turn and sag of the node's end as of a uniform beam's under its load, per compliance.
    Beam(NodeId),
    /// Rotation of the node about its middle along x, y or z of its frame.
    Turn(NodeId, usize),
    /// Rotation of the node about its middle about one of the two directions across its joint's axis (those of `axis_tilt`).
    Across(NodeId, usize),
    /// Rotation about one of the same directions at the joint's origin, before its motion: a twist of what carries it, or
    /// compliance of the joint as a whole.
    Rock(NodeId, usize),
    /// Shift along x, y or z of its frame of the node itself, after it has bent: of how far a bent link's end moves, beyond a turn about its middle.
    Sag(NodeId, usize),
    /// Shift along x, y or z of the origins of the joints that the node (or the base: none) carries.
    LinkShift(Option<NodeId>, usize),
    /// Shift of a joint's own origin along an axis of the frame of what carries it: one of several joints that a link carries.
    OriginShift(NodeId, usize),
    /// Shift of a marker on its mount.
    MarkerShift(usize, usize),
    /// Shift of all markers' images along u or v (0, 1), constant or proportional to the pixel's u or v from the picture's
    /// centre (0, 1, 2): the detector of markers against that of corners.
    MarkerImage(usize, usize),
    /// Tangent of the camera's mount: rotation 0 to 2, translation 3 to 5.
    CameraMount(usize),
    /// Tangent of the board's mount in its nominal frame: rotation 0 to 2, translation 3 to 5. A camera on the board's own body moves
    /// along with it.
    BoardMount(usize),
    /// The same of the board alone, on top of its mount: in the frames in which it has slipped.
    BoardSlip(usize),
    /// Relative error of the focal lengths.
    Focal,
    /// Shift of the principal point along u or v.
    Center(usize),
    /// Radial distortion k1.
    Dk1,
    /// Relative error of the board's squares.
    BoardScale,
    /// Thickness of the pane.
    Glass,
    /// Curvature of the mirror.
    Curvature,
    /// A free-form error of lens, board or mirror.
    FreeOptics(usize),
    /// Tangent of the pose, in the frame of the measured points, of the link to which they belong (the root, of an unknown frame).
    FramePose(usize),
}

impl Atom {
    /// Whether a field over the picture or the board shows it.
    pub fn is_in_picture(self) -> bool {
        self.is_optical() || matches!(self, Self::MarkerImage(..))
    }

    /// Whether the atom is of the camera, its lens, the board's print or the mirror: it changes how corners are seen.
    pub fn is_optical(self) -> bool {
        // Every elementary change is listed: a new one must be added here.
        match self {
            Self::CameraMount(_)
            | Self::Focal
            | Self::Center(_)
            | Self::Dk1
            | Self::BoardScale
            | Self::Glass
            | Self::Curvature
            | Self::FreeOptics(_) => true,
            Self::Joint(_)
            | Self::Tilt(..)
            | Self::Bend(_)
            | Self::Beam(_)
            | Self::Turn(..)
            | Self::Across(..)
            | Self::Rock(..)
            | Self::Sag(..)
            | Self::LinkShift(..)
            | Self::OriginShift(..)
            | Self::MarkerShift(..)
            | Self::MarkerImage(..)
            | Self::BoardMount(_)
            | Self::BoardSlip(_)
            | Self::FramePose(_) => false,
        }
    }
}

/// The velocity field `x ↦ ω × x + b` (world frame) of a moving part.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Twist {
    pub omega: Vector3<f64>,
    pub shift: Vector3<f64>,
}

impl Twist {
    pub fn about(origin: &Vector3<f64>, omega: Vector3<f64>) -> Self {
        Self { omega, shift: origin.cross(&omega) }
    }

    pub fn along(shift: Vector3<f64>) -> Self {
        Self { omega: Vector3::zeros(), shift }
    }

    pub fn times(&self, factor: f64) -> Self {
        Self { omega: self.omega * factor, shift: self.shift * factor }
    }

    pub fn plus(&self, other: &Self) -> Self {
        Self { omega: self.omega + other.omega, shift: self.shift + other.shift }
    }
}

/// The part of `moment` transverse to the node's long axis, which bends the link (a moment about the axis does
/// not).
///
/// The long axis points from the node's origin to that of the joint which it carries (or, at the chain's end, of
/// the marker), or, where that is the same place, to the next one.
pub(crate) fn transverse_moment(scene: &Scene, frame: usize, node: NodeId) -> Vector3<f64> {
    across(scene, node, scene.moment(frame, node))
}

/// The same of what bends the link as a beam.
pub(crate) fn transverse_load(scene: &Scene, frame: usize, node: NodeId) -> BeamLoad {
    let load = scene.beam(frame, node);
    BeamLoad { moment: across(scene, node, &load.moment), sag: across(scene, node, &load.sag) }
}

fn across(scene: &Scene, node: NodeId, of: &Vector3<f64>) -> Vector3<f64> {
    match scene.body.nodes[node].long_axis {
        Some(axis) => of - axis * axis.dot(of),
        None => *of,
    }
}

/// The twist of an atom of the body in one frame; none for the others.
pub(crate) fn body_twist(
    atom: Atom,
    scene: &Scene,
    poses: &NodePoses,
    deformation: &Deformation,
    frame: usize,
) -> Option<Twist> {
    match atom {
        Atom::Joint(n) if scene.body.nodes[n].prismatic => Some(Twist::along(poses.axis[n])),
        Atom::Joint(n) => Some(Twist::about(&poses.origin[n], poses.axis[n])),
        Atom::Tilt(n, k) => {
            let node = &scene.body.nodes[n];
            let (axis, by_tilt) = tilted_axis(&node.axis, &node.tilt_directions, &deformation.tilt[n]);
            if node.prismatic {
                return Some(Twist::along(poses.world_from_joint[n] * by_tilt[k] * poses.theta[n]));
            }
            // dR(a, θ) Rᵀ = hat(sin θ da + (1 − cos θ) a × da) for da ⟂ a.
            let (s, c) = poses.theta[n].sin_cos();
            let omega = by_tilt[k] * s + axis.cross(&by_tilt[k]) * (1.0 - c);
            Some(Twist::about(&poses.origin[n], poses.world_from_joint[n] * omega))
        }
        Atom::Bend(n) => {
            let omega = poses.world_from_node[n].r * transverse_moment(scene, frame, n);
            Some(Twist::about(&middle(scene, poses, (deformation, frame), n), omega))
        }
        Atom::Beam(n) => {
            let load = transverse_load(scene, frame, n);
            let turn = &poses.world_from_node[n].r;
            let about_middle =
                Twist::about(&middle(scene, poses, (deformation, frame), n), turn * load.moment);
            Some(about_middle.plus(&Twist::along(turn * load.sag)))
        }
        Atom::Turn(n, k) => {
            let omega = poses.world_from_node[n].r.column(k).into_owned();
            Some(Twist::about(&middle(scene, poses, (deformation, frame), n), omega))
        }
        Atom::Across(n, k) => {
            let omega = poses.world_from_node[n].r * scene.body.nodes[n].tilt_directions[k];
            Some(Twist::about(&middle(scene, poses, (deformation, frame), n), omega))
        }
        Atom::Rock(n, k) => {
            let directions = &scene.body.nodes[n].tilt_directions;
            let rock = deformation.rock(frame, n).copied().unwrap_or_default();
            let turned = directions[0] * rock.x + directions[1] * rock.y;
            let omega = poses.world_from_joint[n] * after_turn(&turned, &directions[k]);
            Some(Twist::about(&poses.origin[n], omega))
        }
        Atom::Sag(n, k) => Some(Twist::along(poses.world_from_node[n].r.column(k).into_owned())),
        Atom::LinkShift(n, k) => {
            let axis = scene.body.length_axis(n, k);
            Some(Twist::along(n.map_or(axis, |n| poses.world_from_node[n].r * axis)))
        }
        Atom::OriginShift(n, k) => {
            let axis = Vector3::ith_axis(k).into_inner();
            let carrier = scene.body.nodes[n].parent;
            Some(Twist::along(carrier.map_or(axis, |p| poses.world_from_node[p].r * axis)))
        }
        _ => None,
    }
}

/// Where a node bends, in the world, m.
fn middle(
    scene: &Scene,
    poses: &NodePoses,
    (deformation, frame): (&Deformation, usize),
    n: NodeId,
) -> Vector3<f64> {
    let sag = deformation.sag(frame, n).copied().unwrap_or_else(Vector3::zeros);
    poses.world_from_node[n].point(&(scene.body.nodes[n].pivot(&poses.theta) - sag))
}

/// Whether an atom of the body moves one site against another, each by the node that it rides on; of a joint also by
/// the mimic joints that follow it.
pub(crate) fn moves_against(atom: Atom, scene: &Scene, one: Option<NodeId>, other: Option<NodeId>) -> bool {
    let by = |atom: Atom| moves(atom, scene, one) != moves(atom, scene, other);
    by(atom) || followers(atom, scene).iter().any(|(follower, _)| by(Atom::Joint(*follower)))
}

/// The mimic joints that an error of a joint's position moves along with it, each with its factor.
#[inline]
pub(crate) fn followers(atom: Atom, scene: &Scene) -> &[(NodeId, f64)] {
    match atom {
        Atom::Joint(n) => &scene.body.nodes[n].followers,
        _ => &[],
    }
}

/// Whether an atom of the body moves a site that rides on `node`, the joints that follow another one apart.
#[inline]
pub(crate) fn moves(atom: Atom, scene: &Scene, node: Option<NodeId>) -> bool {
    match atom {
        Atom::Joint(n)
        | Atom::Tilt(n, _)
        | Atom::Bend(n)
        | Atom::Beam(n)
        | Atom::Turn(n, _)
        | Atom::Across(n, _)
        | Atom::Rock(n, _)
        | Atom::Sag(n, _)
        | Atom::OriginShift(n, _) => scene.body.carries(n, node),
        Atom::LinkShift(Some(n), _) => scene.body.carries_beyond(n, node),
        Atom::LinkShift(None, _) => node.is_some(),
        _ => false,
    }
}

/// Positions a turn between which a joint's transmission error is interpolated, every 5°. Errors of encoders and of
/// strain wave gears have up to some thirty periods a turn; on four series of a UR10 the evidence for 72 knots is
/// larger than for 60 and fewer, and the prediction of the other series is as good as with 90 and 120.
pub(crate) const KNOTS_A_TURN: Size = 72;

/// How strongly an atom acts in a frame: the basis of an effect.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Weight {
    /// 1 in every frame.
    One,
    /// The commanded position of a node's joint.
    Position(NodeId),
    /// Its sine.
    Sine(NodeId),
    /// Its cosine less 1.
    CosineLessOne(NodeId),
    /// A hat function of its commanded position, once a turn: 1 at the k-th of [`KNOTS_A_TURN`] positions, linearly
    /// down to 0 at the two beside it.
    Knot(NodeId, usize),
    /// Gravity's torque on the joint, N m.
    Torque(NodeId),
    /// Time since the first frame, s.
    Time,
    /// A number for each frame.
    Frames(Vec<f64>),
}

impl Weight {
    #[inline]
    pub fn at(&self, scene: &Scene, frame: usize) -> f64 {
        match self {
            Self::One => 1.0,
            Self::Position(n) => scene.q(frame, *n),
            Self::Sine(n) => scene.sine(frame, *n).0,
            Self::CosineLessOne(n) => scene.sine(frame, *n).1 - 1.0,
            Self::Knot(n, k) => {
                let from_knot = scene.q(frame, *n) * KNOTS_A_TURN as f64 / core::f64::consts::TAU - *k as f64;
                let turn = KNOTS_A_TURN as f64;
                (1.0 - (from_knot - turn * (from_knot / turn).round()).abs()).max(0.0)
            }
            Self::Torque(n) => scene.torque(frame, *n),
            Self::Time => scene.time_s[frame] - scene.time_s[0],
            Self::Frames(values) => values[frame],
        }
    }
}

/// One parameter's derivative: an atom and how strongly it acts in each frame.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Column {
    pub atom: Atom,
    pub weight: Weight,
}

impl Column {
    pub fn constant(atom: Atom) -> Self {
        Self { atom, weight: Weight::One }
    }

    /// Adds `value` of this column to a deformation: exact for every effect that is linear in its parameters.
    pub fn add(&self, value: f64, scene: &Scene, to: &mut Deformation) {
        let by_frame = |add: &mut dyn FnMut(usize, f64)| {
            (0..scene.frames).for_each(|f| add(f, value * self.weight.at(scene, f)));
        };
        let constant = self.weight == Weight::One;
        match self.atom {
            Atom::Joint(n) => by_frame(&mut |f, v| to.add_joint_delta(f, n, v)),
            Atom::Bend(n) => by_frame(&mut |f, v| to.add_bend(f, n, transverse_moment(scene, f, n) * v)),
            Atom::Beam(n) => by_frame(&mut |f, v| {
                let load = transverse_load(scene, f, n);
                to.add_bend(f, n, load.moment * v);
                to.add_sag(f, n, load.sag * v);
            }),
            Atom::Turn(n, k) => by_frame(&mut |f, v| to.add_bend(f, n, Vector3::ith(k, v))),
            Atom::Across(n, k) => {
                let direction = scene.body.nodes[n].tilt_directions[k];
                by_frame(&mut |f, v| to.add_bend(f, n, direction * v));
            }
            Atom::Rock(n, k) => by_frame(&mut |f, v| to.add_rock(f, n, k, v)),
            Atom::Sag(n, k) => by_frame(&mut |f, v| to.add_sag(f, n, Vector3::ith(k, v))),
            Atom::Tilt(n, k) => to.tilt[n][k] += value,
            Atom::OriginShift(n, k) => to.origin_shift[n][k] += value,
            Atom::LinkShift(n, k) if constant => {
                to.link_shift[n.unwrap_or(scene.nodes())] += scene.body.length_axis(n, k) * value;
            }
            Atom::LinkShift(n, k) => {
                let (at, axis) = (n.unwrap_or(scene.nodes()), scene.body.length_axis(n, k));
                by_frame(&mut |f, v| to.add_link_growth(f, at, axis * v));
            }
            Atom::MarkerShift(m, k) if constant => to.marker_shift[m][k] += value,
            Atom::MarkerShift(m, k) => by_frame(&mut |f, v| to.add_marker_shift(f, m, k, v)),
            Atom::CameraMount(k) if constant => to.camera_mount[k] += value,
            Atom::CameraMount(k) => by_frame(&mut |f, v| to.add_camera_sway(f, k, v)),
            Atom::BoardMount(k) => to.board_mount[k] += value,
            Atom::BoardSlip(k) => by_frame(&mut |f, v| to.add_board_slip(f, k, v)),
            Atom::Focal if constant => to.focal_scale_error += value,
            Atom::Focal => by_frame(&mut |f, v| to.add_focal_wander(f, v)),
            Atom::Center(k) => to.center_px += Vector2::ith(k, value),
            Atom::MarkerImage(k, by) => to.marker_image[(k, by)] += value,
            Atom::Dk1 => to.dk1 += value,
            Atom::BoardScale => to.board_scale_error += value,
            Atom::Glass => to.glass_thickness_m += value,
            Atom::Curvature => to.curvature_per_m += value,
            Atom::FreeOptics(k) => to.free_optics[k] += value,
            Atom::FramePose(k) if constant => to.frame_pose[k] += value,
            Atom::FramePose(k) => by_frame(&mut |f, v| to.add_frame_sway(f, k, v)),
        }
    }
}
