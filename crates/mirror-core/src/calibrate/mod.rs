//! Calibrating the camera–board transform: from mirror views alone, or with a second camera as in the paper.

mod mirror_start;
mod mirror_views;
mod second_camera;
mod weakness;

pub use mirror_views::{CameraBoardCalibration, MirrorViewOptions, RefusedView, calibrate_from_mirror_views};
pub use second_camera::{
    SecondCameraCalibration, SecondCameraRig, SecondCameraSnapshot, SnapshotTransform,
    calibrate_with_second_camera,
};
pub use weakness::{Motion, WeakDirection, Weakness};
