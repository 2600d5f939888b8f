//! Slips during a session: from a row on a marker, the board or the camera has another pose.

use nalgebra::Vector6;

/// What can slip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Slipped {
    Marker(usize),
    /// The board against camera and robot.
    Board,
    /// The camera against board and robot.
    Camera,
}

impl Slipped {
    /// Its first entry in a motion (rotation vector, shift): of a marker only the shift is seen.
    pub fn first_number(self) -> usize {
        if matches!(self, Self::Marker(_)) { 3 } else { 0 }
    }
}

/// A slip: real = nominal ∘ (Exp ω, v) from frame `first` on. For a marker v is in the frame of its mount's link,
/// without ω.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Slip {
    pub what: Slipped,
    pub first: usize,
    /// Rotation vector and shift, rad and m.
    pub motion: Vector6<f64>,
}
