//! Python bindings of `mirror-core`: conversion of arrays and errors, one file a core module; decides nothing.

mod arrays;
mod calibrate;
mod camera;
mod correct;
mod errors;
mod feed_forward;
mod gap;
mod gap_own;
mod joint_log;
mod measure;
mod mirror;
mod optics;
mod outline;
mod pattern;
mod picture;
mod planned;
mod png_file;
mod robot;
mod triangulate;
mod view_check;
mod work;

/// The compiled core of `mirror_posture`.
#[pyo3::pymodule]
mod _core {
    #[pymodule_export]
    use crate::calibrate::{
        PyCameraBoardCalibration, PySecondCameraCalibration, calibrate_mirror_views, calibrate_second_camera,
    };
    #[pymodule_export]
    use crate::camera::PyCamera;
    #[pymodule_export]
    use crate::correct::{PyCorrectionStep, PyCorrector, correction_step};
    #[pymodule_export]
    use crate::errors::MirrorPostureError;
    #[pymodule_export]
    use crate::feed_forward::PyFeedForward;
    #[pymodule_export]
    use crate::gap::{DiagnosisProgress, GapRecording};
    #[pymodule_export]
    use crate::gap::{effects, mistakes};
    #[pymodule_export]
    use crate::joint_log::{find_rests, match_clocks};
    #[pymodule_export]
    use crate::measure::{MeasureInput, Measured};
    #[pymodule_export]
    use crate::mirror::{PyMirrors, PyPlanarPoses, PyRig, planar_poses};
    #[pymodule_export]
    use crate::optics::{PySeenInMirror, ball_center_pixels, ball_centroids, see_in_mirror};
    #[pymodule_export]
    use crate::outline::{
        PyBallOutline, PyPatternGhost, chroma_step, codec_covariances, color_regions,
        fit_circle_by_consensus, measure_balls, measure_blurred_balls, pattern_curve, pattern_ghost,
    };
    #[pymodule_export]
    use crate::pattern::{drawn_pattern, levels_without_ghost};
    #[pymodule_export]
    use crate::picture::PictureMaker;
    #[pymodule_export]
    use crate::planned::PyPlannedSession;
    #[pymodule_export]
    use crate::png_file::plain_png;
    #[pymodule_export]
    use crate::robot::{PyRobot, rms_angles};
    #[pymodule_export]
    use crate::triangulate::{
        PyMarkers, PyPointBatch, PyVirtualRays, triangulate, two_view_markers, virtual_rays,
    };
    #[pymodule_export]
    use crate::view_check::{PyCheckedViews, check_views};

    #[pymodule_init]
    fn init(module: &pyo3::Bound<'_, pyo3::types::PyModule>) -> pyo3::PyResult<()> {
        use pyo3::prelude::*;
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
