//! A mirror from one picture's corners: the board on the robot, seen in the mirror.
//!
//! `cargo run -p mirror-core --example mirror_from_corners`

use mirror_core::camera::{Camera, Distortion};
use mirror_core::geometry::{Plane, Reflection};
use mirror_core::mirror::{Board, BoardView, EstimatorOptions, MirrorEstimator, Rig};
use nalgebra::{Isometry3, Vector2, Vector3};

/// Estimates the mirror by every estimator of the ladder and compares it with the one that made the picture.
pub fn main() -> Result<(), Box<dyn std::error::Error>> {
    let camera =
        Camera::new((800, 600), Vector2::new(693.0, 693.0), Vector2::new(399.5, 299.5), Distortion::None)?;
    let board = Board::new((7, 5), 0.014)?;
    // The board sits 75 mm below the camera and looks the way the camera looks.
    let camera_from_board = Isometry3::translation(0.004, 0.075, 0.01);
    let rig = Rig::new(camera, board, camera_from_board);

    // A made-up picture: corners reflected across a mirror 160 mm away, its normal turned a little.
    let truth = Plane::new(Vector3::new(0.1, -0.05, 1.0), 0.16)?;
    let reflection = Reflection::across(truth);
    let in_camera = rig.board.corners_in_board().into_iter().map(|corner| rig.camera_from_board * corner);
    let pixels = in_camera
        .map(|corner| rig.camera.project(&reflection.point(&corner)))
        .collect::<Result<Vec<_>, _>>()?;

    // From here on as with a real picture: pixels in, a plane with its covariance out.
    let view = BoardView::complete(&rig.board, &pixels)?;
    let options = EstimatorOptions { noise_px: Some(0.2), ..EstimatorOptions::default() };
    for estimator in MirrorEstimator::ALL {
        let mirror = estimator.estimate(&rig, &view, &options)?;
        let std_m = mirror.covariance_m2.diagonal().map(f64::sqrt);
        println!(
            "{:<18} distance {:.4} m, foot point ± {:.5} {:.5} {:.5} m",
            estimator.name(),
            mirror.plane.offset_m(),
            std_m.x,
            std_m.y,
            std_m.z
        );
        let off_m = (mirror.plane.foot_point() - truth.foot_point()).norm();
        assert!(off_m < 1e-6, "{} is off by {off_m} m", estimator.name());
    }
    Ok(())
}
