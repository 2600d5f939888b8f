//! The quantities on which effects may depend: the robot's nodes, the commanded motion and its history, and
//! gravity's loads.

use crate::diagnose::data::recording::Recording;
use crate::diagnose::model::body::{Body, NodeId, Site};
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::kinematics::{BeamLoad, Loads, NodePoses, loads};
use crate::diagnose::model::possible_loads::{LEAST_BORNE, PossibleLoad, possible_loads};
use crate::diagnose::model::solver::NEGLIGIBLE;
use crate::diagnose::principles::Guard;
use crate::error::Result;
use crate::robot::Robot;
use nalgebra::Vector3;

/// A link shorter than this (m) has no defined direction.
const SHORTEST_LINK_M: Guard = 1e-4;

/// The quantities that distinguish effects, frame by frame and node by node (`[frame * nodes + node]`).
#[derive(Debug, Clone)]
pub(crate) struct Scene {
    pub body: Body,
    pub frames: usize,
    /// Commanded positions of the nodes' joints, rad or m.
    pub commanded: Vec<f64>,
    /// Sign of the last commanded change (0 before the first), all 0 where the rows are not in order.
    pub direction: Vec<f64>,
    pub ordered: bool,
    /// Torque that gravity puts on the joint, N m (positive pushes the position upward).
    pub torque: Vec<f64>,
    /// Moment of gravity of all that the node carries, about the middle of its link, in its frame, N m.
    pub moment: Vec<Vector3<f64>>,
    /// What bends each node's link as a beam.
    pub beam: Vec<BeamLoad>,
    /// Moment of gravity of the whole robot about the root's origin, in its frame, N m, in each frame.
    pub base_moment: Vec<Vector3<f64>>,
    /// The largest torque (N m, or force, N) and moment (N m) that gravity could put on each node in this session's postures,
    /// whatever its direction; see [`possible_loads`].
    pub possible: Vec<PossibleLoad>,
    pub time_s: Vec<f64>,
    pub gravity: Vector3<f64>,
    pub marker_names: Vec<String>,
    /// Whether the mount is known, by marker.
    pub mount_known: Vec<bool>,
    /// Nodes whose joint moves a marker (or the board) against the observer.
    pub relevant: Vec<bool>,
    /// Nodes that carry what is seen, or who sees it, or the root: the poses of the others tell nothing.
    pub posed: Vec<bool>,
    /// Lowest and highest commanded position of each node's joint, rad or m.
    pub commanded_range: Vec<(f64, f64)>,
    /// Sine and cosine of `commanded`.
    pub sine: Vec<(f64, f64)>,
    /// Direction of gravity in the frame of each marker's mount, `[frame * markers + marker]`.
    pub down: Vec<Vector3<f64>>,
    pub has_camera: bool,
    /// Whether there is a board; a mirror is known by the board seen in it.
    pub has_board: bool,
    /// Largest distance between a relevant joint and a marker that it carries, at the nominal zero posture, m; where none carries one (a
    /// camera in the hand sees markers on the base) between a joint and any marker. Where all of these are at one place, the
    /// longest stroke of a sliding joint.
    pub reach_m: f64,
    pub glass_thickness_m: f64,
}

/// How far relevant joints reach ([`Scene::reach_m`]).
fn reach_m(body: &Body, poses: &NodePoses, relevant: &[bool], markers: &[Site]) -> f64 {
    let farthest = |counts: &dyn Fn(NodeId, &Site) -> bool| {
        let joints = (0..relevant.len()).filter(|&n| relevant[n]);
        let pairs = joints.flat_map(|n| markers.iter().map(move |m| (n, m))).filter(|(n, m)| counts(*n, m));
        pairs.map(|(n, m)| (poses.site(m).t - poses.origin[n]).norm()).fold(0.0, f64::max)
    };
    let carried = farthest(&|n, m| body.carries(n, m.node));
    if carried > 0.0 { carried } else { farthest(&|_, _| true) }
}

impl Scene {
    /// Tabulates the commanded motion and gravity's loads at the nominal postures. Moments are about the joints
    /// until the bending places of the links are known ([`Scene::find_relevant`]).
    ///
    /// # Errors
    /// An unknown link.
    pub fn new(robot: &Robot, recording: &Recording) -> Result<Self> {
        let body = Body::new(robot, &recording.root_link)?;
        let (frames, nodes) = (recording.frames.len(), body.nodes.len());
        let mut commanded = vec![0.0; frames * nodes];
        let mut direction = vec![0.0; frames * nodes];
        for (n, node) in body.nodes.iter().enumerate() {
            let (index, multiplier, offset) = node.command;
            // Before the first row all joints rest at their zeros.
            let (mut last, mut sign) = (node.at_rest(), 0.0);
            for (f, frame) in recording.frames.iter().enumerate() {
                let q = multiplier * frame.commanded[index] + offset;
                if (q - last).abs() > NEGLIGIBLE {
                    sign = (q - last).signum();
                }
                last = q;
                commanded[f * nodes + n] = q;
                direction[f * nodes + n] = if recording.ordered { sign } else { 0.0 };
            }
        }
        let commanded_range = (0..nodes)
            .map(|n| {
                (0..frames)
                    .map(|f| commanded[f * nodes + n])
                    .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), q| (a.min(q), b.max(q)))
            })
            .collect();
        let sight = recording.sight.as_ref();
        let sine = commanded.iter().map(|q| q.sin_cos()).collect();
        let mut scene = Self {
            sine,
            relevant: vec![false; nodes],
            posed: vec![true; nodes],
            body,
            frames,
            commanded,
            direction,
            ordered: recording.ordered,
            torque: vec![0.0; frames * nodes],
            moment: vec![Vector3::zeros(); frames * nodes],
            beam: vec![BeamLoad::default(); frames * nodes],
            base_moment: vec![Vector3::zeros(); frames],
            possible: vec![PossibleLoad::default(); nodes],
            time_s: recording.frames.iter().map(|f| f.time_s).collect(),
            gravity: recording.gravity,
            marker_names: recording.markers.iter().map(|m| m.name.clone()).collect(),
            mount_known: recording.markers.iter().map(|m| m.mount_known).collect(),
            commanded_range,
            down: Vec::new(),
            has_camera: sight.is_some(),
            has_board: sight.is_some_and(|s| s.board.is_some()),
            reach_m: 0.0,
            glass_thickness_m: sight.map_or(0.0, |s| s.glass_thickness_m),
        };
        scene.update_loads(&Deformation::nominal(frames, nodes, recording.markers.len()));
        Ok(scene)
    }

    /// Finds which nodes move the observed sites relative to the observer, how far they reach, and where each
    /// bends. From here on gravity's moments are about these places.
    pub fn find_relevant(
        &mut self,
        observers: &[Option<NodeId>],
        targets: &[Option<NodeId>],
        markers: &[Site],
    ) {
        let nodes = self.nodes();
        for n in 0..nodes {
            self.relevant[n] = observers.iter().any(|&observer| {
                targets.iter().any(|&target| self.body.carries(n, target) != self.body.carries(n, observer))
            });
        }
        let mut poses = NodePoses::new(nodes);
        let nominal = Deformation::nominal(1, nodes, markers.len());
        poses.update(&self.body, &vec![0.0; nodes], &nominal, 0);
        self.reach_m = reach_m(&self.body, &poses, &self.relevant, markers);
        if self.reach_m == 0.0 {
            // Slides with the marker at their origins reach as far as they go.
            let stroke_m = |n: usize| self.commanded_range[n].1 - self.commanded_range[n].0;
            let slides = (0..nodes).filter(|&n| self.relevant[n] && self.body.nodes[n].prismatic);
            self.reach_m = slides.map(stroke_m).fold(0.0, f64::max);
        }
        for n in (0..nodes).filter(|&n| self.relevant[n]) {
            let next_joint =
                |n: NodeId| (0..nodes).find(|&k| self.relevant[k] && self.body.nodes[k].parent == Some(n));
            // End points in the world at rest: of the link, and of those that it carries.
            let tip_of = |n: NodeId| match next_joint(n) {
                Some(k) => Some(poses.origin[k]),
                None => markers
                    .iter()
                    .filter(|m| m.node == Some(n))
                    .map(|m| poses.site(m).t)
                    .max_by(|a, b| (a - poses.origin[n]).norm().total_cmp(&(b - poses.origin[n]).norm())),
            };
            let in_node = |tip: Vector3<f64>| poses.world_from_node[n].inverse_point(&tip);
            let tip = tip_of(n).map_or_else(Vector3::zeros, in_node);
            // Joints at one place: the link between them has no length, and lies along the limb that follows.
            let chain = core::iter::successors(Some(n), |&k| next_joint(k));
            let along =
                chain.filter_map(tip_of).map(in_node).find_map(|tip| tip.try_normalize(SHORTEST_LINK_M));
            self.body.nodes[n].bend_pivot = tip * 0.5;
            self.body.nodes[n].long_axis = along;
        }
        self.update_loads(&Deformation::nominal(self.frames, nodes, markers.len()));
        self.possible = possible_loads(&self.body, &self.commanded, self.gravity.norm());
    }

    /// Computes gravity's loads again at the actual postures of a deformation.
    pub fn update_loads(&mut self, deformation: &Deformation) {
        let nodes = self.body.nodes.len();
        let mut poses = NodePoses::new(nodes);
        for frame in 0..self.frames {
            poses.update(&self.body, &self.commanded[frame * nodes..(frame + 1) * nodes], deformation, frame);
            let at = frame * nodes..(frame + 1) * nodes;
            let of_nodes = Loads {
                torque: &mut self.torque[at.clone()],
                moment: &mut self.moment[at.clone()],
                beam: &mut self.beam[at],
            };
            self.base_moment[frame] = loads(&self.body, &poses, &self.gravity, of_nodes);
        }
    }

    /// Tabulates gravity's direction in the frames of the markers' mounts, at the nominal postures.
    pub fn tabulate_down(&mut self, mounts: &[Site]) {
        let nodes = self.nodes();
        let nominal = Deformation::nominal(self.frames, nodes, mounts.len());
        let mut poses = NodePoses::new(nodes);
        self.down.clear();
        for frame in 0..self.frames {
            poses.update(&self.body, &self.commanded[frame * nodes..(frame + 1) * nodes], &nominal, frame);
            let gravity = poses.site(&self.body.root).r * self.gravity;
            let down = gravity.try_normalize(1e-9).unwrap_or_else(Vector3::zeros);
            for mount in mounts {
                self.down.push(poses.site(mount).r.tr_mul(&down));
            }
        }
    }

    #[inline]
    pub fn down_in_mount(&self, frame: usize, marker: usize) -> &Vector3<f64> {
        &self.down[frame * self.marker_names.len() + marker]
    }

    pub fn nodes(&self) -> usize {
        self.body.nodes.len()
    }

    #[inline]
    pub fn q(&self, frame: usize, node: NodeId) -> f64 {
        self.commanded[frame * self.body.nodes.len() + node]
    }

    /// Commands a frame as another one of a scene is: its posture, the motion that led there, and gravity's loads in it. The time stays.
    pub fn command_as(&mut self, frame: usize, scene: &Self, from: usize) {
        let nodes = self.nodes();
        let (own, other) = (frame * nodes..(frame + 1) * nodes, from * nodes..(from + 1) * nodes);
        self.commanded[own.clone()].copy_from_slice(&scene.commanded[other.clone()]);
        self.sine[own.clone()].copy_from_slice(&scene.sine[other.clone()]);
        self.direction[own.clone()].copy_from_slice(&scene.direction[other.clone()]);
        self.torque[own.clone()].copy_from_slice(&scene.torque[other.clone()]);
        self.moment[own.clone()].copy_from_slice(&scene.moment[other.clone()]);
        self.beam[own].copy_from_slice(&scene.beam[other]);
        self.base_moment[frame] = scene.base_moment[from];
        let mounts = self.marker_names.len();
        let (own, other) = (frame * mounts..(frame + 1) * mounts, from * mounts..(from + 1) * mounts);
        if other.end <= scene.down.len() {
            self.down[own].copy_from_slice(&scene.down[other]);
        }
    }

    /// Sine and cosine of [`Scene::q`].
    #[inline]
    pub fn sine(&self, frame: usize, node: NodeId) -> (f64, f64) {
        self.sine[frame * self.body.nodes.len() + node]
    }

    #[inline]
    pub fn direction(&self, frame: usize, node: NodeId) -> f64 {
        self.direction[frame * self.body.nodes.len() + node]
    }

    #[inline]
    pub fn torque(&self, frame: usize, node: NodeId) -> f64 {
        self.torque[frame * self.body.nodes.len() + node]
    }

    #[inline]
    pub fn moment(&self, frame: usize, node: NodeId) -> &Vector3<f64> {
        &self.moment[frame * self.body.nodes.len() + node]
    }

    #[inline]
    pub fn beam(&self, frame: usize, node: NodeId) -> &BeamLoad {
        &self.beam[frame * self.body.nodes.len() + node]
    }

    /// How far the column that ends with a node was commanded out, frame by frame, m; none where there is no column.
    pub fn extensions_m(&self, node: NodeId) -> Option<Vec<f64>> {
        let column = self.body.nodes[node].column()?;
        let positions = self.commanded.chunks_exact(self.nodes());
        Some(positions.map(|of_frame| column.extension(of_frame)).collect())
    }

    /// Whether the observations show the joint's position: by its own motion, or by that of a mimic joint that follows it.
    pub fn is_seen(&self, node: NodeId) -> bool {
        self.relevant[node] || self.body.nodes[node].followers.iter().any(|(k, _)| self.relevant[*k])
    }

    /// Whether the joint was commanded to more than one position.
    pub fn moves(&self, node: NodeId) -> bool {
        let (low, high) = self.commanded_range[node];
        high - low > NEGLIGIBLE
    }

    /// Whether the joint was commanded to a position other than its zero.
    pub fn leaves_zero(&self, node: NodeId) -> bool {
        let (low, high) = self.commanded_range[node];
        high.max(-low) > NEGLIGIBLE
    }

    /// Largest torque (N m, absolute) that gravity puts on a joint in this session; 0 where it bears [hardly any](LEAST_BORNE).
    pub fn largest_torque(&self, node: NodeId) -> f64 {
        let largest = (0..self.frames).map(|f| self.torque(f, node).abs()).fold(0.0, f64::max);
        if largest < LEAST_BORNE * self.possible[node].torque { 0.0 } else { largest }
    }

    /// The same of a moment on a link (N m), by its size in each frame.
    pub fn largest_moment(&self, node: NodeId, of_frame: impl Fn(usize) -> f64) -> f64 {
        let largest = (0..self.frames).map(of_frame).fold(0.0, f64::max);
        if largest < LEAST_BORNE * self.possible[node].moment { 0.0 } else { largest }
    }
}
