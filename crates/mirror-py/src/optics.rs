//! Bindings of the forward optics in `mirror_core::mirror`: what a camera sees in real mirrors, and of balls.

use crate::arrays::{Array1Like, Array2Like, pairs, reshaped, shape_error, triples};
use crate::camera::PyCamera;
use crate::errors::to_py;
use crate::mirror::{Reasons, numbers, reasons, valid};
use crate::work::Work;
use mirror_core::geometry::Plane;
use mirror_core::mirror::{Curvature, GlassPane, MirrorOptics, SeenPixel, Sphere};
use mirror_core::{Cancel, Result};
use nalgebra::{Point3, Vector2, Vector3};
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;
use rayon::prelude::*;

/// Fewer rows than this a thread are not worth handing out.
const SMALLEST_SHARE: usize = 256;

/// Pixels of points seen in mirrors, row by row; see `mirror_posture.optics.SeenInMirror`.
#[pyclass(name = "SeenInMirror", module = "mirror_posture._core", frozen)]
pub struct PySeenInMirror {
    rows: Vec<Result<SeenPixel>>,
}

#[pymethods]
impl PySeenInMirror {
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
    fn pixels_px<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        reshaped(py, numbers(&self.rows, |s| s.pixel), [self.rows.len(), 2])
    }

    #[getter]
    fn by_point<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        reshaped(py, numbers(&self.rows, |s| s.by_point), [self.rows.len(), 2, 3])
    }

    #[getter]
    fn by_foot_point<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        reshaped(py, numbers(&self.rows, |s| s.by_foot_point), [self.rows.len(), 2, 3])
    }

    #[getter]
    fn by_thickness<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        reshaped(py, numbers(&self.rows, |s| s.by_thickness), [self.rows.len(), 2])
    }

    #[getter]
    fn by_curvature<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        reshaped(py, numbers(&self.rows, |s| s.by_curvature), [self.rows.len(), 2])
    }
}

/// Row `i` of points by row `i` of mirrors; one mirror serves all points.
#[pyfunction]
pub fn see_in_mirror(
    py: Python<'_>,
    camera: &PyCamera,
    foot_points_m: Array2Like<'_>,
    points_in_camera_m: Array2Like<'_>,
    glass_thickness_m: f64,
    refractive_index: f64,
    curvature_per_m: f64,
) -> PyResult<PySeenInMirror> {
    let feet = triples("foot_points_m", &foot_points_m)?;
    let points = triples("points_in_camera_m", &points_in_camera_m)?;
    if feet.len() != points.len() && feet.len() != 1 {
        let needed = format!("(1, 3) or ({}, 3), one mirror a point", points.len());
        return Err(shape_error("foot_points_m", &[feet.len(), 3], &needed));
    }
    let optics = MirrorOptics {
        pane: GlassPane::new(glass_thickness_m, refractive_index).map_err(to_py)?,
        curvature: Curvature::new(curvature_per_m).map_err(to_py)?,
    };
    let camera = camera.inner.as_ref();
    let cancel = Cancel::new();
    let see = |(row, point): (usize, &Vector3<f64>)| {
        cancel.check()?;
        let foot = feet.get(row).unwrap_or(&feet[0]);
        let plane = Plane::from_foot_point(foot)?;
        optics.project_with_jacobians(camera, &plane, &Point3::from(*point))
    };
    let rows = py.work_on(points.len(), &cancel, || {
        points.par_iter().enumerate().with_min_len(SMALLEST_SHARE).map(see).collect::<Vec<_>>()
    })?;
    Ok(PySeenInMirror { rows })
}

/// Numbers, `valid` and `reasons` of a batch of pixels.
type PixelRows<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<bool>>, Reasons);

fn pixel_rows<'py>(py: Python<'py>, rows: &[Result<Vector2<f64>>]) -> PyResult<PixelRows<'py>> {
    Ok((reshaped(py, numbers(rows, |p| *p), [rows.len(), 2])?, valid(py, rows), reasons(rows)))
}

/// Centroids of balls' pictures, px.
#[pyfunction]
pub fn ball_centroids<'py>(
    py: Python<'py>,
    camera: &PyCamera,
    centers_in_camera_m: Array2Like<'py>,
    diameter_m: f64,
) -> PyResult<PixelRows<'py>> {
    let centers = triples("centers_in_camera_m", &centers_in_camera_m)?;
    let ball = Sphere::of_diameter_m(diameter_m).map_err(to_py)?;
    let camera = camera.inner.as_ref();
    let cancel = Cancel::new();
    let see = |center: &Vector3<f64>| {
        cancel.check()?;
        ball.project(camera, &Point3::from(*center))
    };
    let rows: Vec<_> = py.work_on(centers.len(), &cancel, || {
        centers.par_iter().with_min_len(SMALLEST_SHARE).map(see).collect()
    })?;
    pixel_rows(py, &rows)
}

/// From the centroids of balls' pictures to the pictures of their centres, px.
#[pyfunction]
pub fn ball_center_pixels<'py>(
    py: Python<'py>,
    camera: &PyCamera,
    centroids_px: Array2Like<'py>,
    diameter_m: f64,
    distances_m: Array1Like<'py>,
) -> PyResult<PixelRows<'py>> {
    let centroids = pairs("centroids_px", &centroids_px)?;
    let distances: Vec<f64> = distances_m.as_array().iter().copied().collect();
    if distances.len() != centroids.len() {
        return Err(shape_error("distances_m", &[distances.len()], &format!("({},)", centroids.len())));
    }
    let ball = Sphere::of_diameter_m(diameter_m).map_err(to_py)?;
    let camera = camera.inner.as_ref();
    let cancel = Cancel::new();
    let correct = |(centroid, distance): (&Vector2<f64>, &f64)| {
        cancel.check()?;
        ball.center_pixel(camera, centroid, *distance)
    };
    let rows: Vec<_> = py.work_on(centroids.len(), &cancel, || {
        centroids.par_iter().zip(&distances).with_min_len(SMALLEST_SHARE).map(correct).collect()
    })?;
    pixel_rows(py, &rows)
}
