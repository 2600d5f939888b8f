//! The deformation: what all effects together change in the nominal model. It is the only input of the exact forward
//! model.

use crate::diagnose::model::free_values::FreeValues;
use nalgebra::{Matrix2x3, Vector2, Vector3, Vector6};

/// Values by frame, or by frame and place, all 0 and without memory until one is added.
#[derive(Debug, Clone, PartialEq, Default)]
struct Varying<T>(Vec<T>);

impl<T: Clone + Default> Varying<T> {
    #[inline]
    fn at(&self, index: usize) -> Option<&T> {
        self.0.get(index)
    }

    /// One of `count` values, to be changed.
    fn at_mut(&mut self, index: usize, count: usize) -> &mut T {
        if self.0.is_empty() {
            self.0 = vec![T::default(); count];
        }
        &mut self.0[index]
    }

    /// Whether a value was added.
    fn is_any(&self) -> bool {
        !self.0.is_empty()
    }

    /// The values of one of `places`, frame by frame.
    fn of_place(&self, place: usize, places: usize) -> impl Iterator<Item = &T> {
        self.0.iter().skip(place).step_by(places)
    }
}

/// The difference between the nominal and the actual robot, camera, board and mirror. Zero is the nominal model.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Deformation {
    nodes: usize,
    /// Added to the joint's commanded position, `[frame * nodes + node]`, rad or m.
    joint_delta: Vec<f64>,
    /// Rotation vector at the node's origin, in the node's frame, `[frame * nodes + node]`, rad. Empty where nothing bends.
    bend: Varying<Vector3<f64>>,
    /// Rotation about the joint's origin before its motion, about the two directions of `tilt`, `[frame * nodes + node]`, rad. Empty
    /// where nothing rocks.
    rock: Varying<Vector2<f64>>,
    /// Shift of the bent node in its own frame, `[frame * nodes + node]`, m. Empty where none is.
    sag: Varying<Vector3<f64>>,
    /// `(tilt_1, tilt_2)` of each node's axis, rad.
    pub tilt: Vec<Vector2<f64>>,
    /// Shift of the origins of the joints that the node carries, in the node's frame, m. The last entry is the base's.
    pub link_shift: Vec<Vector3<f64>>,
    /// The same by frame, on top of it, `[frame * (nodes + 1) + node]`, m. Empty where no link grows.
    link_growth: Varying<Vector3<f64>>,
    /// Shift of each joint's own origin, in the frame of what carries it, m.
    pub origin_shift: Vec<Vector3<f64>>,
    /// Shift of each marker in the frame of its mount's link, m.
    pub marker_shift: Vec<Vector3<f64>>,
    /// Shift of a marker that varies, `[frame * markers + marker]`, m. Empty where none does.
    varying_shift: Varying<Vector3<f64>>,
    /// Rotation vector and shift of the real camera in the nominal optical frame, rad and m.
    pub camera_mount: Vector6<f64>,
    /// Rotation vector and shift of the real board in its nominal frame, rad and m.
    pub board_mount: Vector6<f64>,
    pub focal_scale_error: f64,
    pub center_px: Vector2<f64>,
    /// Shift of all markers' images, px: times 1 and the pixel's distance from the picture's centre in u and in v, px.
    pub marker_image: Matrix2x3<f64>,
    pub dk1: f64,
    pub board_scale_error: f64,
    pub glass_thickness_m: f64,
    pub curvature_per_m: f64,
    /// Free-form errors of lens, board and mirror.
    pub free_optics: FreeValues,
    /// The camera's additional mount error, by frame, on top of `camera_mount`; empty where it is constant. The
    /// same tangent.
    camera_sway: Varying<Vector6<f64>>,
    /// Of the board alone, by frame, after `board_mount`; empty where it never slips. The same tangent.
    board_slip: Varying<Vector6<f64>>,
    /// Relative error of the focal lengths on top of `focal_scale_error`, by frame; empty where it is constant.
    focal_wander: Varying<f64>,
    /// Pose of the root in the unknown frame of `points.csv`: tangent on top of its start, rad and m.
    pub frame_pose: Vector6<f64>,
    /// How the root moves in the frame of the measured points, by frame, on top of `frame_pose`; empty where it stands still. The same
    /// tangent, in the frame in which points are measured.
    frame_sway: Varying<Vector6<f64>>,
}

impl Deformation {
    pub fn nominal(frames: usize, nodes: usize, markers: usize) -> Self {
        Self {
            nodes,
            joint_delta: vec![0.0; frames * nodes],
            bend: Varying::default(),
            rock: Varying::default(),
            sag: Varying::default(),
            tilt: vec![Vector2::zeros(); nodes],
            link_shift: vec![Vector3::zeros(); nodes + 1],
            link_growth: Varying::default(),
            origin_shift: vec![Vector3::zeros(); nodes],
            marker_shift: vec![Vector3::zeros(); markers],
            varying_shift: Varying::default(),
            camera_mount: Vector6::zeros(),
            board_mount: Vector6::zeros(),
            focal_scale_error: 0.0,
            center_px: Vector2::zeros(),
            marker_image: Matrix2x3::zeros(),
            dk1: 0.0,
            board_scale_error: 0.0,
            glass_thickness_m: 0.0,
            curvature_per_m: 0.0,
            free_optics: FreeValues::zeros(),
            camera_sway: Varying::default(),
            board_slip: Varying::default(),
            focal_wander: Varying::default(),
            frame_pose: Vector6::zeros(),
            frame_sway: Varying::default(),
        }
    }

    #[inline]
    pub fn joint_delta(&self, frame: usize, node: usize) -> f64 {
        self.joint_delta[frame * self.nodes + node]
    }

    #[inline]
    pub fn add_joint_delta(&mut self, frame: usize, node: usize, delta: f64) {
        self.joint_delta[frame * self.nodes + node] += delta;
    }

    #[inline]
    pub fn bend(&self, frame: usize, node: usize) -> Option<&Vector3<f64>> {
        self.bend.at(frame * self.nodes + node)
    }

    pub fn add_bend(&mut self, frame: usize, node: usize, omega: Vector3<f64>) {
        *self.bend.at_mut(frame * self.nodes + node, self.joint_delta.len()) += omega;
    }

    #[inline]
    pub fn rock(&self, frame: usize, node: usize) -> Option<&Vector2<f64>> {
        self.rock.at(frame * self.nodes + node)
    }

    pub fn add_rock(&mut self, frame: usize, node: usize, axis: usize, value: f64) {
        self.rock.at_mut(frame * self.nodes + node, self.joint_delta.len())[axis] += value;
    }

    #[inline]
    pub fn sag(&self, frame: usize, node: usize) -> Option<&Vector3<f64>> {
        self.sag.at(frame * self.nodes + node)
    }

    pub fn add_sag(&mut self, frame: usize, node: usize, shift: Vector3<f64>) {
        *self.sag.at_mut(frame * self.nodes + node, self.joint_delta.len()) += shift;
    }

    /// Shift of the origins of the joints that a node (behind all nodes: the base) carries, in a frame, m, in the node's frame.
    #[inline]
    pub fn link_shift_in(&self, frame: usize, node: usize) -> Vector3<f64> {
        let growth = self.link_growth.at(frame * self.link_shift.len() + node);
        self.link_shift[node] + growth.copied().unwrap_or_else(Vector3::zeros)
    }

    pub fn add_link_growth(&mut self, frame: usize, node: usize, shift: Vector3<f64>) {
        let count = self.frames() * self.link_shift.len();
        *self.link_growth.at_mut(frame * self.link_shift.len() + node, count) += shift;
    }

    /// Whether a node (behind all nodes: the base) shifts the joints that it carries in any frame.
    pub fn shifts_joints_of(&self, node: usize) -> bool {
        self.link_shift[node] != Vector3::zeros()
            || self.link_growth.of_place(node, self.link_shift.len()).any(|s| *s != Vector3::zeros())
    }

    /// Shift of a marker in a frame, m, in the frame of its mount's link.
    #[inline]
    pub fn marker_shift_in(&self, frame: usize, marker: usize) -> Vector3<f64> {
        let varying = self.varying_shift.at(frame * self.marker_shift.len() + marker);
        self.marker_shift[marker] + varying.copied().unwrap_or_else(Vector3::zeros)
    }

    pub fn add_marker_shift(&mut self, frame: usize, marker: usize, axis: usize, value: f64) {
        let markers = self.marker_shift.len();
        let count = self.frames() * markers;
        self.varying_shift.at_mut(frame * markers + marker, count)[axis] += value;
    }

    /// Whether any of these nodes is not where the nominal model has it.
    pub fn moves_any(&self, nodes: &[usize]) -> bool {
        nodes.iter().any(|&n| {
            self.tilt[n] != Vector2::zeros()
                || self.shifts_joints_of(n)
                || self.origin_shift[n] != Vector3::zeros()
                || self.joint_delta.iter().skip(n).step_by(self.nodes).any(|d| *d != 0.0)
                || self.bend.of_place(n, self.nodes).any(|b| *b != Vector3::zeros())
                || self.rock.of_place(n, self.nodes).any(|b| *b != Vector2::zeros())
                || self.sag.of_place(n, self.nodes).any(|s| *s != Vector3::zeros())
        })
    }

    /// Whether a node is not where the nominal model has it in one frame.
    pub fn moves_in(&self, frame: usize, node: usize) -> bool {
        self.tilt[node] != Vector2::zeros()
            || self.link_shift_in(frame, node) != Vector3::zeros()
            || self.origin_shift[node] != Vector3::zeros()
            || self.joint_delta(frame, node) != 0.0
            || self.bend(frame, node).is_some_and(|b| *b != Vector3::zeros())
            || self.rock(frame, node).is_some_and(|b| *b != Vector2::zeros())
            || self.sag(frame, node).is_some_and(|s| *s != Vector3::zeros())
    }

    /// Whether camera, lens, board or mirror differ from the nominal; then the board's corners must be predicted
    /// again.
    pub fn optics_differ(&self) -> bool {
        self.camera_mount != Vector6::zeros()
            || self.focal_scale_error != 0.0
            || self.center_px != Vector2::zeros()
            || self.dk1 != 0.0
            || self.board_scale_error != 0.0
            || self.glass_thickness_m != 0.0
            || self.curvature_per_m != 0.0
            || self.free_optics != FreeValues::zeros()
            || self.eye_varies()
    }

    /// Whether the camera is not the same in all frames.
    pub fn eye_varies(&self) -> bool {
        self.camera_sway.is_any() || self.focal_wander.is_any()
    }

    /// The camera's mount in a frame: rotation vector and shift in the nominal optical frame, rad and m.
    pub fn camera_mount_in(&self, frame: usize) -> Vector6<f64> {
        self.camera_mount + self.camera_sway.at(frame).copied().unwrap_or_else(Vector6::zeros)
    }

    /// Relative error of the focal lengths in a frame.
    pub fn focal_scale_error_in(&self, frame: usize) -> f64 {
        self.focal_scale_error + self.focal_wander.at(frame).copied().unwrap_or(0.0)
    }

    pub fn add_camera_sway(&mut self, frame: usize, k: usize, value: f64) {
        let frames = self.frames();
        self.camera_sway.at_mut(frame, frames)[k] += value;
    }

    /// How the board has slipped on its mount in a frame: rotation vector and shift in the mounted board's frame, rad and m; none
    /// where it has not.
    #[inline]
    pub fn board_slip(&self, frame: usize) -> Option<Vector6<f64>> {
        self.board_slip.at(frame).copied().filter(|slip| *slip != Vector6::zeros())
    }

    /// Whether the board slips in any frame.
    pub fn board_slips(&self) -> bool {
        self.board_slip.is_any()
    }

    pub fn add_board_slip(&mut self, frame: usize, k: usize, value: f64) {
        let frames = self.frames();
        self.board_slip.at_mut(frame, frames)[k] += value;
    }

    /// The pose of the measured points' link in their frame, as a tangent: rad and m; none where it is the nominal one.
    pub fn frame_pose_in(&self, frame: usize) -> Option<Vector6<f64>> {
        let sway = self.frame_sway.at(frame).copied();
        let pose = self.frame_pose + sway.unwrap_or_else(Vector6::zeros);
        (sway.is_some() || pose != Vector6::zeros()).then_some(pose)
    }

    pub fn add_frame_sway(&mut self, frame: usize, k: usize, value: f64) {
        let frames = self.frames();
        self.frame_sway.at_mut(frame, frames)[k] += value;
    }

    pub fn add_focal_wander(&mut self, frame: usize, value: f64) {
        let frames = self.frames();
        *self.focal_wander.at_mut(frame, frames) += value;
    }

    fn frames(&self) -> usize {
        self.joint_delta.len() / self.nodes.max(1)
    }
}
