//! Bindings of `mirror_core::mirror`.

use crate::arrays::{Array2Like, ArrayDynLike, isometry, pose_covariance, reshaped, row_major, stacked};
use crate::camera::PyCamera;
use crate::errors::to_py;
use crate::work::Work;
use mirror_core::mirror::{
    Board, EstimatorOptions, GlassPane, Loss, MirrorEstimate, MirrorEstimator, MirrorOptics, PlanarPose, Rig,
    estimate_rows, planar_pose_rows,
};
use mirror_core::{Cancel, Result};
use nalgebra::SMatrix;
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Why rows have no result, row to message.
pub type Reasons = BTreeMap<usize, String>;

/// The messages of the refused rows.
pub fn reasons<T>(rows: &[Result<T>]) -> Reasons {
    let refused = |(row, result): (usize, &Result<T>)| result.as_ref().err().map(|e| (row, e.to_string()));
    rows.iter().enumerate().filter_map(refused).collect()
}

/// A column of `(N, R, C)` or, flattened by the caller, smaller shapes: refused rows are not numbers.
pub fn numbers<T, const R: usize, const C: usize>(
    rows: &[Result<T>],
    get: impl Fn(&T) -> SMatrix<f64, R, C>,
) -> Vec<f64> {
    let mut out = Vec::with_capacity(rows.len() * R * C);
    for row in rows {
        let matrix = row.as_ref().map_or(SMatrix::repeat(f64::NAN), &get);
        out.extend(row_major(&matrix));
    }
    out
}

/// Which rows have a result.
pub fn valid<'py, T>(py: Python<'py>, rows: &[Result<T>]) -> Bound<'py, PyArray1<bool>> {
    PyArray1::from_vec(py, rows.iter().map(Result::is_ok).collect())
}

fn options(noise_px: Option<f64>, loss: &str) -> PyResult<EstimatorOptions> {
    let loss = Loss::from_name(loss).map_err(to_py)?;
    EstimatorOptions { noise_px, loss, ..EstimatorOptions::default() }.validated().map_err(to_py)
}

/// Camera, board and how they are fixed to each other; see `mirror_posture.mirror.Rig`.
#[pyclass(name = "Rig", module = "mirror_posture._core", frozen)]
pub struct PyRig {
    /// The core's rig, shared with the mirrors that are estimated with it.
    pub inner: Arc<Rig>,
}

#[pymethods]
impl PyRig {
    #[new]
    #[pyo3(signature = (camera, corners, square_m, camera_from_board, camera_from_board_covariance=None, glass_thickness_m=0.0, refractive_index=GlassPane::FLOAT_GLASS_INDEX))]
    fn new(
        camera: &PyCamera,
        corners: (usize, usize),
        square_m: f64,
        camera_from_board: Array2Like<'_>,
        camera_from_board_covariance: Option<Array2Like<'_>>,
        glass_thickness_m: f64,
        refractive_index: f64,
    ) -> PyResult<Self> {
        let board = Board::new(corners, square_m).map_err(to_py)?;
        let pane = GlassPane::new(glass_thickness_m, refractive_index).map_err(to_py)?;
        let camera_from_board = isometry("camera_from_board", &camera_from_board)?;
        let mut rig = Rig::new(camera.inner.as_ref().clone(), board, camera_from_board)
            .with_optics(MirrorOptics::of_glass(pane));
        if let Some(covariance) = camera_from_board_covariance {
            let covariance = pose_covariance("camera_from_board_covariance", &covariance)?;
            rig = rig.with_covariance(covariance).map_err(to_py)?;
        }
        Ok(Self { inner: Arc::new(rig) })
    }

    /// The mirrors of views, corners `(N, nx * ny, 2)` px, pairs of NaN where a corner was not seen.
    #[pyo3(signature = (corners_px, estimator="maximum_likelihood", noise_px=None, loss="squared"))]
    fn estimate_mirrors(
        &self,
        py: Python<'_>,
        corners_px: ArrayDynLike<'_>,
        estimator: &str,
        noise_px: Option<f64>,
        loss: &str,
    ) -> PyResult<PyMirrors> {
        let estimator = MirrorEstimator::from_name(estimator).map_err(to_py)?;
        let options = options(noise_px, loss)?;
        let (count, pixels) = stacked("corners_px", &corners_px, &[self.inner.board.corner_count(), 2])?;
        let cancel = Cancel::new();
        let rows =
            py.work_on(count, &cancel, || estimate_rows(estimator, &self.inner, &pixels, &options, &cancel))?;
        Ok(PyMirrors { rig: self.inner.clone(), rows })
    }
}

/// Mirrors of views, row by row; see `mirror_posture.mirror.MirrorEstimates`.
#[pyclass(name = "Mirrors", module = "mirror_posture._core", frozen)]
pub struct PyMirrors {
    /// The rig with which they were estimated.
    pub rig: Arc<Rig>,
    /// One result a view.
    pub rows: Vec<Result<MirrorEstimate>>,
}

#[pymethods]
impl PyMirrors {
    fn __len__(&self) -> usize {
        self.rows.len()
    }

    #[getter]
    fn valid<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        valid(py, &self.rows)
    }

    #[getter]
    fn reasons(&self) -> Reasons {
        reasons(&self.rows)
    }

    #[getter]
    fn normals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        reshaped(py, numbers(&self.rows, |m| m.plane.normal().into_inner()), [self.rows.len(), 3])
    }

    #[getter]
    fn offsets_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, numbers(&self.rows, |m| SMatrix::<f64, 1, 1>::new(m.plane.offset_m())))
    }

    #[getter]
    fn covariances_m2<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        reshaped(py, numbers(&self.rows, |m| m.covariance_m2), [self.rows.len(), 3, 3])
    }

    #[getter]
    fn measurement_covariances_m2<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        reshaped(py, numbers(&self.rows, |m| m.measurement_covariance_m2), [self.rows.len(), 3, 3])
    }

    #[getter]
    fn foot_by_camera_from_board<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        reshaped(py, numbers(&self.rows, |m| m.foot_by_camera_from_board), [self.rows.len(), 3, 6])
    }

    /// From virtual to real camera, `(N, 4, 4)`: Eq. 1's improper map, or the reflection across the plane.
    #[getter]
    fn camera_from_virtual<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let map = |m: &MirrorEstimate| match &m.improper {
            Some(improper) => improper.map.to_homogeneous(),
            None => mirror_core::geometry::Reflection::across(m.plane).to_improper().to_homogeneous(),
        };
        reshaped(py, numbers(&self.rows, map), [self.rows.len(), 4, 4])
    }

    #[getter]
    fn rms_px<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, numbers(&self.rows, |m| SMatrix::<f64, 1, 1>::new(m.rms_px)))
    }

    #[getter]
    fn noise_px<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, numbers(&self.rows, |m| SMatrix::<f64, 1, 1>::new(m.noise_px)))
    }
}

/// Poses of a flat board, row by row; see `mirror_posture.mirror.PlanarPoses`.
#[pyclass(name = "PlanarPoses", module = "mirror_posture._core", frozen)]
pub struct PyPlanarPoses {
    rows: Vec<Result<PlanarPose>>,
}

#[pymethods]
impl PyPlanarPoses {
    fn __len__(&self) -> usize {
        self.rows.len()
    }

    #[getter]
    fn valid<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        valid(py, &self.rows)
    }

    #[getter]
    fn reasons(&self) -> Reasons {
        reasons(&self.rows)
    }

    #[getter]
    fn camera_from_pattern<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let poses = numbers(&self.rows, |p| p.camera_from_pattern.to_homogeneous());
        reshaped(py, poses, [self.rows.len(), 4, 4])
    }

    #[getter]
    fn covariances<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        reshaped(py, numbers(&self.rows, |p| p.covariance), [self.rows.len(), 6, 6])
    }

    #[getter]
    fn rms_px<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, numbers(&self.rows, |p| SMatrix::<f64, 1, 1>::new(p.rms_px)))
    }

    #[getter]
    fn noise_px<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, numbers(&self.rows, |p| SMatrix::<f64, 1, 1>::new(p.noise_px)))
    }

    /// Residual of the other pose that explains the view, px; infinite where there is none.
    #[getter]
    fn alternative_rms_px<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let other = |p: &PlanarPose| p.alternative.as_ref().map_or(f64::INFINITY, |a| a.rms_px);
        PyArray1::from_vec(py, numbers(&self.rows, |p| SMatrix::<f64, 1, 1>::new(other(p))))
    }
}

/// Poses of a board from its corners `(N, nx * ny, 2)` px, pairs of NaN where a corner was not seen.
#[pyfunction]
#[pyo3(signature = (camera, corners, square_m, corners_px, noise_px=None, loss="squared"))]
pub fn planar_poses(
    py: Python<'_>,
    camera: &PyCamera,
    corners: (usize, usize),
    square_m: f64,
    corners_px: ArrayDynLike<'_>,
    noise_px: Option<f64>,
    loss: &str,
) -> PyResult<PyPlanarPoses> {
    let board = Board::new(corners, square_m).map_err(to_py)?;
    let options = options(noise_px, loss)?;
    let (count, pixels) = stacked("corners_px", &corners_px, &[board.corner_count(), 2])?;
    let cancel = Cancel::new();
    let rows =
        py.work_on(count, &cancel, || planar_pose_rows(&camera.inner, &board, &pixels, &options, &cancel))?;
    Ok(PyPlanarPoses { rows })
}
