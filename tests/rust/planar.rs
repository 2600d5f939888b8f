//! The planar pose: exact from traced corners, robust face-on, a result or an error and never a number that is not one.

use crate::traced::Eye;
use approx::assert_relative_eq;
use mirror_core::camera::{Camera, Distortion};
use mirror_core::mirror::*;
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};
use proptest::prelude::*;

const LENS: [f64; 5] = [-0.21, 0.07, 8e-4, -6e-4, 0.01];

fn camera(lens: [f64; 5]) -> (Camera, Eye) {
    let eye = Eye { lens, ..Eye::of_the_paper() };
    let distortion = if lens == [0.0; 5] { Distortion::None } else { Distortion::PlumbBob(lens) };
    let focal = Vector2::new(eye.focal, eye.focal);
    (Camera::new((800, 600), focal, eye.centre, distortion).unwrap(), eye)
}

/// Sight lines to the corners by plain sums: x and y edges given as vectors, of either handedness.
fn seen(
    eye: &Eye,
    board: &Board,
    x: Vector3<f64>,
    y: Vector3<f64>,
    origin: Vector3<f64>,
) -> Vec<Vector2<f64>> {
    let (nx, ny) = board.corners();
    let mut pixels = Vec::new();
    for iy in 0..ny {
        for ix in 0..nx {
            let along = (ix as f64 - (nx as f64 - 1.0) / 2.0) * board.square_m();
            let down = (iy as f64 - (ny as f64 - 1.0) / 2.0) * board.square_m();
            pixels.push(eye.pixel(&(origin + x * along + y * down)));
        }
    }
    pixels
}

#[test]
fn exactly_face_on_without_noise_it_is_exact() {
    for lens in [[0.0; 5], LENS] {
        let (camera, eye) = camera(lens);
        for corners in [(7, 5), (2, 2), (8, 6), (3, 2)] {
            let board = Board::new(corners, 0.014).unwrap();
            for origin in
                [Vector3::new(0.0, 0.0, 0.3), Vector3::new(0.04, -0.03, 0.3), Vector3::new(0.0, 0.0, 3.0)]
            {
                // As seen directly, and as seen in a mirror (x reversed).
                for x in [Vector3::x(), -Vector3::x()] {
                    let pixels = seen(&eye, &board, x, Vector3::y(), origin);
                    let view = BoardView::complete(&board, &pixels).unwrap();
                    let pose = planar_pose(&camera, &view, &EstimatorOptions::default()).unwrap();
                    let got = pose.camera_from_pattern;
                    assert_relative_eq!(got.translation.vector, origin, epsilon = 1e-7);
                    // A tilt moves corners by its square alone: rounding in the pixels shows as its root.
                    assert_relative_eq!(got.rotation * Vector3::x(), x, epsilon = 1e-4);
                    assert!(pose.rms_px < 1e-6 && pose.covariance.iter().all(|c| c.is_finite()));
                }
            }
        }
    }
}

#[test]
fn far_away_both_tilts_are_told() {
    // At 3 m a board of 8 cm hardly shows perspective: the second pose explains it nearly as well.
    let (camera, eye) = camera([0.0; 5]);
    let board = Board::new((7, 5), 0.014).unwrap();
    let tilt = Rotation3::from_euler_angles(0.5, 0.3, 0.0);
    let pixels = seen(&eye, &board, tilt * Vector3::x(), tilt * Vector3::y(), Vector3::new(0.0, 0.0, 3.0));
    let view = BoardView::complete(&board, &pixels).unwrap();
    let pose = planar_pose(&camera, &view, &EstimatorOptions::default()).unwrap();
    let other = pose.alternative.expect("a second pose");
    assert_relative_eq!(
        pose.camera_from_pattern.rotation * Vector3::x(),
        tilt * Vector3::x(),
        epsilon = 1e-5
    );
    assert!(other.rms_px > pose.rms_px && other.rms_px < 0.1, "{}", other.rms_px);
    assert!(other.camera_from_pattern.rotation.angle_to(&pose.camera_from_pattern.rotation) > 0.5);
}

proptest! {
    #[test]
    fn any_visible_board_is_found(
        (rx, ry, rz) in (-1.0..1.0f64, -1.0..1.0f64, -3.1..3.1f64),
        (u, v, depth) in (-0.3..0.3f64, -0.2..0.2f64, 0.2..0.8f64),
        mirrored in any::<bool>(),
        missing in proptest::collection::hash_set(0..35usize, 0..20),
        distorted in any::<bool>(),
    ) {
        let (camera, eye) = camera(if distorted { LENS } else { [0.0; 5] });
        let board = Board::new((7, 5), 0.014).unwrap();
        let turned = Rotation3::from_euler_angles(rx, ry, rz);
        let x = turned * if mirrored { -Vector3::x() } else { Vector3::x() };
        let y = turned * Vector3::y();
        let origin = Vector3::new(u, v, 1.0) * depth;
        let pixels = seen(&eye, &board, x, y, origin);
        let detections: Vec<_> = (0..35)
            .filter(|i| !missing.contains(i))
            .map(|index| DetectedCorner { index, pixel: pixels[index] })
            .collect();
        let view = BoardView::new(&board, &detections).unwrap();
        let pose = planar_pose(&camera, &view, &EstimatorOptions::default()).unwrap();
        let truth = Isometry3::from_parts(
            Translation3::from(origin),
            UnitQuaternion::from_matrix(&Matrix3::from_columns(&[x, y, x.cross(&y)])),
        );
        for corner in board.corners_in_board() {
            assert_relative_eq!(pose.camera_from_pattern * corner, truth * corner, epsilon = 1e-6);
        }
    }

    #[test]
    fn rubbish_gives_a_result_or_an_error_and_no_nan(
        pixels in proptest::collection::vec((-50.0..850.0f64, -50.0..650.0f64), 6),
        flat in any::<bool>(),
    ) {
        let (camera, _) = camera([0.0; 5]);
        let board = Board::new((3, 2), 0.014).unwrap();
        let pixels: Vec<_> =
            pixels.iter().map(|&(u, v)| Vector2::new(u, if flat { 100.0 } else { v })).collect();
        let view = BoardView::complete(&board, &pixels).unwrap();
        if let Ok(pose) = planar_pose(&camera, &view, &EstimatorOptions::default()) {
            prop_assert!(pose.covariance.iter().all(|x| x.is_finite()));
            prop_assert!(pose.rms_px.is_finite());
            let at = pose.camera_from_pattern * Point3::new(0.014, 0.007, 0.0);
            prop_assert!(at.coords.iter().all(|x| x.is_finite()) && at.z > 0.0);
        }
        let rig = Rig::new(camera, board, Isometry3::translation(0.0, 0.075, 0.0));
        for estimator in MirrorEstimator::ALL {
            if let Ok(found) = estimator.estimate(&rig, &view, &EstimatorOptions::default()) {
                prop_assert!(found.covariance_m2.iter().all(|x| x.is_finite()));
                prop_assert!(found.plane.foot_point().iter().all(|x| x.is_finite()));
            }
        }
    }
}
