//! Bindings of what pictures of the board are compared with, and of a picture's light without a ghost.

use crate::arrays::shape_error;
use crate::errors::MirrorPostureError;
use crate::work::Work;
use mirror_core::outline::{drawn_pattern as pattern_of, without_ghost};
use nalgebra::Matrix3;
use numpy::{
    PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

/// The board's pattern `(height, width)` from a pixel (u, v) on: 1 and −1 by square, edges averaged over each pixel. `grid_from_px`: rows of the homography from pixels
/// to places on the board, in squares, a corner of four squares at each whole number.
#[pyfunction]
pub fn drawn_pattern<'py>(
    py: Python<'py>,
    grid_from_px: [[f64; 3]; 3],
    first_px: [f64; 2],
    size: (usize, usize),
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let homography = Matrix3::from_fn(|row, column| grid_from_px[row][column]);
    let pattern = py.work(|| pattern_of(&homography, first_px, size));
    PyArray1::from_vec(py, pattern).reshape([size.1, size.0])
}

/// Levels `(height, width, 3)` of the part of a picture from (left, top) to before (right, bottom), without its ghost. `light`, `once`, `twice`: of the picture, and of the
/// picture moved once and twice as far as the ghost lies, each `(H, W, 3)`; `ratio`: of its strength to the rest; `levels`: of light in even steps from 0 to 1.
#[pyfunction]
pub fn levels_without_ghost<'py>(
    py: Python<'py>,
    light: [PyReadonlyArray3<'py, f32>; 3],
    part: [usize; 4],
    ratio: f64,
    levels: PyReadonlyArray1<'py, u8>,
) -> PyResult<Bound<'py, PyArray3<u8>>> {
    let [left, top, right, bottom] = part;
    let shape = light[0].shape();
    let width = shape[1];
    let fits = shape[2] == 3 && left <= right && right <= shape[1] && top <= bottom && bottom <= shape[0];
    if levels.len() == 0 {
        return Err(MirrorPostureError::new_err("levels: got none, needed at least one"));
    }
    if !fits || light.iter().any(|one| one.shape() != shape) {
        return Err(shape_error("light", light[1].shape(), "three of (H, W, 3) that hold the part"));
    }
    let refused = |_| MirrorPostureError::new_err("levels: needed an array in C order");
    let levels = levels.as_slice().map_err(refused)?;
    let [own, once, twice] = &light;
    let light = [own.as_slice(), once.as_slice(), twice.as_slice()];
    let [Ok(own), Ok(once), Ok(twice)] = light else {
        return Err(MirrorPostureError::new_err("light: needed arrays in C order"));
    };
    let result = py.work(|| {
        let mut result = Vec::with_capacity((right - left) * (bottom - top) * 3);
        for row in top..bottom {
            let line = 3 * (row * width + left)..3 * (row * width + right);
            let three = [own, once, twice].map(|values| &values[line.clone()]);
            without_ghost(three, ratio as f32, (1.0 + ratio) as f32, levels, &mut result);
        }
        result
    });
    PyArray1::from_vec(py, result).reshape([bottom - top, right - left, 3])
}
