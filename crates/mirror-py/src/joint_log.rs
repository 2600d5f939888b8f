//! Bindings of `mirror_core::joint_log`.

use crate::arrays::{Array1Like, Array2Like, reshaped, rows_of};
use crate::errors::to_py;
use crate::work::Work;
use mirror_core::joint_log::{JointLog, match_clocks as matched, rests};
use numpy::{PyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// A log of times (N,) and positions (N, J).
fn log(time_s: &Array1Like<'_>, positions: &Array2Like<'_>) -> PyResult<JointLog> {
    let joints = positions.shape()[1];
    let (_, positions) = rows_of("positions", positions, joints, "one position a joint")?;
    JointLog::new(time_s.as_array().to_vec(), positions, joints).map_err(to_py)
}

/// First and last time of each moment of rest, `(R, 2)` s; see `mirror_posture.importing.find_rests`.
#[pyfunction]
pub fn find_rests<'py>(
    py: Python<'py>,
    time_s: Array1Like<'_>,
    positions: Array2Like<'_>,
    tolerance: f64,
    least_s: f64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let log = log(&time_s, &positions)?;
    let found = py.work(|| rests(&log, tolerance, least_s)).map_err(to_py)?;
    let numbers = found.iter().flat_map(|rest| [rest.start_s, rest.end_s]).collect();
    reshaped(py, numbers, [found.len(), 2])
}

/// Offset, s, correlation, and whether it determines the offset; see `mirror_posture.importing.match_clocks`.
#[pyfunction]
pub fn match_clocks(
    py: Python<'_>,
    time_s: Array1Like<'_>,
    positions: Array2Like<'_>,
    picture_s: Array1Like<'_>,
    motion: Array1Like<'_>,
    most_s: f64,
) -> PyResult<(f64, f64, bool)> {
    let log = log(&time_s, &positions)?;
    let (picture_s, motion) = (picture_s.as_array().to_vec(), motion.as_array().to_vec());
    let found = py.work(|| matched(&log, &picture_s, &motion, most_s)).map_err(to_py)?;
    Ok((found.offset_s, found.correlation, found.is_trusted()))
}
