//! An isometry that turns handedness, reflection or not.

use super::plane::Plane;
use super::reflection::Reflection;
use crate::error::{Error, Result};
use nalgebra::{Isometry3, Matrix3, Matrix4, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// How far `LᵀL` of a linear part may be from the identity (Frobenius norm) before it is refused.
const ORTHONORMAL_TOLERANCE: f64 = 1e-9;

/// A map `x ↦ L x + t` with L orthonormal and `det L = −1`: a pose of a left-handed frame.
///
/// The paper's `C_T_B′` and its Eq. 1 map `C_T_C′ = C_T_B′ C_T_B⁻¹` are of this kind. A [`Reflection`] is the
/// special case `L² = I`, `L t = −t`; Eq. 1 with noise is not one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImproperIsometry {
    linear: Matrix3<f64>,
    translation: Vector3<f64>,
}

impl ImproperIsometry {
    /// From its linear part and translation (m).
    ///
    /// # Errors
    /// [`Error::OutOfRange`] where L is not orthonormal or its determinant is not −1.
    pub fn new(linear: Matrix3<f64>, translation: Vector3<f64>) -> Result<Self> {
        let away = (linear.transpose() * linear - Matrix3::identity()).norm();
        if !away.is_finite() || away > ORTHONORMAL_TOLERANCE || !translation.iter().all(|x| x.is_finite()) {
            return Err(Error::OutOfRange {
                what: "distance of a linear part from orthonormal".into(),
                got: away,
                needed: format!("at most {ORTHONORMAL_TOLERANCE:e}, and a finite translation"),
            });
        }
        let determinant = linear.determinant();
        if determinant > 0.0 {
            return Err(Error::OutOfRange {
                what: "determinant of a map that turns handedness".into(),
                got: determinant,
                needed: "-1".into(),
            });
        }
        Ok(Self { linear, translation })
    }

    pub(crate) fn new_unchecked(linear: Matrix3<f64>, translation: Vector3<f64>) -> Self {
        Self { linear, translation }
    }

    /// The pose of the left-handed frame B′ that equals the right-handed frame D except for its z axis: `a_from_b′
    /// = a_from_d · diag(1, 1, −1)`.
    pub fn with_z_reversed(a_from_d: &Isometry3<f64>) -> Self {
        let mut linear = a_from_d.rotation.to_rotation_matrix().into_inner();
        linear.column_mut(2).neg_mut();
        Self { linear, translation: a_from_d.translation.vector }
    }

    /// The linear part L (orthonormal, det −1).
    pub fn linear(&self) -> &Matrix3<f64> {
        &self.linear
    }

    /// The translation t, m: where the origin goes.
    pub fn translation(&self) -> &Vector3<f64> {
        &self.translation
    }

    /// The 4×4 homogeneous matrix.
    pub fn to_homogeneous(&self) -> Matrix4<f64> {
        let mut m = Matrix4::identity();
        m.fixed_view_mut::<3, 3>(0, 0).copy_from(&self.linear);
        m.fixed_view_mut::<3, 1>(0, 3).copy_from(&self.translation);
        m
    }

    /// The mapped point, `L x + t`, m.
    pub fn point(&self, point: &Point3<f64>) -> Point3<f64> {
        Point3::from(self.linear * point.coords + self.translation)
    }

    /// The mapped free vector, `L v`.
    pub fn vector(&self, vector: &Vector3<f64>) -> Vector3<f64> {
        self.linear * vector
    }

    /// `x ↦ Lᵀ (x − t)`.
    pub fn inverse(&self) -> Self {
        let linear = self.linear.transpose();
        Self { linear, translation: -(linear * self.translation) }
    }

    /// "First the rigid motion, then this": `a_from_c′ = a_from_b′ · b_from_c`.
    pub fn after_isometry(&self, first: &Isometry3<f64>) -> Self {
        Self {
            linear: self.linear * first.rotation.to_rotation_matrix().into_inner(),
            translation: self.linear * first.translation.vector + self.translation,
        }
    }

    /// "First `first`, then this": two turns of handedness make a rigid motion.
    pub fn after(&self, first: &Self) -> Isometry3<f64> {
        let rotation = Rotation3::from_matrix_unchecked(self.linear * first.linear);
        Isometry3::from_parts(
            Translation3::from(self.linear * first.translation + self.translation),
            UnitQuaternion::from_rotation_matrix(&rotation),
        )
    }

    /// The reflection nearest to this map: the normal is the eigenvector of `(L + Lᵀ)/2` to its smallest eigenvalue
    /// (the maximiser of `−nᵀ L n`, so the nearest H in the Frobenius norm), the offset `d = n·t / 2` (least squares).
    ///
    /// # Errors
    /// [`Error::NoDirection`] where two normals are equally near (L is close to −I: a point inversion).
    pub fn nearest_reflection(&self) -> Result<Reflection> {
        let eigen = ((self.linear + self.linear.transpose()) * 0.5).symmetric_eigen();
        let smallest = eigen.eigenvalues.imin();
        let gap = (0..3)
            .filter(|&i| i != smallest)
            .map(|i| eigen.eigenvalues[i] - eigen.eigenvalues[smallest])
            .fold(f64::INFINITY, f64::min);
        if gap < 1e-9 {
            return Err(Error::NoDirection { what: "normal of the nearest reflection".into(), length: gap });
        }
        let normal: Vector3<f64> = eigen.eigenvectors.column(smallest).into_owned();
        let plane = Plane::new(normal, normal.dot(&self.translation) / 2.0)?;
        Ok(Reflection::across(plane.facing_away_from_origin()))
    }
}

impl Reflection {
    /// This reflection as a general orientation-reversing isometry.
    pub fn to_improper(&self) -> ImproperIsometry {
        ImproperIsometry::new_unchecked(self.linear(), self.translation())
    }
}
