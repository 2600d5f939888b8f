//! Bindings of `mirror_core::robot`.

use crate::arrays::{Array1Like, Array2Like, reshaped, rows_of, triple, triples};
use crate::errors::{MirrorPostureError, to_py};
use crate::work::Work;
use mirror_core::geometry::directions;
use mirror_core::robot::{JointErrors, JointKind, Robot};
use nalgebra::{Point3, Vector3};
use numpy::ndarray::{Dim, Dimension, IntoDimension};
use numpy::{PyArray, PyArray1, PyArray2, PyArray3, PyArray4, PyArrayMethods};
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;

/// A robot read from URDF; see `mirror_posture.robot.Robot`.
#[pyclass(name = "Robot", module = "mirror_posture._core", frozen)]
pub struct PyRobot {
    /// The core's robot, shared with everything that is built on it.
    pub inner: Arc<Robot>,
}

/// Batches from this size on are shared out among threads.
const SHARED: usize = 64;
/// The most numbers of an array, as NumPy counts bytes.
const LARGEST: usize = isize::MAX as usize / size_of::<f64>();

/// Runs a batch without the GIL: results of shape (N, …) from their numbers in C order.
///
/// NumPy has the memory given: it asks for large pages, without which the first write to each of a large batch's pages takes several
/// times as long as the kernels.
fn batch<'py, const D: usize>(
    py: Python<'py>,
    shape: [usize; D],
    run: impl FnOnce(&mut [f64]) -> mirror_core::Result<()> + Send,
) -> PyResult<Bound<'py, PyArray<f64, Dim<[usize; D]>>>>
where
    Dim<[usize; D]>: Dimension,
    [usize; D]: IntoDimension<Dim = Dim<[usize; D]>>,
{
    let count = shape[0];
    let size = shape.iter().try_fold(1usize, |size, n| size.checked_mul(*n)).filter(|n| *n <= LARGEST);
    let size = size.ok_or_else(|| {
        MirrorPostureError::new_err(format!("positions: got {count} postures, needed fewer"))
    })?;
    let flat = PyArray1::<f64>::zeros(py, size, false);
    {
        let mut borrowed = flat.readwrite();
        let out = borrowed.as_slice_mut()?;
        // A few postures are done before another thread has begun.
        if count < SHARED { py.detach(|| run(out)) } else { py.work(|| run(out)) }.map_err(to_py)?;
    }
    flat.reshape(shape)
}

impl PyRobot {
    fn positions(&self, array: &Array2Like<'_>) -> PyResult<(usize, Vec<f64>)> {
        rows_of(
            "positions",
            array,
            self.inner.position_count(),
            "one column a movable joint, see position_names",
        )
    }

    fn link(&self, name: &str) -> PyResult<usize> {
        self.inner.link_index(name).map_err(to_py)
    }

    fn per_joint<T>(&self, get: impl Fn(&mirror_core::robot::Joint) -> T) -> Vec<T> {
        self.inner.joints().iter().map(get).collect()
    }
}

#[pymethods]
impl PyRobot {
    #[staticmethod]
    fn from_urdf_file(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let inner = py.detach(|| Robot::from_urdf_file(&path)).map_err(to_py)?;
        Ok(Self { inner: Arc::new(inner) })
    }

    #[staticmethod]
    fn from_urdf_str(py: Python<'_>, text: &str) -> PyResult<Self> {
        let inner = py.detach(|| Robot::from_urdf_str(text)).map_err(to_py)?;
        Ok(Self { inner: Arc::new(inner) })
    }

    #[getter]
    fn name(&self) -> &str {
        self.inner.name()
    }

    #[getter]
    fn link_names(&self) -> Vec<&str> {
        self.inner.links().iter().map(|l| l.name.as_str()).collect()
    }

    #[getter]
    fn joint_names(&self) -> Vec<&str> {
        self.inner.joints().iter().map(|j| j.name.as_str()).collect()
    }

    #[getter]
    fn position_names(&self) -> Vec<&str> {
        self.inner.position_names().collect()
    }

    fn link_index(&self, name: &str) -> PyResult<usize> {
        self.link(name)
    }

    fn joint_index(&self, name: &str) -> PyResult<usize> {
        self.inner.joint_index(name).map_err(to_py)
    }

    fn position_index(&self, name: &str) -> PyResult<usize> {
        self.inner.position_index(name).map_err(to_py)
    }

    #[getter]
    fn masses_kg<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.inner.links().iter().map(|l| l.mass_kg).collect())
    }

    #[getter]
    fn coms_in_link_m<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let numbers =
            self.inner.links().iter().flat_map(|l| [l.com_in_link_m.x, l.com_in_link_m.y, l.com_in_link_m.z]);
        reshaped(py, numbers.collect(), [self.inner.links().len(), 3])
    }

    #[getter]
    fn joint_kinds(&self) -> Vec<&'static str> {
        self.per_joint(|joint| match joint.kind {
            JointKind::Revolute => "revolute",
            JointKind::Continuous => "continuous",
            JointKind::Prismatic => "prismatic",
            JointKind::Fixed => "fixed",
        })
    }

    #[getter]
    fn joint_parent_links(&self) -> Vec<usize> {
        self.per_joint(|joint| joint.parent_link)
    }

    #[getter]
    fn joint_axes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let axes = self.per_joint(|joint| [joint.axis.x, joint.axis.y, joint.axis.z]);
        reshaped(py, axes.into_iter().flatten().collect(), [self.inner.joints().len(), 3])
    }

    #[getter]
    fn joint_limits<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let limits = self
            .per_joint(|joint| joint.limits.map_or([-f64::INFINITY, f64::INFINITY], |l| [l.lower, l.upper]));
        reshaped(py, limits.into_iter().flatten().collect(), [self.inner.joints().len(), 2])
    }

    #[getter]
    fn parent_from_joint<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let poses = self.inner.joints().iter().flat_map(|joint| {
            // nalgebra stores by columns, NumPy reads by rows.
            let matrix = joint.parent_from_joint.to_homogeneous().transpose();
            matrix.as_slice().to_vec()
        });
        reshaped(py, poses.collect(), [self.inner.joints().len(), 4, 4])
    }

    #[getter]
    fn joint_positions(&self) -> Vec<Option<usize>> {
        self.per_joint(|joint| joint.drive.map(|d| d.position))
    }

    #[getter]
    fn joint_multipliers<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.per_joint(|joint| joint.drive.map_or(0.0, |d| d.multiplier)))
    }

    #[getter]
    fn joint_offsets<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.per_joint(|joint| joint.drive.map_or(0.0, |d| d.offset)))
    }

    fn chain_joints(&self, link_a: &str, link_b: &str) -> PyResult<Vec<usize>> {
        let chain = self.inner.chain(self.link(link_a)?, self.link(link_b)?).map_err(to_py)?;
        Ok(chain.steps.iter().map(|s| s.joint).collect())
    }

    fn chain_signs(&self, link_a: &str, link_b: &str) -> PyResult<Vec<f64>> {
        let chain = self.inner.chain(self.link(link_a)?, self.link(link_b)?).map_err(to_py)?;
        Ok(chain.steps.iter().map(|s| s.direction.sign()).collect())
    }

    fn forward_kinematics<'py>(
        &self,
        py: Python<'py>,
        positions: Array2Like<'py>,
    ) -> PyResult<Bound<'py, PyArray4<f64>>> {
        let (count, q) = self.positions(&positions)?;
        let links = self.inner.links().len();
        batch(py, [count, links, 4, 4], |out| self.inner.forward_kinematics_batch(&q, out))
    }

    fn link_poses<'py>(
        &self,
        py: Python<'py>,
        positions: Array2Like<'py>,
        links: Vec<String>,
    ) -> PyResult<Bound<'py, PyArray4<f64>>> {
        let (count, q) = self.positions(&positions)?;
        let links = links.iter().map(|name| self.link(name)).collect::<PyResult<Vec<_>>>()?;
        batch(py, [count, links.len(), 4, 4], |out| self.inner.link_poses_batch(&q, &links, out))
    }

    fn joint_twists<'py>(
        &self,
        py: Python<'py>,
        positions: Array2Like<'py>,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (count, q) = self.positions(&positions)?;
        let joints = self.inner.joints().len();
        batch(py, [count, joints, 6], |out| self.inner.joint_twists_batch(&q, out))
    }

    fn points<'py>(
        &self,
        py: Python<'py>,
        positions: Array2Like<'py>,
        in_link: &str,
        link: &str,
        point_in_link_m: Array1Like<'py>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (count, q) = self.positions(&positions)?;
        let (a, b) = (self.link(in_link)?, self.link(link)?);
        let point = Point3::from(triple("point_in_link_m", &point_in_link_m)?);
        batch(py, [count, 3], |out| self.inner.points_batch(&q, a, b, &point, out))
    }

    fn point_jacobians<'py>(
        &self,
        py: Python<'py>,
        positions: Array2Like<'py>,
        in_link: &str,
        link: &str,
        point_in_link_m: Array1Like<'py>,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (count, q) = self.positions(&positions)?;
        let (a, b) = (self.link(in_link)?, self.link(link)?);
        let point = Point3::from(triple("point_in_link_m", &point_in_link_m)?);
        let width = self.inner.position_count();
        batch(py, [count, 3, width], |out| self.inner.point_jacobians_batch(&q, a, b, &point, out))
    }

    fn gravity_torques<'py>(
        &self,
        py: Python<'py>,
        positions: Array2Like<'py>,
        gravity_in_held_link: Array1Like<'py>,
        held_link: &str,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (count, q) = self.positions(&positions)?;
        let gravity: Vector3<f64> = triple("gravity_in_held_link", &gravity_in_held_link)?;
        let (held, width) = (self.link(held_link)?, self.inner.position_count());
        batch(py, [count, width], |out| self.inner.gravity_torques_batch(&q, &gravity, held, out))
    }

    fn gravity_moments<'py>(
        &self,
        py: Python<'py>,
        positions: Array2Like<'py>,
        gravity_in_held_link: Array1Like<'py>,
        held_link: &str,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (count, q) = self.positions(&positions)?;
        let gravity: Vector3<f64> = triple("gravity_in_held_link", &gravity_in_held_link)?;
        let (held, joints) = (self.link(held_link)?, self.inner.joints().len());
        batch(py, [count, joints, 3], |out| self.inner.gravity_moments_batch(&q, &gravity, held, out))
    }

    /// `errors`: by joint, the error of its position (N,), rad, and the bending of the link that it carries (N, 3), rad.
    fn up_in_link<'py>(
        &self,
        py: Python<'py>,
        positions: Array2Like<'py>,
        link: &str,
        gravity_in_held_link: Array1Like<'py>,
        held_link: &str,
        errors: Vec<(String, Array1Like<'py>, Array2Like<'py>)>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (count, q) = self.positions(&positions)?;
        let gravity: Vector3<f64> = triple("gravity_in_held_link", &gravity_in_held_link)?;
        let (held, link) = (self.link(held_link)?, self.link(link)?);
        let errors = errors
            .iter()
            .map(|(joint, turn, bend)| {
                Ok(JointErrors {
                    joint: self.inner.joint_index(joint).map_err(to_py)?,
                    turn_rad: turn.as_array().to_vec(),
                    bend_rad: triples("bend_rad", bend)?,
                })
            })
            .collect::<PyResult<Vec<_>>>()?;
        let up =
            py.detach(|| self.inner.up_in_link(&q, count, held, link, &gravity, &errors)).map_err(to_py)?;
        reshaped(py, up.iter().flat_map(|u| [u.x, u.y, u.z]).collect(), [count, 3])
    }

    fn __repr__(&self) -> String {
        format!(
            "Robot({:?}, {} links, {} positions)",
            self.inner.name(),
            self.inner.links().len(),
            self.inner.position_count()
        )
    }
}

/// RMS angle (rad) between unit vectors (N, 3) in pairs, and that with the first turned by one rotation to the second; 0 for none.
#[pyfunction]
pub fn rms_angles(a: Array2Like<'_>, b: Array2Like<'_>) -> PyResult<(f64, f64)> {
    let (a, b) = (triples("a", &a)?, triples("b", &b)?);
    let both =
        directions::rms_angle(&a, &b).and_then(|as_is| Ok((as_is, directions::rms_angle_turned(&a, &b)?)));
    both.map_err(to_py)
}
