//! The design of a session: postures that could be taken in, the most informative ones and what they will show out.

use crate::errors::to_py;
use crate::gap::GapRecording;
use crate::work::Work;
use mirror_core::Cancel;
use mirror_core::diagnose::{PlannedSession, Pool};
use pyo3::prelude::*;

/// Effect, place, each parameter with its limit, and the twins: effect, place, and the size from which on they are
/// separated. None stands for no size at all.
type Foreseen = (String, String, Vec<(String, Option<f64>)>, Vec<(String, String, Option<f64>)>);

/// Postures with the pixels that the model predicts for them.
#[pyclass(frozen, name = "PlannedSession", module = "mirror_posture._core")]
pub struct PyPlannedSession {
    session: PlannedSession,
    cancel: Cancel,
}

#[pymethods]
impl PyPlannedSession {
    #[new]
    fn new(py: Python<'_>, recording: &GapRecording) -> PyResult<Self> {
        let cancel = Cancel::new();
        let made = py.work_until(&cancel, || {
            PlannedSession::new(recording.robot(), recording.recording(), cancel.clone())
        })?;
        Ok(Self { session: made.map_err(to_py)?, cancel })
    }

    /// The items that add most information, in the order in which they were chosen. `frames` are those of each item,
    /// `block` and `posture` its numbers; `most` items are taken of each block, and none of a posture twice.
    fn choose(
        &self,
        py: Python<'_>,
        frames: Vec<Vec<usize>>,
        block: Vec<usize>,
        posture: Vec<usize>,
        most: Vec<usize>,
    ) -> PyResult<Vec<usize>> {
        let pool = Pool { frames: &frames, block: &block, posture: &posture, most: &most };
        py.work_until(&self.cancel, || self.session.choose(&pool))?.map_err(to_py)
    }

    /// What the postures will show of each effect at each place.
    fn foresee(&self, py: Python<'_>) -> PyResult<Vec<Foreseen>> {
        let told = py.work_until(&self.cancel, || self.session.foresee())?.map_err(to_py)?;
        let told = told.into_iter().map(|one| {
            let twins = one.twins.into_iter().map(|t| (t.effect, t.at, t.apart_from)).collect();
            (one.effect, one.at, one.parameters, twins)
        });
        Ok(told.collect())
    }
}
