//! Bindings of `mirror_core::triangulate` and of the virtual rays.

use crate::arrays::{Array1Like, ArrayDynLike, reshaped, shape_error, stacked, triple};
use crate::camera::PyCamera;
use crate::errors::to_py;
use crate::mirror::{PyMirrors, Reasons, numbers, reasons, valid};
use crate::work::Work;
use mirror_core::mirror::{MirrorEstimate, VirtualRay};
use mirror_core::triangulate::{
    MarkerObservation, PointBatch, Triangulated, TriangulationOptions, Triangulator, point_pair_markers,
    triangulate_views,
};
use mirror_core::{Cancel, Error, Result};
use nalgebra::{Matrix6, Point3, SMatrix, Vector2};
use numpy::{AllowTypeChange, PyArray1, PyArray2, PyArray3, PyArrayLikeDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use rayon::prelude::*;

/// Rows of mirrors, by number.
type RowsLike<'py> = PyArrayLikeDyn<'py, i64, AllowTypeChange>;

/// The mirror of a row, or why there is none.
fn mirror_of(mirrors: &PyMirrors, row: i64) -> Result<&MirrorEstimate> {
    let found = usize::try_from(row).ok().and_then(|row| mirrors.rows.get(row));
    let Some(found) = found else {
        return Err(Error::OutOfRange {
            what: "row of a mirror".into(),
            got: row as f64,
            needed: format!("0 to {}", mirrors.rows.len().saturating_sub(1)),
        });
    };
    found.as_ref().map_err(Clone::clone)
}

/// Refuses a noise that would make every row fail.
fn checked_noise(noise_px: f64) -> PyResult<()> {
    if noise_px > 0.0 && noise_px.is_finite() {
        return Ok(());
    }
    Err(to_py(Error::OutOfRange {
        what: "noise of a marker's pixel (px)".into(),
        got: noise_px,
        needed: "a number above 0".into(),
    }))
}

/// Virtual rays, row by row; see `mirror_posture.mirror.VirtualRays`.
#[pyclass(name = "VirtualRays", module = "mirror_posture._core", frozen)]
pub struct PyVirtualRays {
    rows: Vec<Result<VirtualRay>>,
    shared: Matrix6<f64>,
}

#[pymethods]
impl PyVirtualRays {
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
    fn origins_m<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        reshaped(py, numbers(&self.rows, |r| r.ray.origin.coords), [self.rows.len(), 3])
    }

    #[getter]
    fn directions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        reshaped(py, numbers(&self.rows, |r| r.ray.direction.into_inner()), [self.rows.len(), 3])
    }

    #[getter]
    fn covariances<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        reshaped(py, numbers(&self.rows, |r| r.covariance(&self.shared)), [self.rows.len(), 6, 6])
    }
}

/// Marker positions, row by row; see `mirror_posture.triangulate.MarkerPositions`.
#[pyclass(name = "Markers", module = "mirror_posture._core", frozen)]
pub struct PyMarkers {
    rows: Vec<Result<Triangulated>>,
}

impl PyMarkers {
    fn scalars<'py>(&self, py: Python<'py>, get: impl Fn(&Triangulated) -> f64) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, numbers(&self.rows, |m| SMatrix::<f64, 1, 1>::new(get(m))))
    }
}

#[pymethods]
impl PyMarkers {
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
    fn points_in_camera_m<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        reshaped(py, numbers(&self.rows, |m| m.point_in_camera.coords), [self.rows.len(), 3])
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
    fn point_by_camera_from_board<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        reshaped(py, numbers(&self.rows, |m| m.point_by_camera_from_board), [self.rows.len(), 3, 6])
    }

    #[getter]
    fn parallax_rad<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.scalars(py, |m| m.parallax_rad)
    }

    #[getter]
    fn rms_ray_distance_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.scalars(py, |m| m.rms_ray_distance_m)
    }

    #[getter]
    fn rms_px<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.scalars(py, |m| m.pixel_fit.map_or(f64::NAN, |f| f.rms_px))
    }

    #[getter]
    fn chi_squared<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.scalars(py, |m| m.pixel_fit.map_or(f64::NAN, |f| f.chi_squared))
    }
}

/// Virtual rays of pixels `(M, 2)`, each in the mirror of a row `(M,)`.
#[pyfunction]
pub fn virtual_rays(
    py: Python<'_>,
    mirrors: &PyMirrors,
    mirror_rows: RowsLike<'_>,
    pixels_px: ArrayDynLike<'_>,
    noise_px: f64,
) -> PyResult<PyVirtualRays> {
    checked_noise(noise_px)?;
    let (count, pixels) = stacked("pixels_px", &pixels_px, &[2])?;
    if mirror_rows.shape() != [count] {
        return Err(shape_error("mirror_rows", mirror_rows.shape(), &format!("({count},), as pixels_px")));
    }
    let numbers: Vec<i64> = mirror_rows.as_array().iter().copied().collect();
    let cancel = Cancel::new();
    let ray = |(row, pixel): (&i64, &[f64])| {
        cancel.check()?;
        let pixel = Vector2::new(pixel[0], pixel[1]);
        mirror_of(mirrors, *row)?.virtual_camera().ray(&mirrors.rig.camera, &pixel, noise_px)
    };
    let rows =
        py.work_on(count, &cancel, || numbers.iter().zip(pixels.chunks_exact(2)).map(ray).collect())?;
    let shared = mirrors.rig.camera_from_board_covariance.unwrap_or_else(Matrix6::zeros);
    Ok(PyVirtualRays { rows, shared })
}

/// Markers from pixels `(M, V, 2)` in the mirrors of rows `(M, V)`; a negative row is a view that did not see it.
#[pyfunction]
#[pyo3(signature = (mirrors, mirror_rows, pixels_px, noise_px, triangulator="maximum_likelihood", least_parallax_rad=None))]
pub fn triangulate(
    py: Python<'_>,
    mirrors: &PyMirrors,
    mirror_rows: RowsLike<'_>,
    pixels_px: ArrayDynLike<'_>,
    noise_px: f64,
    triangulator: &str,
    least_parallax_rad: Option<f64>,
) -> PyResult<PyMarkers> {
    let triangulator = Triangulator::from_name(triangulator).map_err(to_py)?;
    let shape = mirror_rows.shape();
    if shape.len() != 2 {
        return Err(shape_error("mirror_rows", shape, "(M, V)"));
    }
    let views = shape[1];
    let (count, pixels) = stacked("pixels_px", &pixels_px, &[views, 2])?;
    if shape[0] != count {
        return Err(shape_error("mirror_rows", shape, &format!("({count}, {views}), as pixels_px")));
    }
    let mut options = TriangulationOptions {
        camera_from_board_covariance: mirrors.rig.camera_from_board_covariance,
        ..TriangulationOptions::default()
    };
    options.least_parallax_rad = least_parallax_rad.unwrap_or(options.least_parallax_rad);
    let options = options.validated().map_err(to_py)?;
    checked_noise(noise_px)?;
    let numbers: Vec<i64> = mirror_rows.as_array().iter().copied().collect();
    let cancel = Cancel::new();
    let observations = (0..count).into_par_iter().map(|marker| {
        cancel.check()?;
        let mut seen = Vec::with_capacity(views);
        for view in (marker * views)..((marker + 1) * views) {
            if numbers[view] >= 0 {
                let mirror = mirror_of(mirrors, numbers[view])?;
                let pixel = Vector2::new(pixels[2 * view], pixels[2 * view + 1]);
                seen.push(MarkerObservation { mirror, pixel, noise_px });
            }
        }
        triangulate_views(triangulator, &mirrors.rig.camera, &seen, &options)
    });
    let rows = py.work_on(count, &cancel, || observations.collect())?;
    Ok(PyMarkers { rows })
}

/// Points of a batch; see `mirror_posture.triangulate.two_view_markers`.
#[pyclass(name = "PointBatch", module = "mirror_posture._core", frozen)]
pub struct PyPointBatch {
    inner: PointBatch,
}

#[pymethods]
impl PyPointBatch {
    #[getter]
    fn valid<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        let mut valid = vec![true; self.inner.points_m.len()];
        for refused in &self.inner.refused {
            valid[refused.row] = false;
        }
        PyArray1::from_vec(py, valid)
    }

    #[getter]
    fn reasons(&self) -> Reasons {
        self.inner.refused.iter().map(|r| (r.row, r.error.to_string())).collect()
    }

    #[getter]
    fn points_in_camera_m<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        reshaped(py, self.inner.points_m.as_flattened().to_vec(), [self.inner.points_m.len(), 3])
    }
}

/// The paper's measurement in bulk: Eq. 2 twice, two virtual rays, their midpoint; `(N, 2, 3)` m and `(N, 2, 2)` px.
#[pyfunction]
#[pyo3(signature = (camera, board_in_camera_m, reflected_boards_m, pixels_px, least_parallax_rad=None))]
pub fn two_view_markers(
    py: Python<'_>,
    camera: &PyCamera,
    board_in_camera_m: Array1Like<'_>,
    reflected_boards_m: ArrayDynLike<'_>,
    pixels_px: ArrayDynLike<'_>,
    least_parallax_rad: Option<f64>,
) -> PyResult<PyPointBatch> {
    let board = Point3::from(triple("board_in_camera_m", &board_in_camera_m)?);
    let (count, boards) = stacked("reflected_boards_m", &reflected_boards_m, &[2, 3])?;
    let (_, pixels) = stacked("pixels_px", &pixels_px, &[2, 2])?;
    let mut options = TriangulationOptions::default();
    options.least_parallax_rad = least_parallax_rad.unwrap_or(options.least_parallax_rad);
    let least = options.validated().map_err(to_py)?.least_parallax_rad;
    let cancel = Cancel::new();
    let inner = py
        .work_on(count, &cancel, || {
            let (boards, _) = boards.as_chunks::<6>();
            let (pixels, _) = pixels.as_chunks::<4>();
            point_pair_markers(&camera.inner, &board, boards, pixels, least, &cancel)
        })?
        .map_err(to_py)?;
    Ok(PyPointBatch { inner })
}
