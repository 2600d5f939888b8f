//! An oriented plane with a unit normal by type.

use crate::error::{Error, Result, finite};
use nalgebra::{Isometry3, Matrix3, Point3, Unit, Vector3};

/// Below this length (m, or of any vector) a vector has no reliable direction.
pub(crate) const SHORTEST_DIRECTION: f64 = 1e-12;

/// An oriented plane `{x : n·x = d}` with `|n| = 1`; n is unitless, d in metres.
///
/// The signed distance of a point is `n·x − d`. `(n, d)` and `(−n, −d)` are the same set of points, seen from
/// its two sides; [`Plane::flipped`] turns one into the other. A mirror is a plane with `d > 0` in the camera
/// frame, n pointing from the camera to the mirror ([`Plane::facing_away_from_origin`]).
///
/// # The foot-point chart
/// A plane that misses the origin is given by three numbers without any constraint or choice of axes: the foot
/// of the origin's perpendicular, `f = d n`. It does not change when the normal is flipped. Estimators use it
/// as the plane's three parameters, so that a covariance of a plane is one 3×3 matrix in m².
///
/// ```
/// use mirror_core::geometry::Plane;
/// use nalgebra::{Point3, Vector3};
///
/// let mirror = Plane::new(Vector3::new(0.0, 0.0, 2.0), 0.5)?;
/// assert_eq!(mirror.foot_point(), Vector3::new(0.0, 0.0, 0.5));
/// assert_eq!(mirror.signed_distance_m(&Point3::new(0.1, 0.2, 0.3)), -0.2);
/// # Ok::<(), mirror_core::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    normal: Unit<Vector3<f64>>,
    offset_m: f64,
}

impl Plane {
    /// The plane `n·x = d` of a normal of any length (it is normalised, and the offset is the distance along the unit normal).
    ///
    /// # Errors
    /// [`Error::NotFinite`], or [`Error::NoDirection`] for a normal that is zero.
    pub fn new(normal: Vector3<f64>, offset_m: f64) -> Result<Self> {
        for value in normal.iter() {
            finite("plane normal", *value)?;
        }
        finite("plane offset (m)", offset_m)?;
        let normal = Unit::try_new(normal, SHORTEST_DIRECTION)
            .ok_or(Error::NoDirection { what: "plane normal".into(), length: normal.norm() })?;
        Ok(Self { normal, offset_m })
    }

    /// The plane through a point (m) with the given normal.
    ///
    /// # Errors
    /// As [`Plane::new`].
    pub fn through_point(point: &Point3<f64>, normal: Vector3<f64>) -> Result<Self> {
        let plane = Self::new(normal, 0.0)?;
        Self::new(*plane.normal, plane.normal.dot(&point.coords))
    }

    /// The plane whose foot of the origin's perpendicular is `foot = d n` (m), with `d = |foot| > 0`.
    ///
    /// # Errors
    /// [`Error::NoDirection`] where the plane would go through the origin: the chart does not cover it.
    pub fn from_foot_point(foot: &Vector3<f64>) -> Result<Self> {
        Self::new(*foot, foot.norm())
    }

    /// The plane half-way between a point and its reflection, its normal from the point to the reflection.
    ///
    /// # Errors
    /// [`Error::NoDirection`] where the two coincide.
    pub fn between(point: &Point3<f64>, reflection: &Point3<f64>) -> Result<Self> {
        Self::through_point(&nalgebra::center(point, reflection), reflection - point)
    }

    /// The unit normal n.
    pub fn normal(&self) -> Unit<Vector3<f64>> {
        self.normal
    }

    /// The signed distance d of the plane from the origin along n, m.
    pub fn offset_m(&self) -> f64 {
        self.offset_m
    }

    /// The foot of the origin's perpendicular, `f = d n`, m.
    pub fn foot_point(&self) -> Vector3<f64> {
        self.normal.into_inner() * self.offset_m
    }

    /// Signed distance of a point from the plane, `n·x − d`, m; positive on the side to which n points.
    pub fn signed_distance_m(&self, point: &Point3<f64>) -> f64 {
        self.normal.dot(&point.coords) - self.offset_m
    }

    /// The same set of points with the opposite normal: `(−n, −d)`.
    pub fn flipped(&self) -> Self {
        Self { normal: -self.normal, offset_m: -self.offset_m }
    }

    /// The same set of points with the normal's sign such that `d ≥ 0`: pointing away from the origin.
    pub fn facing_away_from_origin(&self) -> Self {
        if self.offset_m < 0.0 { self.flipped() } else { *self }
    }

    /// The plane in frame a of a plane given in frame b: `n_a = R n_b`, `d_a = d_b + n_a·t`.
    pub fn transformed(&self, a_from_b: &Isometry3<f64>) -> Self {
        let normal = a_from_b.rotation * self.normal;
        Self { normal, offset_m: self.offset_m + normal.dot(&a_from_b.translation.vector) }
    }

    /// `∂n/∂f` (1/m) in the foot-point chart: `(I − n nᵀ) / d`. Multiply with a foot-point covariance from both
    /// sides for the covariance of the normal.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] where the plane goes through the origin.
    pub fn normal_by_foot_point(&self) -> Result<Matrix3<f64>> {
        if self.offset_m.abs() < SHORTEST_DIRECTION {
            return Err(Error::OutOfRange {
                what: "plane offset (m)".into(),
                got: self.offset_m,
                needed: "a plane that misses the origin".into(),
            });
        }
        let n = self.normal.into_inner();
        Ok((Matrix3::identity() - n * n.transpose()) / self.offset_m)
    }
}
