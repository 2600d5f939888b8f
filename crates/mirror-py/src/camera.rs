//! Bindings of `mirror_core::camera`.

use crate::arrays::{Array2Like, pairs, reshaped, triples};
use crate::errors::to_py;
use mirror_core::camera::{Camera, Distortion};
use mirror_core::{Error, Result};
use nalgebra::{Point3, Vector2};
use numpy::PyArray2;
use pyo3::prelude::*;
use std::sync::Arc;

/// A camera with lens distortion; see `mirror_posture.Camera`.
#[pyclass(name = "Camera", module = "mirror_posture._core", frozen)]
pub struct PyCamera {
    /// The core's camera, shared with everything that is built on it.
    pub inner: Arc<Camera>,
}

/// A lens by its model's name.
///
/// # Errors
/// [`Error::UnknownName`] for a model that is not supported, [`Error::LengthMismatch`] for a wrong number of coefficients.
pub(crate) fn lens(model: &str, coefficients: &[f64]) -> Result<Distortion> {
    let of_length = |needed: usize| Error::LengthMismatch {
        what: format!("coefficients of a {model} lens"),
        got: coefficients.len(),
        needed,
    };
    match model {
        "none" => {
            if coefficients.iter().all(|k| *k == 0.0) {
                Ok(Distortion::None)
            } else {
                Err(of_length(0))
            }
        }
        "plumb_bob" => {
            if coefficients.is_empty() || coefficients == [0.0; 5] {
                return Ok(Distortion::None);
            }
            coefficients.try_into().map(Distortion::PlumbBob).map_err(|_| of_length(5))
        }
        "rational_polynomial" => {
            coefficients.try_into().map(Distortion::RationalPolynomial).map_err(|_| of_length(8))
        }
        "equidistant" => coefficients.try_into().map(Distortion::Equidistant).map_err(|_| of_length(4)),
        _ => Err(Error::UnknownName {
            what: "lens model",
            got: model.to_owned(),
            valid: "none, plumb_bob, rational_polynomial, equidistant".to_owned(),
        }),
    }
}

#[pymethods]
impl PyCamera {
    #[new]
    #[pyo3(signature = (size_px, focal_px, center_px, distortion_model="none", distortion=Vec::new()))]
    fn new(
        size_px: (u32, u32),
        focal_px: (f64, f64),
        center_px: (f64, f64),
        distortion_model: &str,
        distortion: Vec<f64>,
    ) -> PyResult<Self> {
        let lens = lens(distortion_model, &distortion).map_err(to_py)?;
        let focal = Vector2::new(focal_px.0, focal_px.1);
        let center = Vector2::new(center_px.0, center_px.1);
        let camera = Camera::new(size_px, focal, center, lens).map_err(to_py)?;
        Ok(Self { inner: Arc::new(camera) })
    }

    #[getter]
    fn size_px(&self) -> (u32, u32) {
        self.inner.size_px()
    }

    #[getter]
    fn focal_px(&self) -> (f64, f64) {
        let f = self.inner.focal_px();
        (f.x, f.y)
    }

    #[getter]
    fn center_px(&self) -> (f64, f64) {
        let c = self.inner.center_px();
        (c.x, c.y)
    }

    /// Coefficients k1 k2 p1 p2 k3 k4 k5 k6, of an equidistant lens k1 k2 k3 k4 and zeros.
    #[getter]
    fn distortion(&self) -> Vec<f64> {
        self.inner.distortion().coefficients().to_vec()
    }

    /// Pixels `(N, 2)` of points `(N, 3)` in the camera frame.
    fn project<'py>(
        &self,
        py: Python<'py>,
        points_in_camera_m: Array2Like<'py>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let points = triples("points_in_camera_m", &points_in_camera_m)?;
        let camera = &self.inner;
        let pixels = py
            .detach(|| points.iter().map(|p| camera.project(&Point3::from(*p))).collect::<Result<Vec<_>>>())
            .map_err(to_py)?;
        reshaped(py, pixels.iter().flat_map(|p| [p.x, p.y]).collect(), [pixels.len(), 2])
    }

    /// Unit directions `(N, 3)` of the rays of pixels `(N, 2)`.
    fn unproject<'py>(
        &self,
        py: Python<'py>,
        pixels_px: Array2Like<'py>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let pixels = pairs("pixels_px", &pixels_px)?;
        let camera = &self.inner;
        let rays = py
            .detach(|| pixels.iter().map(|p| camera.unproject(p)).collect::<Result<Vec<_>>>())
            .map_err(to_py)?;
        reshaped(py, rays.iter().flat_map(|r| [r.x, r.y, r.z]).collect(), [rays.len(), 3])
    }
}
