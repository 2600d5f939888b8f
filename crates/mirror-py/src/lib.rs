//! Python bindings of `mirror-core`: conversion of arrays and errors, one file a core module; decides nothing.

mod arrays;
mod errors;
mod picture;
mod robot;

/// The compiled core of `mirror_posture`.
#[pyo3::pymodule]
mod _core {
    #[pymodule_export]
    use crate::errors::MirrorPostureError;
    #[pymodule_export]
    use crate::picture::PictureMaker;
    #[pymodule_export]
    use crate::robot::PyRobot;

    #[pymodule_init]
    fn init(module: &pyo3::Bound<'_, pyo3::types::PyModule>) -> pyo3::PyResult<()> {
        use pyo3::prelude::*;
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
