//! Bindings of `mirror_core::measure` and `mirror_core::joint`: a session's arrays in, mirrors and markers out.

use crate::arrays::{
    Array2Like, ArrayDynLike, isometries, mask, of_rows, pose_covariance, reshaped, shape_error,
};
use crate::camera::PyCamera;
use crate::errors::{MirrorPostureError, to_py};
use crate::work::Work;
use mirror_core::camera::Camera;
use mirror_core::joint::{
    BoardPrior, JointFrame, JointOptions, MarkerSighting, PointStatus, Via, joint_estimate,
};
use mirror_core::measure::{MeasureOptions, measure_ladder};
use mirror_core::mirror::{
    Board, BoardView, DetectedCorner, EstimatorOptions, GlassPane, MirrorEstimator, MirrorOptics, Sphere,
};
use mirror_core::triangulate::TriangulationOptions;
use mirror_core::{Cancel, Error};
use nalgebra::{Isometry3, Matrix3, Matrix6, Vector2, Vector3};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayLike2};
use pyo3::prelude::*;

/// With many rows off the model (a slipping joint, wrong detections) the robust loss settles slowly.
const JOINT_STEPS: usize = 1000;
/// A step that lowers chi-squared by less moves the result by a hundredth of its standard deviation.
const JOINT_LEAST_DECREASE: f64 = 1e-4;

/// The frames of a session as arrays: checked, converted once, measured in several ways.
#[pyclass(frozen, module = "mirror_posture._core")]
pub struct MeasureInput {
    camera: Camera,
    board: Board,
    diameters_m: Vec<f64>,
    optics: MirrorOptics,
    /// Frames whose board can be used.
    frames: Vec<JointFrame>,
    /// Row of each of them.
    rows: Vec<usize>,
    /// Why the others cannot, by row.
    refused: Vec<Option<String>>,
}

/// What was measured: one row a frame for mirrors, one row a posture and marker for markers.
#[pyclass(frozen, module = "mirror_posture._core")]
pub struct Measured {
    mirror_reason: Vec<Option<String>>,
    foot_m: Vec<f64>,
    foot_covariance_m2: Vec<f64>,
    corner_rms_px: Vec<f64>,
    posture: Vec<i64>,
    marker: Vec<i64>,
    marker_reason: Vec<Option<String>>,
    point_m: Vec<f64>,
    point_covariance_m2: Vec<f64>,
    /// Of maximum-likelihood points, else 0 with 0 degrees of freedom.
    point_chi_squared: Vec<f64>,
    point_degrees_of_freedom: Vec<i64>,
    camera_from_nominal_camera: Isometry3<f64>,
    camera_from_board_covariance: Option<Matrix6<f64>>,
    chi_squared: Option<f64>,
    degrees_of_freedom: Option<usize>,
}

#[pymethods]
impl MeasureInput {
    #[new]
    #[pyo3(signature = (*, camera, board_corners, square_m, diameters_m, glass_thickness_m,
        refractive_index, posture, camera_from_board, board_px, board_seen, marker_px, marker_seen, direct_px, direct_seen))]
    fn new(
        py: Python<'_>,
        camera: PyRef<'_, PyCamera>,
        board_corners: (usize, usize),
        square_m: f64,
        diameters_m: Vec<f64>,
        glass_thickness_m: f64,
        refractive_index: f64,
        posture: Vec<i64>,
        camera_from_board: ArrayDynLike<'_>,
        board_px: ArrayDynLike<'_>,
        board_seen: PyArrayLike2<'_, bool>,
        marker_px: ArrayDynLike<'_>,
        marker_seen: PyArrayLike2<'_, bool>,
        direct_px: ArrayDynLike<'_>,
        direct_seen: PyArrayLike2<'_, bool>,
    ) -> PyResult<Self> {
        let camera = camera.inner.as_ref().clone();
        let board = Board::new(board_corners, square_m).map_err(to_py)?;
        let pane = GlassPane::new(glass_thickness_m, refractive_index).map_err(to_py)?;
        let (count, corners, markers) = (posture.len(), board.corner_count(), diameters_m.len());
        let camera_from_board = isometries("camera_from_board", &camera_from_board)?;
        if camera_from_board.len() != count {
            return Err(shape_error(
                "camera_from_board",
                &[camera_from_board.len(), 4, 4],
                &format!("{count} rows"),
            ));
        }
        let board_px = of_rows("board_px", &board_px, &[corners, 2], count)?;
        let board_seen = mask("board_seen", &board_seen, [count, corners])?;
        let seen = [
            (
                of_rows("marker_px", &marker_px, &[markers, 2], count)?,
                mask("marker_seen", &marker_seen, [count, markers])?,
                Via::Mirror,
            ),
            (
                of_rows("direct_px", &direct_px, &[markers, 2], count)?,
                mask("direct_seen", &direct_seen, [count, markers])?,
                Via::Direct,
            ),
        ];
        py.work(|| {
            let at = |numbers: &[f64], k: usize| Vector2::new(numbers[2 * k], numbers[2 * k + 1]);
            let (mut frames, mut rows, mut refused) = (Vec::new(), Vec::new(), Vec::new());
            for row in 0..count {
                let detected: Vec<_> = (0..corners)
                    .filter(|i| board_seen[row * corners + i])
                    .map(|index| DetectedCorner { index, pixel: at(&board_px, row * corners + index) })
                    .collect();
                if detected.is_empty() {
                    refused.push(Some("the board was not seen".to_owned()));
                    continue;
                }
                let view = match BoardView::new(&board, &detected) {
                    Ok(view) => view,
                    Err(error) => {
                        refused.push(Some(error.to_string()));
                        continue;
                    }
                };
                let sightings =
                    seen.iter().flat_map(|(pixels, mask, via)| {
                        (0..markers).filter(move |m| mask[row * markers + m]).map(move |marker| {
                            MarkerSighting { marker, pixel: at(pixels, row * markers + marker), via: *via }
                        })
                    });
                frames.push(JointFrame {
                    posture: posture[row],
                    nominal_camera_from_board: camera_from_board[row],
                    corners: view,
                    markers: sightings.collect(),
                });
                rows.push(row);
                refused.push(None);
            }
            Ok(Self {
                camera,
                board,
                diameters_m,
                optics: MirrorOptics::of_glass(pane),
                frames,
                rows,
                refused,
            })
        })
    }

    /// Why the board of each frame cannot be used; None where it can.
    #[getter]
    fn mirrors_refused(&self) -> Vec<Option<String>> {
        self.refused.clone()
    }

    #[pyo3(signature = (estimator, *, corner_noise_px=None, marker_noise_px, least_parallax_rad, camera_from_board_covariance=None))]
    fn ladder(
        &self,
        py: Python<'_>,
        estimator: &str,
        corner_noise_px: Option<f64>,
        marker_noise_px: f64,
        least_parallax_rad: f64,
        camera_from_board_covariance: Option<Array2Like<'_>>,
    ) -> PyResult<Measured> {
        let shared = camera_from_board_covariance
            .map(|c| pose_covariance("camera_from_board_covariance", &c))
            .transpose()?;
        let cancel = Cancel::new();
        let options = MeasureOptions {
            cancel: cancel.clone(),
            estimator: MirrorEstimator::from_name(estimator).map_err(to_py)?,
            corners: EstimatorOptions { noise_px: corner_noise_px, ..EstimatorOptions::default() },
            marker_noise_px,
            optics: self.optics,
            triangulation: TriangulationOptions { least_parallax_rad, camera_from_board_covariance: shared },
            ..MeasureOptions::default()
        };
        py.work_until(&cancel, || {
            let spheres: Vec<_> =
                self.diameters_m.iter().map(|&d| Sphere::of_diameter_m(d)).collect::<Result<_, _>>()?;
            let done = measure_ladder(&self.camera, &self.board, &spheres, &self.frames, &options)?;
            let mut out = self.empty();
            for (row, mirror) in self.rows.iter().zip(&done.mirrors) {
                match mirror {
                    Ok(m) => out.put_mirror(*row, &m.plane.foot_point(), &m.covariance_m2, m.rms_px),
                    Err(error) => out.mirror_reason[*row] = Some(error.to_string()),
                }
            }
            for marker in &done.markers {
                match &marker.result {
                    Ok(at) => {
                        let (point, covariance) = (&at.point_in_camera.coords, &at.covariance_m2);
                        out.put_marker(marker.posture, marker.marker, point, covariance);
                        if let Some(fit) = at.pixel_fit {
                            out.put_fit(fit.chi_squared, fit.degrees_of_freedom);
                        }
                    }
                    Err(error) => out.put_reason(marker.posture, marker.marker, error.to_string()),
                }
            }
            out.camera_from_board_covariance = shared;
            Ok(out)
        })?
        .map_err(to_py)
    }

    #[pyo3(signature = (*, corner_noise_px, marker_noise_px, least_parallax_rad, camera_from_board_covariance=None))]
    fn joint(
        &self,
        py: Python<'_>,
        corner_noise_px: f64,
        marker_noise_px: f64,
        least_parallax_rad: f64,
        camera_from_board_covariance: Option<Array2Like<'_>>,
    ) -> PyResult<Measured> {
        let cancel = Cancel::new();
        let mut options = JointOptions {
            cancel: cancel.clone(),
            optics: self.optics,
            corner_std_px: corner_noise_px,
            marker_std_px: marker_noise_px,
            least_parallax_rad,
            most_steps: JOINT_STEPS,
            least_decrease: JOINT_LEAST_DECREASE,
            ..JointOptions::default()
        };
        if let Some(covariance) = camera_from_board_covariance {
            let covariance = pose_covariance("camera_from_board_covariance", &covariance)?;
            options.prior =
                if covariance.amax() == 0.0 { BoardPrior::Exact } else { BoardPrior::Covariance(covariance) };
        }
        if self.frames.is_empty() {
            return Err(MirrorPostureError::new_err("joint: no frame shows the board, needed at least one"));
        }
        py.work_until(&cancel, || {
            let done = joint_estimate(&self.camera, &self.board, &self.diameters_m, &self.frames, &options)?;
            let mut out = self.empty();
            for (k, row) in self.rows.iter().enumerate() {
                out.put_mirror(
                    *row,
                    &done.planes[k].foot_point(),
                    &done.plane_covariances_m2[k],
                    done.corner_rms_px[k],
                );
            }
            for point in &done.points {
                match (point.point_in_camera, point.covariance_m2) {
                    (Some(at), Some(covariance)) => {
                        out.put_marker(point.posture, point.marker, &at.coords, &covariance);
                    }
                    _ => out.put_reason(point.posture, point.marker, why_not(point.status, &self.rows)),
                }
            }
            out.camera_from_nominal_camera = done.camera_from_nominal_camera;
            out.camera_from_board_covariance = Some(done.camera_from_board_covariance);
            out.chi_squared = Some(done.chi_squared);
            out.degrees_of_freedom = Some(done.degrees_of_freedom);
            Ok::<_, Error>(out)
        })?
        .map_err(|error| to_py(error.of_rows(&self.rows)))
    }
}

/// `rows`: of the frames that were given to the core.
fn why_not(status: PointStatus, rows: &[usize]) -> String {
    match status {
        PointStatus::NoRay { frame } => {
            let row = rows.get(frame).copied().unwrap_or(frame);
            format!(
                "its pixel in frame {row} has no ray: beyond where the lens model can be inverted, or beside the mirror"
            )
        }
        PointStatus::Measured => "no position".to_owned(),
        PointStatus::TooFewViews { views } => format!("rays: got {views}, needed 2"),
        PointStatus::TooLittleParallax { got_rad, needed_rad } => {
            Error::TooLittleParallax { got_rad, needed_rad }.to_string()
        }
        PointStatus::WrongSide => {
            "the rays meet behind a mirror or the camera, where no marker can be".to_owned()
        }
    }
}

impl MeasureInput {
    /// A result in which no mirror and no marker is measured yet.
    fn empty(&self) -> Measured {
        let count = self.refused.len();
        Measured {
            mirror_reason: self.refused.clone(),
            foot_m: vec![0.0; count * 3],
            foot_covariance_m2: vec![0.0; count * 9],
            corner_rms_px: vec![0.0; count],
            posture: Vec::new(),
            marker: Vec::new(),
            marker_reason: Vec::new(),
            point_m: Vec::new(),
            point_covariance_m2: Vec::new(),
            point_chi_squared: Vec::new(),
            point_degrees_of_freedom: Vec::new(),
            camera_from_nominal_camera: Isometry3::identity(),
            camera_from_board_covariance: None,
            chi_squared: None,
            degrees_of_freedom: None,
        }
    }
}

impl Measured {
    fn put_mirror(&mut self, row: usize, foot: &Vector3<f64>, covariance: &Matrix3<f64>, rms_px: f64) {
        self.foot_m[row * 3..row * 3 + 3].copy_from_slice(foot.as_slice());
        // Symmetric: by columns is by rows.
        self.foot_covariance_m2[row * 9..row * 9 + 9].copy_from_slice(covariance.as_slice());
        self.corner_rms_px[row] = rms_px;
    }

    fn put_marker(&mut self, posture: i64, marker: usize, point: &Vector3<f64>, covariance: &Matrix3<f64>) {
        self.posture.push(posture);
        self.marker.push(marker as i64);
        self.marker_reason.push(None);
        self.point_m.extend_from_slice(point.as_slice());
        self.point_covariance_m2.extend_from_slice(covariance.as_slice());
        self.point_chi_squared.push(0.0);
        self.point_degrees_of_freedom.push(0);
    }

    /// How well the last marker explains its pixels.
    fn put_fit(&mut self, chi_squared: f64, degrees_of_freedom: usize) {
        if let (Some(chi), Some(free)) =
            (self.point_chi_squared.last_mut(), self.point_degrees_of_freedom.last_mut())
        {
            (*chi, *free) = (chi_squared, degrees_of_freedom as i64);
        }
    }

    fn put_reason(&mut self, posture: i64, marker: usize, reason: String) {
        self.put_marker(posture, marker, &Vector3::zeros(), &Matrix3::zeros());
        if let Some(last) = self.marker_reason.last_mut() {
            *last = Some(reason);
        }
    }
}

#[pymethods]
impl Measured {
    #[getter]
    fn mirror_reason(&self) -> Vec<Option<String>> {
        self.mirror_reason.clone()
    }

    #[getter]
    fn foot_m<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        reshaped(py, self.foot_m.clone(), [self.mirror_reason.len(), 3])
    }

    #[getter]
    fn foot_covariance_m2<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        reshaped(py, self.foot_covariance_m2.clone(), [self.mirror_reason.len(), 3, 3])
    }

    #[getter]
    fn corner_rms_px<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.corner_rms_px)
    }

    #[getter]
    fn posture<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_slice(py, &self.posture)
    }

    #[getter]
    fn marker<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_slice(py, &self.marker)
    }

    #[getter]
    fn marker_reason(&self) -> Vec<Option<String>> {
        self.marker_reason.clone()
    }

    #[getter]
    fn point_in_camera_m<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        reshaped(py, self.point_m.clone(), [self.marker.len(), 3])
    }

    #[getter]
    fn point_covariance_m2<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        reshaped(py, self.point_covariance_m2.clone(), [self.marker.len(), 3, 3])
    }

    #[getter]
    fn point_chi_squared<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.point_chi_squared)
    }

    #[getter]
    fn point_degrees_of_freedom<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_slice(py, &self.point_degrees_of_freedom)
    }

    #[getter]
    fn camera_from_nominal_camera<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows = self.camera_from_nominal_camera.to_homogeneous().transpose();
        reshaped(py, rows.as_slice().to_vec(), [4, 4])
    }

    #[getter]
    fn camera_from_board_covariance<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        self.camera_from_board_covariance.map(|c| reshaped(py, c.as_slice().to_vec(), [6, 6])).transpose()
    }

    #[getter]
    fn chi_squared(&self) -> Option<f64> {
        self.chi_squared
    }

    #[getter]
    fn degrees_of_freedom(&self) -> Option<usize> {
        self.degrees_of_freedom
    }
}
