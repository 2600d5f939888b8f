//! The direction of the camera–board transform that the views hardly determine, in words.

use crate::mirror::Board;
use nalgebra::{Matrix3, Matrix6, Vector3};
use std::fmt;

/// A translation is weak where its standard deviation exceeds this share of the board's diagonal (2 mm on the paper's
/// board): it then dominates the error of every marker.
const WEAK_SHARE_OF_DIAGONAL: f64 = 0.02;
/// A rotation is weak where its standard deviation exceeds this, rad (half a degree: 1.3 mm at 150 mm).
const WEAK_ROTATION_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// A direction within this cosine of an axis is called by the axis's name (25°).
const NAMED_COSINE: f64 = 0.906;

/// What is weak: a rotation or a translation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motion {
    /// About an axis; standard deviation in rad.
    Rotation,
    /// Along an axis; standard deviation in m.
    Translation,
}

/// A direction of the transform and how badly it is known: an eigenvector of the rotation's or translation's covariance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WeakDirection {
    /// Rotation or translation.
    pub motion: Motion,
    /// Its axis, a unit vector in the board frame; its sign is arbitrary.
    pub axis_in_board: Vector3<f64>,
    /// Standard deviation, rad or m.
    pub std: f64,
}

/// The worst-known directions of a camera–board transform.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weakness {
    /// The worst-known rotation.
    pub rotation: WeakDirection,
    /// The worst-known translation.
    pub translation: WeakDirection,
    rotation_is_weak: bool,
    translation_is_weak: bool,
}

impl fmt::Display for WeakDirection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let axis = &self.axis_in_board;
        let (verb, value) = match self.motion {
            Motion::Rotation => ("rotation about", format!("{:.2} degrees", self.std.to_degrees())),
            Motion::Translation => ("translation along", format!("{:.1} mm", self.std * 1e3)),
        };
        match ["x", "y", "z"].iter().zip(axis.iter()).find(|(_, c)| c.abs() > NAMED_COSINE) {
            Some((name, _)) => write!(f, "{verb} the board's {name}: {value}"),
            None => {
                write!(f, "{verb} ({:.2}, {:.2}, {:.2}) in the board's axes: {value}", axis.x, axis.y, axis.z)
            }
        }
    }
}

fn worst(motion: Motion, covariance: Matrix3<f64>) -> WeakDirection {
    let eigen = covariance.symmetric_eigen();
    let largest = eigen.eigenvalues.imax();
    WeakDirection {
        motion,
        axis_in_board: eigen.eigenvectors.column(largest).into_owned(),
        std: eigen.eigenvalues[largest].max(0.0).sqrt(),
    }
}

impl Weakness {
    /// The worst directions of a 6×6 covariance in the pose tangent (rotation first, on the board's side).
    pub fn of(covariance: &Matrix6<f64>, board: &Board) -> Self {
        let rotation = worst(Motion::Rotation, covariance.fixed_view::<3, 3>(0, 0).into_owned());
        let translation = worst(Motion::Translation, covariance.fixed_view::<3, 3>(3, 3).into_owned());
        let (nx, ny) = board.corners();
        let diagonal_m = ((nx * nx + ny * ny) as f64).sqrt() * board.square_m();
        Self {
            rotation,
            translation,
            rotation_is_weak: rotation.std > WEAK_ROTATION_RAD,
            translation_is_weak: translation.std > WEAK_SHARE_OF_DIAGONAL * diagonal_m,
        }
    }

    /// The worst direction whose deviation exceeds the limit, translation before rotation; none where all are known
    /// well.
    pub fn weak_direction(&self) -> Option<WeakDirection> {
        if self.translation_is_weak {
            Some(self.translation)
        } else if self.rotation_is_weak {
            Some(self.rotation)
        } else {
            None
        }
    }

    /// The warning that names the poorly known direction and says what to do; none where all are known well.
    pub fn warning(&self) -> Option<String> {
        let named: Vec<String> =
            [(self.translation_is_weak, self.translation), (self.rotation_is_weak, self.rotation)]
                .iter()
                .filter(|(weak, _)| *weak)
                .map(|(_, direction)| direction.to_string())
                .collect();
        (!named.is_empty()).then(|| {
            format!(
                "the views hardly show the {} (one standard deviation); add mirror poses that differ in yaw AND in pitch",
                named.join(", and the ")
            )
        })
    }
}
