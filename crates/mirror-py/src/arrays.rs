//! The one place where NumPy meets nalgebra: shapes are checked here, nowhere else.
//!
//! Arrays are read through [`numpy::PyArrayLike2`], so that lists and other number types are taken, and
//! element by element, so that any strides (also negative ones) are right.

#![allow(dead_code)] // each binding file uses the shapes that it needs

use crate::errors::MirrorPostureError;
use nalgebra::{
    Isometry3, Matrix3, Matrix4, Matrix6, Rotation3, SMatrix, Translation3, UnitQuaternion, Vector2, Vector3,
};
use numpy::{
    AllowTypeChange, PyArray, PyArray1, PyArrayLike1, PyArrayLike2, PyArrayLikeDyn, PyUntypedArrayMethods,
};
use numpy::{PyArrayMethods, ndarray};
use pyo3::prelude::*;

/// Anything that NumPy can read as a one-dimensional array of doubles.
pub type Array1Like<'py> = PyArrayLike1<'py, f64, AllowTypeChange>;
/// Anything that NumPy can read as a two-dimensional array of doubles.
pub type Array2Like<'py> = PyArrayLike2<'py, f64, AllowTypeChange>;
/// Anything that NumPy can read as an array of doubles of any number of dimensions.
pub type ArrayDynLike<'py> = PyArrayLikeDyn<'py, f64, AllowTypeChange>;

/// A shape error that names the argument, what was got and what was needed.
pub fn shape_error(argument: &str, got: &[usize], needed: &str) -> PyErr {
    MirrorPostureError::new_err(format!("{argument}: got an array of shape {got:?}, needed {needed}"))
}

/// Reads an `(N, 2)` array as pixels or other pairs.
pub fn pairs(argument: &str, array: &Array2Like<'_>) -> PyResult<Vec<Vector2<f64>>> {
    if array.shape()[1] != 2 {
        return Err(shape_error(argument, array.shape(), "(N, 2)"));
    }
    let view = array.as_array();
    Ok(view.rows().into_iter().map(|r| Vector2::new(r[0], r[1])).collect())
}

/// Reads an `(N, 3)` array as points or vectors.
pub fn triples(argument: &str, array: &Array2Like<'_>) -> PyResult<Vec<Vector3<f64>>> {
    if array.shape()[1] != 3 {
        return Err(shape_error(argument, array.shape(), "(N, 3)"));
    }
    let view = array.as_array();
    Ok(view.rows().into_iter().map(|r| Vector3::new(r[0], r[1], r[2])).collect())
}

/// Reads a `(3,)` array as a point or vector.
pub fn triple(argument: &str, array: &Array1Like<'_>) -> PyResult<Vector3<f64>> {
    let view = array.as_array();
    if view.len() != 3 {
        return Err(shape_error(argument, array.shape(), "(3,)"));
    }
    Ok(Vector3::new(view[0], view[1], view[2]))
}

/// Reads an `(N, width)` array by rows: N and the numbers.
pub fn rows_of(
    argument: &str,
    array: &Array2Like<'_>,
    width: usize,
    what: &str,
) -> PyResult<(usize, Vec<f64>)> {
    if array.shape()[1] != width {
        return Err(shape_error(argument, array.shape(), &format!("(N, {width}): {what}")));
    }
    let view = array.as_array();
    let numbers = match view.as_slice() {
        Some(slice) => slice.to_vec(),
        None => view.iter().copied().collect(),
    };
    Ok((array.shape()[0], numbers))
}

/// Reads an array of a fixed inner shape `(N, …)` in C order: N and the numbers.
pub fn stacked(argument: &str, array: &ArrayDynLike<'_>, inner: &[usize]) -> PyResult<(usize, Vec<f64>)> {
    let shape = array.shape();
    if shape.len() != inner.len() + 1 || shape[1..] != *inner {
        let needed = inner.iter().map(|n| format!(", {n}")).collect::<String>();
        return Err(shape_error(argument, shape, &format!("(N{needed})")));
    }
    let view = array.as_array();
    let numbers = match view.as_slice() {
        Some(slice) => slice.to_vec(),
        None => view.iter().copied().collect(),
    };
    Ok((shape[0], numbers))
}

/// As [`stacked`], of an array that must have so many rows: one a frame, or one a view.
pub fn of_rows(argument: &str, array: &ArrayDynLike<'_>, inner: &[usize], rows: usize) -> PyResult<Vec<f64>> {
    let (got, numbers) = stacked(argument, array, inner)?;
    if got != rows {
        return Err(shape_error(argument, array.shape(), &format!("{rows} rows, one a frame")));
    }
    Ok(numbers)
}

/// Reads a mask of a given shape, by rows.
pub fn mask(argument: &str, array: &PyArrayLike2<'_, bool>, shape: [usize; 2]) -> PyResult<Vec<bool>> {
    if array.shape() != shape {
        return Err(shape_error(argument, array.shape(), &format!("{shape:?}")));
    }
    Ok(array.as_array().iter().copied().collect())
}

/// Reads a `(6, 6)` covariance of a pose, in the tangent with rotation first.
pub fn pose_covariance(argument: &str, array: &Array2Like<'_>) -> PyResult<Matrix6<f64>> {
    if array.shape() != [6, 6] {
        return Err(shape_error(
            argument,
            array.shape(),
            "(6, 6): rotation first (rad), then translation (m)",
        ));
    }
    let m = array.as_array();
    Ok(Matrix6::from_fn(|i, j| m[[i, j]]))
}

/// The numbers of a matrix in C order.
pub fn row_major<const R: usize, const C: usize>(
    matrix: &SMatrix<f64, R, C>,
) -> impl Iterator<Item = f64> + use<'_, R, C> {
    (0..R).flat_map(move |i| (0..C).map(move |j| matrix[(i, j)]))
}

/// Hands numbers in C order over as an array of that shape, without a copy.
pub fn reshaped<'py, const D: usize>(
    py: Python<'py>,
    numbers: Vec<f64>,
    shape: [usize; D],
) -> PyResult<Bound<'py, PyArray<f64, ndarray::Dim<[usize; D]>>>>
where
    ndarray::Dim<[usize; D]>: ndarray::Dimension,
    [usize; D]: ndarray::IntoDimension<Dim = ndarray::Dim<[usize; D]>>,
{
    PyArray1::from_vec(py, numbers).reshape(shape)
}

/// How far a rotation block may be from orthonormal before it is refused.
const ROTATION_TOLERANCE: f64 = 1e-6;

/// Reads a `(4, 4)` homogeneous matrix as a rigid transform `a_from_b`; refuses reflections and shears.
pub fn isometry(argument: &str, array: &Array2Like<'_>) -> PyResult<Isometry3<f64>> {
    if array.shape() != [4, 4] {
        return Err(shape_error(argument, array.shape(), "(4, 4), a homogeneous rigid transform"));
    }
    let view = array.as_array();
    rigid(argument, &Matrix4::from_fn(|i, j| view[[i, j]]))
}

/// Reads an `(N, 4, 4)` array as rigid transforms; as [`isometry`].
pub fn isometries(argument: &str, array: &ArrayDynLike<'_>) -> PyResult<Vec<Isometry3<f64>>> {
    let (_, numbers) = stacked(argument, array, &[4, 4])?;
    let matrices = numbers.chunks_exact(16).enumerate();
    matrices.map(|(row, m)| rigid(&format!("{argument}[{row}]"), &Matrix4::from_row_slice(m))).collect()
}

/// A homogeneous matrix that must be a rigid transform.
fn rigid(argument: &str, m: &Matrix4<f64>) -> PyResult<Isometry3<f64>> {
    let rotation: Matrix3<f64> = m.fixed_view::<3, 3>(0, 0).into_owned();
    let translation = Vector3::new(m[(0, 3)], m[(1, 3)], m[(2, 3)]);
    let orthonormal = (rotation.transpose() * rotation - Matrix3::identity()).norm();
    let bottom =
        [m[(3, 0)], m[(3, 1)], m[(3, 2)], m[(3, 3)] - 1.0].iter().map(|x| x.abs()).fold(0.0, f64::max);
    let finite = m.iter().all(|x| x.is_finite());
    if !finite
        || orthonormal > ROTATION_TOLERANCE
        || rotation.determinant() < 0.0
        || bottom > ROTATION_TOLERANCE
    {
        return Err(MirrorPostureError::new_err(format!(
            "{argument}: got a (4, 4) matrix that is not a rigid transform (determinant {:.6}, distance from orthonormal {orthonormal:.2e}); \
             needed a rotation of determinant +1, a finite translation and the last row 0 0 0 1",
            rotation.determinant()
        )));
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    Ok(Isometry3::from_parts(Translation3::from(translation), rotation))
}
