//! Bindings of `mirror_core::view_check`: a session's views as arrays in, what is wrong with them out.

use crate::arrays::{ArrayDynLike, isometries, mask, of_rows};
use crate::camera::PyCamera;
use crate::errors::to_py;
use crate::work::Work;
use mirror_core::Cancel;
use mirror_core::mirror::{Board, GlassPane, MirrorOptics};
use mirror_core::view_check::{Reading, SeenMarker, View, ViewCheck, ViewCheckOptions, Views};
use nalgebra::{Point3, Vector2};
use numpy::{PyArrayLike2, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// Name, words, correction, effect (empty where a diagnosis has none) and factor of a reading.
type ReadingWords = (String, String, String, &'static str, f64);

/// What a check of views found; see `mirror_posture.view_check.ViewCheck`.
#[pyclass(name = "CheckedViews", module = "mirror_posture._core", frozen)]
pub struct PyCheckedViews {
    inner: ViewCheck,
}

#[pymethods]
impl PyCheckedViews {
    #[getter]
    fn board_rms_px(&self) -> f64 {
        self.inner.as_it_stands.board_rms_px
    }

    #[getter]
    fn marker_px(&self) -> Option<f64> {
        self.inner.as_it_stands.marker_px
    }

    #[getter]
    fn noise_px(&self) -> f64 {
        self.inner.noise_px
    }

    #[getter]
    fn mistake(&self) -> &str {
        self.inner.mistake.as_deref().unwrap_or_default()
    }

    #[getter]
    fn readings(&self) -> Vec<ReadingWords> {
        let words = |r: &Reading| {
            let effect = r.effect.unwrap_or_default();
            (r.name.clone(), r.said.clone(), r.fix.clone(), effect, r.scale.factor())
        };
        self.inner.readings.iter().map(words).collect()
    }
}

/// Tests V views of a board of N corners in the mirror, and of M markers beside it.
#[pyfunction]
#[pyo3(signature = (camera, corners, square_m, camera_from_board, board_px, marker_px, marker_seen, marker_in_camera_m,
    glass_thickness_m, refractive_index, noise_px, gross=false))]
pub fn check_views(
    py: Python<'_>,
    camera: &PyCamera,
    corners: (usize, usize),
    square_m: f64,
    camera_from_board: ArrayDynLike<'_>,
    board_px: ArrayDynLike<'_>,
    marker_px: ArrayDynLike<'_>,
    marker_seen: PyArrayLike2<'_, bool>,
    marker_in_camera_m: ArrayDynLike<'_>,
    glass_thickness_m: f64,
    refractive_index: f64,
    noise_px: f64,
    gross: bool,
) -> PyResult<PyCheckedViews> {
    let board = Board::new(corners, square_m).map_err(to_py)?;
    let pane = GlassPane::new(glass_thickness_m, refractive_index).map_err(to_py)?;
    let poses = isometries("camera_from_board", &camera_from_board)?;
    let (count, markers) = (poses.len(), marker_seen.shape()[1]);
    let numbers = 2 * board.corner_count();
    let board_px = of_rows("board_px", &board_px, &[board.corner_count(), 2], count)?;
    let marker_px = of_rows("marker_px", &marker_px, &[markers, 2], count)?;
    let marker_seen = mask("marker_seen", &marker_seen, [count, markers])?;
    let marker_in_camera_m = of_rows("marker_in_camera_m", &marker_in_camera_m, &[markers, 3], count)?;
    let view = |row: usize| {
        let shown = (row * markers..(row + 1) * markers).filter(|&at| marker_seen[at]);
        View {
            camera_from_board: poses[row],
            corners_px: board_px[row * numbers..(row + 1) * numbers].to_vec(),
            markers: shown
                .map(|at| SeenMarker {
                    pixel: Vector2::from_column_slice(&marker_px[2 * at..2 * at + 2]),
                    point_in_camera: Point3::from_slice(&marker_in_camera_m[3 * at..3 * at + 3]),
                })
                .collect(),
        }
    };
    let views = (0..count).map(view).collect();
    let camera = camera.inner.as_ref().clone();
    let cancel = Cancel::new();
    let options = ViewCheckOptions { noise_px, gross, cancel: cancel.clone() };
    let inner = py
        .work_until(&cancel, || {
            let views = Views::new(camera, board, MirrorOptics::of_glass(pane), views)?;
            mirror_core::view_check::check_views(&views, &options)
        })?
        .map_err(to_py)?;
    Ok(PyCheckedViews { inner })
}
