//! The one place where the core's errors become Python exceptions.

use pyo3::create_exception;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;

create_exception!(
    mirror_posture._core,
    MirrorPostureError,
    PyException,
    "Root of all errors that mirror_posture raises on purpose: the message names what was got, what was needed and the fix."
);

/// Turns an error of the core into the Python exception, its message unchanged.
pub fn to_py(error: mirror_core::Error) -> PyErr {
    MirrorPostureError::new_err(error.to_string())
}
