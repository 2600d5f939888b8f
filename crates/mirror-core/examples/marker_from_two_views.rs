//! A marker that the camera cannot see, from two pictures of it in a mirror that was held differently.
//!
//! `cargo run -p mirror-core --example marker_from_two_views`

use mirror_core::camera::{Camera, Distortion};
use mirror_core::geometry::{Plane, Reflection};
use mirror_core::mirror::{Board, BoardView, EstimatorOptions, MirrorEstimator, Rig};
use mirror_core::triangulate::{MarkerObservation, TriangulationOptions, Triangulator, triangulate_views};
use nalgebra::{Isometry3, Point3, Vector2, Vector3};

const NOISE_PX: f64 = 0.2;

/// Measures the marker by maximum likelihood and compares it with where it was put.
pub fn main() -> Result<(), Box<dyn std::error::Error>> {
    let camera =
        Camera::new((800, 600), Vector2::new(693.0, 693.0), Vector2::new(399.5, 299.5), Distortion::None)?;
    let rig = Rig::new(camera, Board::new((7, 5), 0.014)?, Isometry3::translation(0.004, 0.075, 0.01));
    let marker = Point3::new(0.06, 0.05, 0.03);

    let mut mirrors = Vec::new();
    let mut pixels = Vec::new();
    for normal in [Vector3::new(0.22, 0.0, 1.0), Vector3::new(-0.2, 0.1, 1.0)] {
        // A made-up picture: board and marker reflected across this mirror.
        let reflection = Reflection::across(Plane::new(normal, 0.16)?);
        let see = |point: Point3<f64>| rig.camera.project(&reflection.point(&point));
        let corners = rig.board.corners_in_board().into_iter().map(|c| see(rig.camera_from_board * c));
        let view = BoardView::complete(&rig.board, &corners.collect::<Result<Vec<_>, _>>()?)?;
        let options = EstimatorOptions { noise_px: Some(NOISE_PX), ..EstimatorOptions::default() };
        mirrors.push(MirrorEstimator::MaximumLikelihood.estimate(&rig, &view, &options)?);
        pixels.push(see(marker)?);
    }

    let seen: Vec<_> = (mirrors.iter().zip(pixels))
        .map(|(mirror, pixel)| MarkerObservation { mirror, pixel, noise_px: NOISE_PX })
        .collect();
    let options = TriangulationOptions::default();
    let found = triangulate_views(Triangulator::MaximumLikelihood, &rig.camera, &seen, &options)?;
    let std_mm = found.covariance_m2.diagonal().map(|variance| 1e3 * variance.sqrt());
    println!("marker in the camera's frame: {:.5} m", found.point_in_camera);
    println!("standard deviations: {:.2} {:.2} {:.2} mm", std_mm.x, std_mm.y, std_mm.z);
    println!("angle between the virtual rays: {:.1}°", found.parallax_rad.to_degrees());
    let off_m = (found.point_in_camera - marker).norm();
    assert!(off_m < 1e-6, "off by {off_m} m");
    Ok(())
}
