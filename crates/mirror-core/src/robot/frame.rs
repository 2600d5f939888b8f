//! A rigid transform in the form of the kernels: a 4×4 matrix by columns.

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// A column of four numbers: a direction has 0, a position 1 at its end.
pub(super) type Column = [f64; 4];

/// `a_from_b` as the columns of a homogeneous matrix: b's axes and b's origin in frame a.
///
/// Columns of four keep every step a few vector instructions on any processor.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(32))]
pub(super) struct Frame {
    pub x: Column,
    pub y: Column,
    pub z: Column,
    pub origin: Column,
}

/// `a s + b t`, column by column.
#[inline(always)]
pub(super) fn mix(a: &Column, s: f64, b: &Column, t: f64) -> Column {
    [a[0] * s + b[0] * t, a[1] * s + b[1] * t, a[2] * s + b[2] * t, a[3] * s + b[3] * t]
}

#[inline(always)]
fn add(a: &Column, b: &Column) -> Column {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]]
}

#[inline(always)]
fn scale(a: &Column, s: f64) -> Column {
    [a[0] * s, a[1] * s, a[2] * s, a[3] * s]
}

impl Frame {
    pub const IDENTITY: Self = Self {
        x: [1.0, 0.0, 0.0, 0.0],
        y: [0.0, 1.0, 0.0, 0.0],
        z: [0.0, 0.0, 1.0, 0.0],
        origin: [0.0, 0.0, 0.0, 1.0],
    };

    pub fn from_isometry(a_from_b: &Isometry3<f64>) -> Self {
        let r = a_from_b.rotation.to_rotation_matrix();
        Self::from_parts(r.matrix(), &a_from_b.translation.vector)
    }

    pub fn from_parts(rotation: &Matrix3<f64>, translation: &Vector3<f64>) -> Self {
        let column = |j: usize| [rotation[(0, j)], rotation[(1, j)], rotation[(2, j)], 0.0];
        Self {
            x: column(0),
            y: column(1),
            z: column(2),
            origin: [translation.x, translation.y, translation.z, 1.0],
        }
    }

    pub fn rotation(&self) -> Matrix3<f64> {
        Matrix3::new(
            self.x[0], self.y[0], self.z[0], self.x[1], self.y[1], self.z[1], self.x[2], self.y[2], self.z[2],
        )
    }

    #[inline(always)]
    pub fn translation(&self) -> Vector3<f64> {
        Vector3::new(self.origin[0], self.origin[1], self.origin[2])
    }

    pub fn isometry(&self) -> Isometry3<f64> {
        let rotation = Rotation3::from_matrix_unchecked(self.rotation());
        Isometry3::from_parts(
            Translation3::from(self.translation()),
            UnitQuaternion::from_rotation_matrix(&rotation),
        )
    }

    /// Turns a direction of frame b into frame a.
    #[inline(always)]
    pub fn turned(&self, v: [f64; 3]) -> Column {
        add(&mix(&self.x, v[0], &self.y, v[1]), &scale(&self.z, v[2]))
    }

    /// Maps a point of frame b into frame a.
    #[inline(always)]
    pub fn mapped(&self, p: [f64; 3]) -> Column {
        add(&self.turned(p), &self.origin)
    }

    #[inline(always)]
    pub fn vector(&self, v: &Vector3<f64>) -> Vector3<f64> {
        let c = self.turned([v.x, v.y, v.z]);
        Vector3::new(c[0], c[1], c[2])
    }

    #[inline(always)]
    pub fn point(&self, p: &Point3<f64>) -> Vector3<f64> {
        let c = self.mapped([p.x, p.y, p.z]);
        Vector3::new(c[0], c[1], c[2])
    }

    /// Turns a direction of frame a into frame b: `Rᵀ v`.
    #[inline(always)]
    pub fn turned_back(&self, v: &Vector3<f64>) -> Vector3<f64> {
        let dot = |c: &Column| c[0] * v.x + c[1] * v.y + c[2] * v.z;
        Vector3::new(dot(&self.x), dot(&self.y), dot(&self.z))
    }
}
