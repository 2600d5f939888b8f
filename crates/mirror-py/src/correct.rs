//! Bindings of `mirror_core::correct`.

use crate::arrays::{Array1Like, Array2Like, ArrayDynLike, reshaped, rows_of, shape_error, stacked};
use crate::errors::{MirrorPostureError, to_py};
use crate::robot::PyRobot;
use mirror_core::correct::{
    CorrectOptions, Corrector, Damping, JacobianSource, JudgeOptions, Reading, StepOptions, StepProblem,
    StepWorkspace, Target, correction_step as core_step,
};
use mirror_core::robot::Robot;
use nalgebra::{DMatrix, Matrix3, Vector3};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use serde::Serialize;
use std::sync::Arc;

fn damping(mu_m_per_rad: Option<f64>, step_std_rad: Option<f64>) -> Damping {
    match (mu_m_per_rad, step_std_rad) {
        (Some(mu_m_per_rad), _) => Damping::Fixed { mu_m_per_rad },
        (None, Some(step_std_rad)) => Damping::Noise { step_std_rad },
        (None, None) => Damping::default(),
    }
}

fn numbers(array: &Array1Like<'_>) -> Vec<f64> {
    array.as_array().iter().copied().collect()
}

fn points(name: &str, array: &Array2Like<'_>) -> PyResult<Vec<Vector3<f64>>> {
    let (_, flat) = rows_of(name, array, 3, "one row a marker")?;
    Ok(flat.chunks_exact(3).map(Vector3::from_column_slice).collect())
}

fn covariances(name: &str, array: &ArrayDynLike<'_>) -> PyResult<Vec<Matrix3<f64>>> {
    let (_, flat) = stacked(name, array, &[3, 3])?;
    Ok(flat.chunks_exact(9).map(Matrix3::from_row_slice).collect())
}

fn json(value: &impl Serialize) -> PyResult<String> {
    serde_json::to_string(value).map_err(|e| MirrorPostureError::new_err(e.to_string()))
}

/// A step as `correction_step` returns it.
#[pyclass(name = "CorrectionStep", module = "mirror_posture._core", frozen)]
pub struct PyCorrectionStep {
    change: Vec<f64>,
    /// Which joints a limit stopped.
    #[pyo3(get)]
    at_limit: Vec<bool>,
    /// The damping, m/rad.
    #[pyo3(get)]
    mu_m_per_rad: f64,
    /// 1, or the factor that shortened the step.
    #[pyo3(get)]
    scale: f64,
}

#[pymethods]
impl PyCorrectionStep {
    /// (N,), rad (m).
    #[getter]
    fn change<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.change)
    }
}

/// One step of Algorithm 1; see `mirror_posture.correct.correction_step`.
#[pyfunction]
#[pyo3(signature = (jacobian, error_m, covariance_m2, positions, lower, upper, free, *, gain, largest_step_rad,
    mu_m_per_rad=None, step_std_rad=None))]
pub fn correction_step(
    jacobian: Array2Like<'_>,
    error_m: Array2Like<'_>,
    covariance_m2: ArrayDynLike<'_>,
    positions: Array1Like<'_>,
    lower: Array1Like<'_>,
    upper: Array1Like<'_>,
    free: Vec<bool>,
    gain: f64,
    largest_step_rad: f64,
    mu_m_per_rad: Option<f64>,
    step_std_rad: Option<f64>,
) -> PyResult<PyCorrectionStep> {
    let view = jacobian.as_array();
    let matrix = DMatrix::from_fn(view.nrows(), view.ncols(), |i, j| view[[i, j]]);
    let options = StepOptions { gain, damping: damping(mu_m_per_rad, step_std_rad), largest_step_rad };
    options.check().map_err(to_py)?;
    let problem = StepProblem {
        jacobian: &matrix,
        error_m: &points("error_m", &error_m)?,
        covariance_m2: &covariances("covariance_m2", &covariance_m2)?,
        positions: &numbers(&positions),
        lower: &numbers(&lower),
        upper: &numbers(&upper),
        free: &free,
    };
    let mut workspace = StepWorkspace::default();
    let step = core_step(&problem, &options, &mut workspace).map_err(to_py)?;
    Ok(PyCorrectionStep {
        change: step.change.to_vec(),
        at_limit: step.at_limit.to_vec(),
        mu_m_per_rad: step.mu_m_per_rad,
        scale: step.scale,
    })
}

/// One correction: readings in, decisions out; see `mirror_posture.correct`.
#[pyclass(name = "Corrector", module = "mirror_posture._core")]
pub struct PyCorrector {
    inner: Corrector,
    robot: Arc<Robot>,
}

#[pymethods]
impl PyCorrector {
    #[new]
    #[pyo3(signature = (robot, *, camera_link, board_link, markers, posture, held, start=None, gain, largest_step_rad,
        mu_m_per_rad, step_std_rad, jacobian, tolerance_m, wrong_converged, looks, patience, least_progress,
        divergence, retries, largest_gap_m, play_m, largest_correction_rad))]
    fn new(
        robot: &PyRobot,
        camera_link: &str,
        board_link: &str,
        markers: Vec<(String, String)>,
        posture: Array1Like<'_>,
        held: Vec<String>,
        start: Option<Array1Like<'_>>,
        gain: f64,
        largest_step_rad: f64,
        mu_m_per_rad: Option<f64>,
        step_std_rad: Option<f64>,
        jacobian: &str,
        tolerance_m: f64,
        wrong_converged: f64,
        looks: usize,
        patience: usize,
        least_progress: f64,
        divergence: f64,
        retries: usize,
        largest_gap_m: f64,
        play_m: f64,
        largest_correction_rad: f64,
    ) -> PyResult<Self> {
        let robot = &robot.inner;
        let link = |name: &str| robot.link_index(name).map_err(to_py);
        let markers = markers
            .into_iter()
            .map(|(name, on)| Ok((name, link(&on)?)))
            .collect::<PyResult<Vec<(String, usize)>>>()?;
        let held = held
            .iter()
            .map(|name| robot.position_index(name).map_err(to_py))
            .collect::<PyResult<Vec<usize>>>()?;
        let source = match jacobian {
            "reference" => JacobianSource::Reference,
            "current" => JacobianSource::Current,
            "broyden" => JacobianSource::Broyden,
            _ => {
                return Err(to_py(mirror_core::Error::UnknownName {
                    what: "jacobian",
                    got: jacobian.to_owned(),
                    valid: "reference, current, broyden".to_owned(),
                }));
            }
        };
        let options = CorrectOptions {
            step: StepOptions { gain, damping: damping(mu_m_per_rad, step_std_rad), largest_step_rad },
            jacobian: source,
            judge: JudgeOptions {
                tolerance_m,
                wrong_converged,
                looks,
                patience,
                least_progress,
                divergence,
                retries,
                largest_gap_m,
                play_m,
                largest_correction_rad,
            },
        };
        let target = Target::new(
            robot.clone(),
            link(camera_link)?,
            link(board_link)?,
            &markers,
            &numbers(&posture),
            &held,
        )
        .map_err(to_py)?;
        let start = start.map(|s| numbers(&s));
        let inner = Corrector::new(target, options, start.as_deref()).map_err(to_py)?;
        Ok(Self { inner, robot: robot.clone() })
    }

    /// (M, 3): where the markers are to be, in the board's frame, m.
    #[getter]
    fn target_in_board_m<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let target = self.inner.target().point_in_frame_m();
        reshaped(py, target.iter().flatten().copied().collect(), [target.len(), 3])
    }

    /// Narrows a joint's range, rad (m).
    fn narrow(&mut self, joint: &str, lower: f64, upper: f64) -> PyResult<()> {
        let position = self.robot.position_index(joint).map_err(to_py)?;
        self.inner.narrow(position, lower, upper).map_err(to_py)
    }

    /// Which positions may move.
    #[getter]
    fn free(&self) -> Vec<bool> {
        self.inner.target().free().to_vec()
    }

    /// (N,): the command for the next look, rad (m).
    #[getter]
    fn command<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.inner.command())
    }

    /// (N,): the command with the smallest error so far; None before a look was accepted.
    #[getter]
    fn best_command<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.inner.best_command().map(|command| PyArray1::from_slice(py, command))
    }

    /// All looks so far, as JSON.
    fn records(&self) -> PyResult<String> {
        json(&self.inner.records())
    }

    /// How far each joint followed its commands so far, as JSON.
    fn responses(&self) -> PyResult<String> {
        json(&self.inner.responses())
    }

    /// Takes one look's readings, one row a marker (of those with `measured` False nothing is read); the decision, as JSON.
    fn observe(
        &mut self,
        measured: Vec<bool>,
        point_in_board_m: Array2Like<'_>,
        covariance_m2: ArrayDynLike<'_>,
        chi_squared: Array1Like<'_>,
        degrees_of_freedom: Vec<usize>,
    ) -> PyResult<String> {
        let points = points("point_in_board_m", &point_in_board_m)?;
        let covariances = covariances("covariance_m2", &covariance_m2)?;
        let chi_squared = numbers(&chi_squared);
        let count = measured.len();
        for (name, length) in [
            ("point_in_board_m", points.len()),
            ("covariance_m2", covariances.len()),
            ("chi_squared", chi_squared.len()),
            ("degrees_of_freedom", degrees_of_freedom.len()),
        ] {
            if length != count {
                return Err(shape_error(name, &[length], &format!("({count}, …) as `measured` has")));
            }
        }
        let readings: Vec<Option<Reading>> = (0..count)
            .map(|m| {
                measured[m].then(|| Reading {
                    point_in_frame_m: points[m],
                    covariance_m2: covariances[m],
                    chi_squared: chi_squared[m],
                    degrees_of_freedom: degrees_of_freedom[m],
                })
            })
            .collect();
        json(&self.inner.observe(&readings).map_err(to_py)?)
    }
}
