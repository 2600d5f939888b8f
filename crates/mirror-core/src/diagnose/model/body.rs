//! The robot as the diagnosis uses it: moving nodes, and sites (camera, board, markers) that are fixed to them.

use crate::diagnose::model::pose::Pose;
use crate::diagnose::model::telescope::Telescope;
use crate::error::Result;
use crate::robot::{JointKind, Robot};
use nalgebra::Vector3;

/// Index of a movable node. Where it is optional, none is the immovable base (the URDF's root).
pub(crate) type NodeId = usize;

/// A movable joint together with the body (its child link and all that is fixed to it) that it moves.
#[derive(Debug, Clone)]
pub(crate) struct Node {
    /// The joint's URDF name.
    pub joint: String,
    /// The URDF name of the joint's child link: the body's name.
    pub link: String,
    pub parent: Option<NodeId>,
    /// Pose of the joint in the parent node's frame (fixed joints between them multiplied out).
    pub parent_from_joint: Pose,
    /// Unit axis in the joint's frame.
    pub axis: Vector3<f64>,
    /// The two directions in which `axis_tilt` tilts the axis (`effects.md`).
    pub tilt_directions: [Vector3<f64>; 2],
    pub prismatic: bool,
    /// Largest torque (N m) or force (N) that the joint is made for; none where the URDF states none.
    pub effort_limit: Option<f64>,
    /// Middle of the line from the joint to what the link carries next, in the node's frame, m: where the link bends.
    ///
    /// The bending of a uniform beam acts at its end as if it were lumped in its middle.
    pub bend_pivot: Vector3<f64>,
    /// The run of sliding joints that this one ends; none of joints that turn.
    pub telescope: Option<Telescope>,
    /// Unit vector along the link in the node's frame; none where its direction is not defined.
    pub long_axis: Option<Vector3<f64>>,
    /// Index into the commanded positions, and `position ↦ multiplier · position + offset` (mimic joints).
    pub command: (usize, f64, f64),
    /// The node of the joint that a mimic joint follows, and the factor; none of a joint that moves by itself.
    ///
    /// A mimic joint's commanded position says nothing that the other's does not. It follows where the other really is
    /// (gears or links drive both), so an error of the other's position reaches it, times the factor.
    pub follows: Option<(NodeId, f64)>,
    /// The mimic joints that follow this one, each with its factor.
    pub followers: Vec<(NodeId, f64)>,
    /// Mass (kg) and mass times centre (kg m, in the node's frame) of the body.
    pub mass: f64,
    pub mass_moment: Vector3<f64>,
    /// `ancestors[k]`: whether node k is this node or carries it.
    pub ancestors: Vec<bool>,
}

impl Node {
    /// Where the link bends, in the node's frame, m: its middle; for a telescope the middle of the extended part.
    ///
    /// `positions` of the nodes' joints, `[node]`, up to this node.
    pub fn pivot(&self, positions: &[f64]) -> Vector3<f64> {
        match self.column() {
            Some(telescope) => self.bend_pivot + telescope.foot(positions) * 0.5,
            None => self.bend_pivot,
        }
    }

    /// The position at which the joint rests before anything is commanded: 0, and of a mimic joint what follows from it.
    pub fn at_rest(&self) -> f64 {
        self.command.2
    }

    /// The column that slides out with this node as its last tube.
    pub fn column(&self) -> Option<&Telescope> {
        self.telescope.as_ref().filter(|t| t.is_column())
    }
}

/// A link of interest and the node that it rides on.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Site {
    pub node: Option<NodeId>,
    pub node_from_site: Pose,
}

/// The tree of nodes, in topological order.
#[derive(Debug, Clone)]
pub(crate) struct Body {
    pub nodes: Vec<Node>,
    /// The link that stands still and in which gravity is given.
    pub root: Site,
    /// The base body's mass (kg) and mass times centre (kg m).
    pub base_mass: f64,
    pub base_mass_moment: Vector3<f64>,
    link_sites: Vec<Site>,
    link_names: Vec<String>,
    link_parents: Vec<Option<usize>>,
    first_joint_parent: Option<usize>,
}

impl Body {
    /// Multiplies out the fixed joints of a robot; `root_link` is the link in which gravity is given.
    ///
    /// # Errors
    /// An unknown link.
    pub fn new(robot: &Robot, root_link: &str) -> Result<Self> {
        let links = robot.links().len();
        let mut link_sites = vec![Site { node: None, node_from_site: Pose::identity() }; links];
        let mut link_parents = vec![None; links];
        let mut nodes: Vec<Node> = Vec::new();
        let mut first_joint_parent = None;
        for joint in robot.joints() {
            let parent = link_sites[joint.parent_link];
            let parent_from_joint = parent.node_from_site.then(&Pose::from(&joint.parent_from_joint));
            link_parents[joint.child_link] = Some(joint.parent_link);
            if joint.kind == JointKind::Fixed {
                link_sites[joint.child_link] = Site { node: parent.node, node_from_site: parent_from_joint };
                continue;
            }
            let id = nodes.len();
            first_joint_parent = first_joint_parent.or(Some(joint.parent_link));
            let mut ancestors = parent.node.map_or_else(Vec::new, |p| nodes[p].ancestors.clone());
            ancestors.resize(id + 1, false);
            ancestors[id] = true;
            let axis = joint.axis.into_inner();
            let prismatic = joint.kind == JointKind::Prismatic;
            let telescope = prismatic.then(|| {
                let inner = parent.node.and_then(|p: NodeId| nodes[p].telescope.as_ref());
                Telescope::of(
                    id,
                    inner,
                    &parent_from_joint,
                    &axis,
                    joint.limits.map_or((f64::NEG_INFINITY, f64::INFINITY), |l| (l.lower, l.upper)),
                )
            });
            nodes.push(Node {
                joint: joint.name.clone(),
                link: robot.links()[joint.child_link].name.clone(),
                parent: parent.node,
                parent_from_joint,
                axis,
                tilt_directions: tilt_directions(&axis),
                prismatic,
                effort_limit: joint.effort_limit,
                bend_pivot: Vector3::zeros(),
                telescope,
                long_axis: None,
                command: joint.drive.map_or((0, 0.0, 0.0), |d| (d.position, d.multiplier, d.offset)),
                follows: None,
                followers: Vec::new(),
                mass: 0.0,
                mass_moment: Vector3::zeros(),
                ancestors,
            });
            link_sites[joint.child_link] = Site { node: Some(id), node_from_site: Pose::identity() };
        }
        let count = nodes.len();
        for node in &mut nodes {
            node.ancestors.resize(count, false);
        }
        join_followers(robot, &mut nodes);
        let (mut base_mass, mut base_mass_moment) = (0.0, Vector3::zeros());
        for (link, site) in robot.links().iter().zip(&link_sites) {
            let moment = site.node_from_site.point(&link.com_in_link_m.coords) * link.mass_kg;
            match site.node {
                Some(n) => {
                    nodes[n].mass += link.mass_kg;
                    nodes[n].mass_moment += moment;
                }
                None => {
                    base_mass += link.mass_kg;
                    base_mass_moment += moment;
                }
            }
        }
        let root = link_sites[robot.link_index(root_link)?];
        let link_names = robot.links().iter().map(|l| l.name.clone()).collect();
        Ok(Self {
            nodes,
            root,
            base_mass,
            base_mass_moment,
            link_sites,
            link_names,
            link_parents,
            first_joint_parent,
        })
    }

    /// The site of a link of the robot, by its index.
    pub fn site(&self, link: usize) -> Site {
        self.link_sites[link]
    }

    /// The frame of a marker's mount: that of the link which carries the marker's link by a fixed joint, as (node,
    /// node_from_mount).
    pub fn mount_of(&self, link: usize) -> Site {
        match self.link_parents[link] {
            Some(parent) if self.link_sites[parent].node == self.link_sites[link].node => {
                self.link_sites[parent]
            }
            _ => self.link_sites[link],
        }
    }

    /// The URDF name of the body of a node; of the base (none) that of the link in which the tree starts.
    pub fn node_link_name(&self, node: Option<NodeId>) -> &str {
        match node {
            Some(n) => &self.nodes[n].link,
            None => self.base_link(),
        }
    }

    /// The k-th axis of the frame in which the length of a link is told, in its node's frame: the node's own; of the base
    /// (none) that of [the link whose name it has](Self::node_link_name), which may be turned against the URDF's root.
    pub fn length_axis(&self, link: Option<NodeId>, k: usize) -> Vector3<f64> {
        let base = self.first_joint_parent.filter(|_| link.is_none()).map(|l| self.link_sites[l]);
        base.map_or_else(|| Vector3::ith(k, 1.0), |site| site.node_from_site.r.column(k).into_owned())
    }

    /// The base's link that carries the first joint: `torso_link` rather than an empty root.
    fn base_link(&self) -> &str {
        self.first_joint_parent.and_then(|l| self.link_names.get(l)).map_or("base", String::as_str)
    }

    /// Whether one of two joints carries the other: then one can act on the other through the body.
    pub fn share_a_limb(&self, j: NodeId, k: NodeId) -> bool {
        self.carries(j, Some(k)) || self.carries(k, Some(j))
    }

    /// Whether node `node` carries `site`.
    #[inline]
    pub fn carries(&self, node: NodeId, site: Option<NodeId>) -> bool {
        site.is_some_and(|s| self.nodes[s].ancestors[node])
    }

    /// Whether the joint of node `node` carries `site`: what moves when that joint's origin is shifted.
    #[inline]
    pub fn carries_beyond(&self, node: NodeId, site: Option<NodeId>) -> bool {
        site.is_some_and(|s| s != node && self.nodes[s].ancestors[node])
    }
}

/// The directions of `axis_tilt` (`effects.md`): `e = x`, or y where `|a_x| ≥ 0.8`; `u = unit(a × e)`, `v = a × u`.
fn tilt_directions(axis: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let e = if axis.x.abs() >= 0.8 { Vector3::y() } else { Vector3::x() };
    let u = axis.cross(&e).normalize();
    [u, axis.cross(&u)]
}

/// Tells each mimic joint which one it follows, and that one which follow it: chains of mimic joints are followed to the
/// joint that moves by itself.
fn join_followers(robot: &Robot, nodes: &mut [Node]) {
    let moving = || robot.joints().iter().filter(|j| j.kind != JointKind::Fixed);
    for (follower, joint) in moving().enumerate().filter(|(_, j)| j.mimic.is_some()) {
        let Some(drive) = joint.drive else { continue };
        let leads = |j: &crate::robot::Joint| {
            j.mimic.is_none() && j.drive.is_some_and(|d| d.position == drive.position)
        };
        let Some(leader) = moving().position(leads) else { continue };
        nodes[follower].follows = Some((leader, drive.multiplier));
        nodes[leader].followers.push((follower, drive.multiplier));
    }
}
