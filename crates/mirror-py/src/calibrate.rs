//! Bindings of `mirror_core::calibrate`.

use crate::arrays::{
    Array2Like, ArrayDynLike, isometry, pose_covariance, reshaped, row_major, shape_error, stacked,
};
use crate::camera::PyCamera;
use crate::errors::{MirrorPostureError, to_py};
use crate::mirror::Reasons;
use crate::work::Work;
use mirror_core::calibrate::{
    CameraBoardCalibration, MirrorViewOptions, Motion, SecondCameraCalibration, SecondCameraRig,
    SecondCameraSnapshot, WeakDirection, Weakness, calibrate_from_mirror_views, calibrate_with_second_camera,
};
use mirror_core::mirror::{Board, BoardView, GlassPane, Loss, MirrorOptics, view_from_row};
use mirror_core::{Cancel, Error, Result};
use nalgebra::SMatrix;
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;

fn matrix<'py, const R: usize, const C: usize>(
    py: Python<'py>,
    m: &SMatrix<f64, R, C>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    reshaped(py, row_major(m).collect(), [R, C])
}

fn stack<'py, const R: usize, const C: usize>(
    py: Python<'py>,
    all: impl ExactSizeIterator<Item = SMatrix<f64, R, C>>,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let count = all.len();
    let numbers = all.flat_map(|m| row_major(&m).collect::<Vec<_>>()).collect();
    reshaped(py, numbers, [count, R, C])
}

/// A direction in words and numbers: text, "rotation" or "translation", axis in the board frame, standard deviation.
type Direction = (String, &'static str, [f64; 3], f64);

fn direction(weak: &WeakDirection) -> Direction {
    let motion = match weak.motion {
        Motion::Rotation => "rotation",
        Motion::Translation => "translation",
    };
    (weak.to_string(), motion, weak.axis_in_board.into(), weak.std)
}

/// The worst-known translation and rotation, which of them is too weak, the warning.
type WeaknessParts = (Direction, Direction, Option<Direction>, Option<String>);

fn weakness(weakness: &Weakness) -> WeaknessParts {
    (
        direction(&weakness.translation),
        direction(&weakness.rotation),
        weakness.weak_direction().as_ref().map(direction),
        weakness.warning(),
    )
}

/// See `mirror_posture.calibrate.CameraBoardCalibration`.
#[pyclass(name = "CameraBoardCalibration", module = "mirror_posture._core", frozen)]
pub struct PyCameraBoardCalibration {
    inner: CameraBoardCalibration,
    /// Row of each view that was given to the core.
    rows: Vec<usize>,
    /// Rows that could not even be read as views of the board.
    unread: Reasons,
}

#[pymethods]
impl PyCameraBoardCalibration {
    #[getter]
    fn camera_from_board<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, &self.inner.camera_from_board.to_homogeneous())
    }

    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, &self.inner.covariance)
    }

    #[getter]
    fn weakness(&self) -> WeaknessParts {
        weakness(&self.inner.weakness)
    }

    #[getter]
    fn views<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_vec(py, self.inner.views.iter().map(|v| self.rows[*v] as i64).collect())
    }

    #[getter]
    fn reasons(&self) -> Reasons {
        let mut all = self.unread.clone();
        all.extend(self.inner.refused.iter().map(|r| (self.rows[r.view], r.reason.to_string())));
        all
    }

    #[getter]
    fn normals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let numbers =
            self.inner.planes.iter().flat_map(|p| <[f64; 3]>::from(p.normal().into_inner())).collect();
        reshaped(py, numbers, [self.inner.planes.len(), 3])
    }

    #[getter]
    fn offsets_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.inner.planes.iter().map(|p| p.offset_m()).collect())
    }

    #[getter]
    fn plane_covariances_m2<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        stack(py, self.inner.plane_covariances_m2.iter().copied())
    }

    #[getter]
    fn reprojection_mean_px(&self) -> f64 {
        self.inner.reprojection_mean_px
    }

    #[getter]
    fn view_rms_px<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.inner.view_rms_px.clone())
    }

    #[getter]
    fn corner_std_px(&self) -> f64 {
        self.inner.corner_std_px
    }

    #[getter]
    fn determined(&self) -> bool {
        self.inner.determined
    }
}

/// Corners `(V, nx * ny, 2)` px, pairs of NaN where a corner was not seen.
#[pyfunction]
#[pyo3(signature = (camera, corners, square_m, corners_px, corner_std_px, loss, nominal_camera_from_board, nominal_covariance, gate_px, glass_thickness_m, refractive_index))]
pub fn calibrate_mirror_views(
    py: Python<'_>,
    camera: &PyCamera,
    corners: (usize, usize),
    square_m: f64,
    corners_px: ArrayDynLike<'_>,
    corner_std_px: Option<f64>,
    loss: &str,
    nominal_camera_from_board: Option<Array2Like<'_>>,
    nominal_covariance: Option<Array2Like<'_>>,
    gate_px: f64,
    glass_thickness_m: f64,
    refractive_index: f64,
) -> PyResult<PyCameraBoardCalibration> {
    let board = Board::new(corners, square_m).map_err(to_py)?;
    let prior = match (nominal_camera_from_board, nominal_covariance) {
        (Some(nominal), Some(covariance)) => Some((
            isometry("nominal_camera_from_board", &nominal)?,
            pose_covariance("nominal_covariance", &covariance)?,
        )),
        (None, None) => None,
        (nominal, _) => {
            let (got, needed) = if nominal.is_some() { (1, 2) } else { (0, 2) };
            let what =
                "prior: nominal_camera_from_board and nominal_covariance go together; given of them".into();
            return Err(to_py(Error::LengthMismatch { what, got, needed }));
        }
    };
    let pane = GlassPane::new(glass_thickness_m, refractive_index).map_err(to_py)?;
    let cancel = Cancel::new();
    let options = MirrorViewOptions {
        cancel: cancel.clone(),
        optics: MirrorOptics::of_glass(pane),
        corner_std_px,
        loss: Loss::from_name(loss).map_err(to_py)?,
        prior,
        gate_px,
    };
    let width = 2 * board.corner_count();
    let (_, pixels) = stacked("corners_px", &corners_px, &[board.corner_count(), 2])?;
    let camera = camera.inner.as_ref();
    let (mut views, mut rows, mut unread) = (Vec::new(), Vec::new(), Reasons::new());
    for (row, numbers) in pixels.chunks_exact(width).enumerate() {
        match view_from_row(&board, numbers) {
            Ok(view) => {
                views.push(view);
                rows.push(row);
            }
            Err(error) => {
                unread.insert(row, error.to_string());
            }
        }
    }
    if let (true, Some((row, reason))) = (views.is_empty(), unread.iter().next()) {
        return Err(MirrorPostureError::new_err(format!("view {row}: {reason}")));
    }
    let inner = py
        .work_until(&cancel, || calibrate_from_mirror_views(camera, &board, &views, &options))?
        .map_err(|error| to_py(error.of_rows(&rows)))?;
    Ok(PyCameraBoardCalibration { inner, rows, unread })
}

/// See `mirror_posture.calibrate.SecondCameraCalibration`.
#[pyclass(name = "SecondCameraCalibration", module = "mirror_posture._core", frozen)]
pub struct PySecondCameraCalibration {
    inner: SecondCameraCalibration,
}

#[pymethods]
impl PySecondCameraCalibration {
    #[getter]
    fn camera_from_board<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, &self.inner.camera_from_board.to_homogeneous())
    }

    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, &self.inner.covariance)
    }

    #[getter]
    fn weakness(&self) -> WeaknessParts {
        weakness(&self.inner.weakness)
    }

    #[getter]
    fn chi_squared(&self) -> f64 {
        self.inner.chi_squared
    }

    #[getter]
    fn degrees_of_freedom(&self) -> usize {
        self.inner.degrees_of_freedom
    }

    #[getter]
    fn snapshot_camera_from_board<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        stack(py, self.inner.snapshots.iter().map(|s| s.camera_from_board.to_homogeneous()))
    }

    #[getter]
    fn snapshot_covariances<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        stack(py, self.inner.snapshots.iter().map(|s| s.covariance))
    }

    #[getter]
    fn snapshot_chi_squared<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.inner.snapshots.iter().map(|s| s.chi_squared).collect())
    }

    #[getter]
    fn snapshot_rms_px<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.inner.snapshots.iter().map(|s| s.rms_px).collect())
    }
}

/// Corners of each snapshot `(K, n, 2)` px, of the standing board in both cameras and of the chest board in the second.
#[pyfunction]
pub fn calibrate_second_camera(
    py: Python<'_>,
    robot_camera: &PyCamera,
    second_camera: &PyCamera,
    chest_board: (usize, usize, f64),
    stand_board: (usize, usize, f64),
    stand_in_robot_camera_px: ArrayDynLike<'_>,
    stand_in_second_camera_px: ArrayDynLike<'_>,
    chest_in_second_camera_px: ArrayDynLike<'_>,
) -> PyResult<PySecondCameraCalibration> {
    let board = |(nx, ny, square_m): (usize, usize, f64)| Board::new((nx, ny), square_m).map_err(to_py);
    let rig = SecondCameraRig {
        robot_camera: robot_camera.inner.as_ref().clone(),
        second_camera: second_camera.inner.as_ref().clone(),
        chest_board: board(chest_board)?,
        stand_board: board(stand_board)?,
    };
    let views = |name: &str, array: &ArrayDynLike<'_>, board: &Board| -> PyResult<Vec<BoardView>> {
        let (_, pixels) = stacked(name, array, &[board.corner_count(), 2])?;
        let read = |(view, row): (usize, &[f64])| -> Result<BoardView> {
            view_from_row(board, row).map_err(|source| Error::InView { view, source: Box::new(source) })
        };
        pixels
            .chunks_exact(2 * board.corner_count())
            .enumerate()
            .map(read)
            .collect::<Result<_>>()
            .map_err(to_py)
    };
    let in_robot = views("stand_in_robot_camera_px", &stand_in_robot_camera_px, &rig.stand_board)?;
    let in_second = views("stand_in_second_camera_px", &stand_in_second_camera_px, &rig.stand_board)?;
    let chest = views("chest_in_second_camera_px", &chest_in_second_camera_px, &rig.chest_board)?;
    if in_second.len() != in_robot.len() || chest.len() != in_robot.len() {
        let got = [in_robot.len(), in_second.len(), chest.len()];
        return Err(shape_error("snapshots of the three pictures", &got, "the same number of each"));
    }
    let snapshots: Vec<_> = in_robot
        .into_iter()
        .zip(in_second)
        .zip(chest)
        .map(|((stand_in_robot_camera, stand_in_second_camera), chest_in_second_camera)| {
            SecondCameraSnapshot { stand_in_robot_camera, stand_in_second_camera, chest_in_second_camera }
        })
        .collect();
    let cancel = Cancel::new();
    let inner =
        py.work_until(&cancel, || calibrate_with_second_camera(&rig, &snapshots, &cancel))?.map_err(to_py)?;
    Ok(PySecondCameraCalibration { inner })
}
