//! Bindings of `mirror_core::correct::FeedForward`.

use crate::arrays::{Array1Like, Array2Like, reshaped, rows_of, triple};
use crate::errors::to_py;
use crate::robot::PyRobot;
use mirror_core::correct::{FeedForward, JointError};
use mirror_core::robot::JointTerm;
use numpy::PyArray2;
use pyo3::prelude::*;

/// From wanted postures to commands; see `mirror_posture.diagnosis.feed_forward`.
#[pyclass(name = "FeedForward", module = "mirror_posture._core", frozen)]
pub struct PyFeedForward {
    inner: FeedForward,
    positions: usize,
}

/// Way-points and commands, (N, nq) each.
type Commands<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

#[pymethods]
impl PyFeedForward {
    /// `errors`: joint, term of its law, size, and of a coupling the other joint.
    #[new]
    fn new(
        robot: &PyRobot,
        held_link: &str,
        gravity_in_held_link_m_per_s2: Array1Like<'_>,
        errors: Vec<(String, String, f64, Option<String>)>,
    ) -> PyResult<Self> {
        let robot = &robot.inner;
        let position = |name: &str| robot.position_index(name).map_err(to_py);
        let errors = errors
            .into_iter()
            .map(|(joint, term, value, driver)| {
                let known = JointTerm::named(&term).ok_or_else(|| {
                    to_py(mirror_core::Error::UnknownName {
                        what: "term of a joint's law",
                        got: term,
                        valid: JointTerm::ALL.map(JointTerm::name).join(", "),
                    })
                })?;
                let driver = driver.map(|name| position(&name)).transpose()?;
                Ok(JointError { position: position(&joint)?, term: known, value, driver })
            })
            .collect::<PyResult<Vec<_>>>()?;
        let held = robot.link_index(held_link).map_err(to_py)?;
        let gravity = triple("gravity_in_held_link_m_per_s2", &gravity_in_held_link_m_per_s2)?;
        let inner = FeedForward::new(robot.clone(), held, gravity, &errors).map_err(to_py)?;
        Ok(Self { inner, positions: robot.position_count() })
    }

    /// Whether some joint is brought to its place over a way-point.
    #[getter]
    fn has_way_points(&self) -> bool {
        self.inner.has_way_points()
    }

    /// Indices of the positions whose law is known.
    #[getter]
    fn corrected(&self) -> Vec<usize> {
        self.inner.positions().collect()
    }

    /// Way-points and commands (N, nq) that end in the wanted postures (N, nq), rad (m).
    fn commands<'py>(&self, py: Python<'py>, wanted: Array2Like<'py>) -> PyResult<Commands<'py>> {
        let (count, wanted) = rows_of("wanted", &wanted, self.positions, "one column a movable joint")?;
        let (mut way_points, mut commands) = (vec![0.0; wanted.len()], vec![0.0; wanted.len()]);
        py.detach(|| self.inner.commands(&wanted, &mut way_points, &mut commands)).map_err(to_py)?;
        let shape = [count, self.positions];
        Ok((reshaped(py, way_points, shape)?, reshaped(py, commands, shape)?))
    }
}
