//! The rows of one observation: what each row's columns are computed from.

use crate::diagnose::model::body::NodeId;
use nalgebra::{Matrix3, Vector3};

/// The rows of one observation (two of an image point, three of a measured point), whitened.
#[derive(Debug, Clone)]
pub(super) struct Rows {
    pub(super) count: usize,
    pub(super) node: Option<NodeId>,
    pub(super) observer: Option<NodeId>,
    pub(super) marker: Option<usize>,
    pub(super) residual: Vector3<f64>,
    /// Square root of the weight, over the standard deviation.
    pub(super) scale: f64,
    /// 1 and the pixel's distance from the picture's centre in u and in v, px; 0 of a measured point.
    pub(super) in_picture: Vector3<f64>,
    /// Rows by displacement of the point in the world.
    pub(super) by_world: Matrix3<f64>,
    /// The point in the world.
    pub(super) point: Vector3<f64>,
    pub(super) plane: Matrix3<f64>,
    /// Index of its columns of the optics in [`FrameWork::optics`](super::work::FrameWork), if they were requested.
    pub(super) optics: Option<usize>,
    /// Index of its free-form columns in [`FrameWork::free`](super::work::FrameWork), if they were requested.
    pub(super) free: Option<usize>,
    pub(super) measured: bool,
    /// Whether the row before it is of the same target and observer.
    pub(super) continues: bool,
}

impl Rows {
    /// Whether it is of this target and observer.
    pub(super) fn is_of(
        &self,
        node: Option<NodeId>,
        observer: Option<NodeId>,
        marker: Option<usize>,
    ) -> bool {
        self.node == node && self.observer == observer && self.marker == marker
    }
}
