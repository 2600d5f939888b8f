//! Exact kinematics of the deformed robot, and its gravity loads.

use crate::diagnose::model::body::Body;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::pose::{Pose, exp, rotation_about};
use nalgebra::{Matrix3, Vector2, Vector3};

/// Where each node is in the URDF root's frame ("world"), and what its joint turns about.
#[derive(Debug, Clone)]
pub(crate) struct NodePoses {
    pub world_from_node: Vec<Pose>,
    /// The joint's origin, m.
    pub origin: Vec<Vector3<f64>>,
    /// The joint's real (tilted) unit axis.
    pub axis: Vec<Vector3<f64>>,
    /// Rotation of the joint's frame, before its motion.
    pub world_from_joint: Vec<Matrix3<f64>>,
    /// The actual position, rad or m.
    pub theta: Vec<f64>,
}

/// The positions at which a frame's nodes were posed last, and memory for which of them move.
#[derive(Debug, Clone)]
pub(crate) struct Before {
    positions: Vec<f64>,
    moved: Vec<bool>,
}

impl Before {
    /// Of nodes that were never posed.
    pub fn never(nodes: usize) -> Self {
        Self { positions: vec![f64::NAN; nodes], moved: vec![true; nodes] }
    }
}

/// The tilted unit axis and its derivative by (tilt_1, tilt_2), in the joint's frame: `unit(a + tan t₁ u + tan t₂ v)`.
pub(crate) fn tilted_axis(
    axis: &Vector3<f64>,
    [u, v]: &[Vector3<f64>; 2],
    tilt: &Vector2<f64>,
) -> (Vector3<f64>, [Vector3<f64>; 2]) {
    let (t1, t2) = (tilt.x.tan(), tilt.y.tan());
    let raw = axis + u * t1 + v * t2;
    let length = raw.norm();
    let unit = raw / length;
    let project = |d: Vector3<f64>| (d - unit * unit.dot(&d)) / length;
    (unit, [project(u * (1.0 + t1 * t1)), project(v * (1.0 + t2 * t2))])
}

impl NodePoses {
    pub fn new(nodes: usize) -> Self {
        Self {
            world_from_node: vec![Pose::identity(); nodes],
            origin: vec![Vector3::zeros(); nodes],
            axis: vec![Vector3::z(); nodes],
            world_from_joint: vec![Matrix3::identity(); nodes],
            theta: vec![0.0; nodes],
        }
    }

    /// Poses all nodes of one frame: parent · shift · fixed · rock · motion about the real axis · bend · sag.
    pub fn update(&mut self, body: &Body, commanded: &[f64], deformation: &Deformation, frame: usize) {
        self.update_of(body, |_| true, commanded, deformation, frame);
    }

    /// As [`NodePoses::update`], of the nodes that `posed` tells, with each the one that carries it.
    pub fn update_of(
        &mut self,
        body: &Body,
        posed: impl Fn(usize) -> bool,
        commanded: &[f64],
        deformation: &Deformation,
        frame: usize,
    ) {
        for n in (0..body.nodes.len()).filter(|n| posed(*n)) {
            self.pose_node(body, n, commanded, deformation, frame);
        }
    }

    /// As [`NodePoses::update_of`] where the same frame was posed before with the same deformation: only the nodes whose
    /// position is another than `before`, and what these carry. `before` then has these positions; NaN of a node that
    /// is not posed.
    pub fn update_changed(
        &mut self,
        body: &Body,
        posed: impl Fn(usize) -> bool,
        commanded: &[f64],
        (deformation, frame): (&Deformation, usize),
        before: &mut Before,
    ) {
        for (n, node) in body.nodes.iter().enumerate() {
            before.moved[n] =
                node.parent.is_some_and(|p| before.moved[p]) || before.positions[n] != commanded[n];
            if !before.moved[n] {
                continue;
            }
            before.positions[n] = if posed(n) {
                self.pose_node(body, n, commanded, deformation, frame);
                commanded[n]
            } else {
                f64::NAN
            };
        }
    }

    fn pose_node(
        &mut self,
        body: &Body,
        n: usize,
        commanded: &[f64],
        deformation: &Deformation,
        frame: usize,
    ) {
        let (node, base) = (&body.nodes[n], body.nodes.len());
        let mut joint = node.parent_from_joint;
        joint.t +=
            deformation.link_shift_in(frame, node.parent.unwrap_or(base)) + deformation.origin_shift[n];
        let mut world_from_joint = match node.parent {
            Some(p) => self.world_from_node[p].then(&joint),
            None => joint,
        };
        if let Some(rock) = deformation.rock(frame, n).filter(|r| **r != Vector2::zeros()) {
            world_from_joint.r *= exp(&(node.tilt_directions[0] * rock.x + node.tilt_directions[1] * rock.y));
        }
        let tilt = &deformation.tilt[n];
        let axis = if tilt.x == 0.0 && tilt.y == 0.0 {
            node.axis
        } else {
            tilted_axis(&node.axis, &node.tilt_directions, tilt).0
        };
        let mut theta = commanded[n] + deformation.joint_delta(frame, n);
        if let Some((leader, factor)) = node.follows {
            theta += factor * deformation.joint_delta(frame, leader);
        }
        let motion = if node.prismatic {
            Pose { r: Matrix3::identity(), t: axis * theta }
        } else {
            Pose { r: rotation_about(&axis, theta), t: Vector3::zeros() }
        };
        self.theta[n] = theta;
        let mut world_from_node = world_from_joint.then(&motion);
        if let Some(omega) = deformation.bend(frame, n) {
            let pivot = node.pivot(&self.theta);
            let middle = world_from_node.point(&pivot);
            world_from_node.r *= exp(omega);
            world_from_node.t = middle - world_from_node.r * pivot;
        }
        if let Some(sag) = deformation.sag(frame, n) {
            world_from_node.t += world_from_node.r * sag;
        }
        self.origin[n] = world_from_joint.t;
        self.axis[n] = world_from_joint.r * axis;
        self.world_from_joint[n] = world_from_joint.r;
        self.world_from_node[n] = world_from_node;
    }

    /// Pose of a site in the world.
    #[inline]
    pub fn site(&self, site: &crate::diagnose::model::body::Site) -> Pose {
        match site.node {
            Some(n) => self.world_from_node[n].then(&site.node_from_site),
            None => site.node_from_site,
        }
    }
}

/// Gravity's loads on the nodes in one frame.
pub(crate) struct Loads<'a> {
    /// Torque on the joint's position, N m.
    pub torque: &'a mut [f64],
    /// Moment about the middle of the node's link, in the node's frame, N m.
    pub moment: &'a mut [Vector3<f64>],
    /// What bends the link as a beam.
    pub beam: &'a mut [BeamLoad],
}

/// What bends a link as a uniform beam of length L, clamped at its joint, in the node's frame. With the compliance c of the whole link
/// its end turns by `c · moment`, and lies `c · sag` beyond where a turn about its middle takes it. Of a telescope the length varies, and it
/// has an effect of its own: here it is a hinge.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct BeamLoad {
    /// Of what it carries, the moment about the middle, `m₁`; of its own mass m at a distance a from the joint, spread around there, a third
    /// of the moment about the joint: `m₁ + a × m g / 3`, N m.
    pub moment: Vector3<f64>,
    /// `(M / 12 + m / 24) L² g` for the mass M that it carries, N m².
    pub sag: Vector3<f64>,
}

/// Tabulates gravity's loads in one frame: torque on each joint's position, moment about the middle of each link.
///
/// `τ = a · Σ (c − o) × m g` over everything that moves when the joint turns while the root link stands still: what
/// the node carries, or, if the node carries the root, all the rest with the opposite sign. A joint that others follow
/// (mimic) also bears theirs, times their factors: the generalised force on the position that moves them all.
///
/// Returns the moment of the whole robot about the root's origin, in its frame, N m: what a base yields to on its bolts.
pub(crate) fn loads(
    body: &Body,
    poses: &NodePoses,
    gravity_in_root: &Vector3<f64>,
    Loads { torque, moment, beam }: Loads<'_>,
) -> Vector3<f64> {
    let root = poses.site(&body.root);
    let gravity = root.r * gravity_in_root;
    let nodes = body.nodes.len();
    // Mass and mass times centre of each node's subtree, in the world; leaves first.
    let mut mass: Vec<f64> = body.nodes.iter().map(|n| n.mass).collect();
    let mut first: Vec<Vector3<f64>> = (0..nodes)
        .map(|n| {
            let pose = &poses.world_from_node[n];
            pose.r * body.nodes[n].mass_moment + pose.t * body.nodes[n].mass
        })
        .collect();
    let (mut total_mass, mut total_first) = (body.base_mass, body.base_mass_moment);
    for n in (0..nodes).rev() {
        match body.nodes[n].parent {
            Some(p) => {
                let (m, f) = (mass[n], first[n]);
                mass[p] += m;
                first[p] += f;
            }
            None => {
                total_mass += mass[n];
                total_first += first[n];
            }
        }
    }
    for n in 0..nodes {
        let origin = poses.origin[n];
        let holds_root = body.carries(n, body.root.node);
        let (m, f, sign) = if holds_root {
            (total_mass - mass[n], total_first - first[n], -1.0)
        } else {
            (mass[n], first[n], 1.0)
        };
        let about_origin = (f - origin * m).cross(&gravity);
        torque[n] = if body.nodes[n].prismatic {
            sign * m * poses.axis[n].dot(&gravity)
        } else {
            sign * poses.axis[n].dot(&about_origin)
        };
        let pose = &poses.world_from_node[n];
        let to_middle = body.nodes[n].pivot(&poses.theta);
        moment[n] = pose.r.tr_mul(&((f - pose.point(&to_middle) * m).cross(&gravity) * sign));
        // Of a node that carries the root the own mass is not among what bends it.
        let own = &body.nodes[n];
        let (own_mass, own_first) =
            if holds_root { (0.0, Vector3::zeros()) } else { (own.mass, own.mass_moment) };
        let down = pose.r.tr_mul(&gravity);
        let lumped = (own_first - to_middle * own_mass).cross(&down);
        if own.column().is_some() {
            beam[n] = BeamLoad { moment: moment[n], sag: Vector3::zeros() };
            continue;
        }
        beam[n] = BeamLoad {
            moment: moment[n] - lumped + own_first.cross(&down) / 3.0,
            sag: down * (sign * (m - own_mass) / 12.0 + own_mass / 24.0) * (4.0 * to_middle.norm_squared()),
        };
    }
    for (n, node) in body.nodes.iter().enumerate() {
        torque[n] += node.followers.iter().map(|(follower, factor)| factor * torque[*follower]).sum::<f64>();
    }
    root.r.tr_mul(&(total_first - root.t * total_mass).cross(&gravity))
}
