//! Depths along the mirror's axis of symmetry, and camera rays split at its normal: what glass and curvature share.

use crate::error::{Error, Result};
use crate::geometry::Plane;
use nalgebra::{Unit, Vector3};

/// A ray flatter than this to the mirror (cosine with its normal) has no reliable intersection with it.
const GRAZING_COSINE: f64 = 1e-6;

/// A depth along the mirror's axis with its derivatives.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct AxialDepth {
    pub depth: f64,
    /// By ρ², the square of the point's distance from the axis.
    pub by_lateral_squared: f64,
    /// By h = n·p.
    pub by_height: f64,
    /// By d.
    pub by_distance: f64,
    /// By the thickness or the curvature.
    pub by_parameter: f64,
}

/// As [`AxialDepth`], of several points, number by number: what is computed for each without a branch runs in vector registers.
#[derive(Clone, Copy)]
pub(crate) struct AxialDepths<const N: usize> {
    pub depth: [f64; N],
    pub by_lateral_squared: [f64; N],
    pub by_height: [f64; N],
    pub by_distance: [f64; N],
    pub by_parameter: [f64; N],
    /// Whether the camera sees the point, and once.
    pub seen: [bool; N],
}

impl<const N: usize> AxialDepths<N> {
    /// All 0, and seen.
    pub const ZERO: Self = Self {
        depth: [0.0; N],
        by_lateral_squared: [0.0; N],
        by_height: [0.0; N],
        by_distance: [0.0; N],
        by_parameter: [0.0; N],
        seen: [true; N],
    };
}

/// A camera ray split at the mirror's normal.
pub(super) struct IncidentRay {
    pub cosine: f64,
    pub lateral: Vector3<f64>,
}

impl IncidentRay {
    pub(super) fn new(plane: &Plane, direction: &Unit<Vector3<f64>>) -> Result<Self> {
        let cosine = plane.normal().dot(direction);
        if !(cosine > GRAZING_COSINE && plane.offset_m() > 0.0) {
            return Err(Error::OutOfRange {
                what: "cosine between a camera ray and the mirror's normal".into(),
                got: cosine,
                needed: format!(
                    "above {GRAZING_COSINE:e}, and a mirror whose normal points away from the camera (d > 0)"
                ),
            });
        }
        Ok(Self { cosine, lateral: direction.into_inner() - plane.normal().into_inner() * cosine })
    }
}
