//! Reflection across a plane: a separate type, so that it cannot be used as a rigid motion.

use super::plane::Plane;
use super::ray::Ray;
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, Unit, UnitQuaternion, Vector3};

/// The reflection across a plane, `x ↦ H x + 2 d n` with `H = I − 2 n nᵀ` (det H = −1, H² = I).
///
/// It is its own inverse, keeps distances, turns handedness and fixes the plane's points; two of them make a
/// rigid motion ([`Reflection::then`]). Both signs of the plane's normal give the same reflection.
///
/// In the paper's words it is `C_T_C′`, from the virtual to the real camera (Eq. 2: `C_T_M P C_T_M⁻¹`).
///
/// ```
/// use mirror_core::geometry::{Plane, Reflection};
/// use nalgebra::{Point3, Vector3};
///
/// let mirror = Reflection::across(Plane::new(Vector3::z(), 0.5)?);
/// let marker = Point3::new(0.5, 0.25, 0.25);
/// assert_eq!(mirror.point(&marker), Point3::new(0.5, 0.25, 0.75));
/// assert_eq!(mirror.point(&mirror.point(&marker)), marker);
/// # Ok::<(), mirror_core::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reflection {
    plane: Plane,
}

impl Reflection {
    /// The reflection across a plane.
    pub fn across(plane: Plane) -> Self {
        Self { plane }
    }

    /// The plane of fixed points.
    pub fn plane(&self) -> &Plane {
        &self.plane
    }

    /// The reflected point, `x + 2 (d − n·x) n`, m.
    pub fn point(&self, point: &Point3<f64>) -> Point3<f64> {
        point - self.plane.normal().into_inner() * (2.0 * self.plane.signed_distance_m(point))
    }

    /// The reflected free vector, `H v`.
    pub fn vector(&self, vector: &Vector3<f64>) -> Vector3<f64> {
        let n = self.plane.normal().into_inner();
        vector - n * (2.0 * n.dot(vector))
    }

    /// The reflected ray. For a camera's ray it is the paper's virtual ray (Eq. 3).
    pub fn ray(&self, ray: &Ray) -> Ray {
        Ray { origin: self.point(&ray.origin), direction: Unit::new_unchecked(self.vector(&ray.direction)) }
    }

    /// The linear part `H = I − 2 n nᵀ`.
    pub fn linear(&self) -> Matrix3<f64> {
        let n = self.plane.normal().into_inner();
        Matrix3::identity() - n * n.transpose() * 2.0
    }

    /// The image of the origin, `2 d n` (m): for a mirror in the camera frame, the virtual camera's centre.
    pub fn translation(&self) -> Vector3<f64> {
        self.plane.foot_point() * 2.0
    }

    /// The rigid motion "first `self`, then `next`".
    pub fn then(&self, next: &Self) -> Isometry3<f64> {
        let linear = next.linear() * self.linear();
        let translation = next.linear() * self.translation() + next.translation();
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(linear));
        Isometry3::from_parts(Translation3::from(translation), rotation)
    }

    /// The same reflection in frame a, of a reflection given in frame b: conjugation by `a_from_b`.
    pub fn transformed(&self, a_from_b: &Isometry3<f64>) -> Self {
        Self { plane: self.plane.transformed(a_from_b) }
    }
}
