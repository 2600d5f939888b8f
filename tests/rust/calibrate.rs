//! Calibration of the camera–board transform against traced pictures: its errors, its covariance, its warnings.

use crate::traced::{Eye, Glass, noisy};
use mirror_core::calibrate::{
    MirrorViewOptions, Motion, SecondCameraRig, SecondCameraSnapshot, Weakness, calibrate_from_mirror_views,
    calibrate_with_second_camera,
};
use mirror_core::camera::{Camera, Distortion};
use mirror_core::geometry::rotation::difference;
use mirror_core::mirror::{Board, BoardView};
use mirror_core::{Cancel, Error};
use nalgebra::{Isometry3, Matrix6, Point3, UnitQuaternion, Vector2, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const NOISE_PX: f64 = 0.2;

fn camera() -> Camera {
    Camera::new((800, 600), Vector2::new(693.0, 693.0), Vector2::new(399.5, 299.5), Distortion::None).unwrap()
}

fn board() -> Board {
    Board::new((7, 5), 0.014).unwrap()
}

fn true_camera_from_board() -> Isometry3<f64> {
    Isometry3::from_parts(
        Vector3::new(0.004, 0.075, -0.006).into(),
        UnitQuaternion::from_euler_angles(0.03, -0.05, 0.04),
    )
}

/// Corner places of a board of nx × ny, by the session format's words.
fn places(nx: u32, ny: u32, square: f64) -> Vec<Point3<f64>> {
    (0..nx * ny)
        .map(|i| {
            let (ix, iy) = (f64::from(i % nx), f64::from(i / nx));
            Point3::new(
                (ix - (f64::from(nx) - 1.0) / 2.0) * square,
                (iy - (f64::from(ny) - 1.0) / 2.0) * square,
                0.0,
            )
        })
        .collect()
}

/// Mirrors turned by yaw and pitch (degrees), all at the same distance from the camera.
fn pictures(mirrors: &[(f64, f64)], distance: f64) -> Vec<Vec<Vector2<f64>>> {
    let at = |yaw: f64, pitch: f64| {
        let level = Glass::turned(Vector3::zeros(), yaw.to_radians(), pitch.to_radians());
        level.edges[0].cross(&level.edges[1]) * distance
    };
    pictures_at(mirrors, at)
}

/// Mirrors turned by yaw and pitch (degrees) through a point of each.
fn pictures_at(mirrors: &[(f64, f64)], at: impl Fn(f64, f64) -> Vector3<f64>) -> Vec<Vec<Vector2<f64>>> {
    mirrors
        .iter()
        .map(|(yaw, pitch)| {
            let glass = Glass::turned(at(*yaw, *pitch), yaw.to_radians(), pitch.to_radians());
            places(7, 5, 0.014)
                .iter()
                .map(|p| Eye::of_the_paper().pixel_in(&glass, &(true_camera_from_board() * p).coords))
                .collect()
        })
        .collect()
}

fn views(pictures: &[Vec<Vector2<f64>>], rng: &mut ChaCha8Rng) -> Vec<BoardView> {
    pictures
        .iter()
        .map(|pixels| {
            let noisy: Vec<_> = pixels.iter().map(|p| noisy(p, NOISE_PX, rng)).collect();
            BoardView::complete(&board(), &noisy).unwrap()
        })
        .collect()
}

const CROSS: [(f64, f64); 5] = [(0.0, 0.0), (-15.0, 0.0), (15.0, 0.0), (0.0, 15.0), (0.0, -15.0)];
const YAW_ONLY: [(f64, f64); 5] = [(0.0, 0.0), (-20.0, 0.0), (20.0, 0.0), (-10.0, 0.0), (10.0, 0.0)];

#[test]
fn a_cross_of_views_shows_the_transform_with_the_covariance_that_it_claims() {
    let mut rng = ChaCha8Rng::seed_from_u64(31);
    let pictures = pictures(&CROSS, 0.15);
    let options = MirrorViewOptions { corner_std_px: Some(NOISE_PX), ..MirrorViewOptions::default() };
    let stopped = MirrorViewOptions { cancel: Cancel::new(), ..options.clone() };
    stopped.cancel.cancel();
    let seen = views(&pictures, &mut rng);
    let end = calibrate_from_mirror_views(&camera(), &board(), &seen, &stopped);
    assert!(matches!(end, Err(Error::Cancelled)));
    let (mut squares, mut sum, mut covered) = (0.0, Vector3::zeros(), 0.0);
    let trials = 200.0;
    for _ in 0..200 {
        let found =
            calibrate_from_mirror_views(&camera(), &board(), &views(&pictures, &mut rng), &options).unwrap();
        let error = difference(&true_camera_from_board(), &found.camera_from_board);
        let squared = error.dot(&(found.covariance.try_inverse().unwrap() * error));
        squares += squared;
        covered += f64::from(u8::from(squared < 12.592));
        sum += error.fixed_rows::<3>(3).component_mul(&error.fixed_rows::<3>(3));
        assert!(found.weakness.warning().is_none(), "{:?}", found.weakness.warning());
        assert!(found.refused.is_empty() && found.views == [0, 1, 2, 3, 4]);
    }
    let rms_mm = sum.map(|s| (s / trials).sqrt() * 1e3);
    println!("cross: {:.2} / {:.2} / {:.2} mm RMS", rms_mm.x, rms_mm.y, rms_mm.z);
    // The figures known for such a cross: 0.28 / 0.23 / 0.79 mm.
    assert!(rms_mm.x < 0.4 && rms_mm.y < 0.4 && rms_mm.z < 0.9, "{rms_mm}");
    let mean = squares / trials;
    assert!((mean - 6.0).abs() < 4.0 * (12.0_f64 / trials).sqrt(), "mean of chi squared: {mean}");
    assert!((0.91..=0.99).contains(&(covered / trials)), "{}", covered / trials);
}

#[test]
fn by_yaw_alone_one_direction_is_nearly_blind_and_is_named() {
    let mut rng = ChaCha8Rng::seed_from_u64(32);
    let pictures = pictures(&YAW_ONLY, 0.15);
    let mut stds = Vec::new();
    for _ in 0..40 {
        let found = calibrate_from_mirror_views(
            &camera(),
            &board(),
            &views(&pictures, &mut rng),
            &MirrorViewOptions::default(),
        )
        .unwrap();
        let weak = found.weakness.weak_direction().unwrap();
        assert_eq!(weak.motion, Motion::Translation);
        let warning = found.weakness.warning().unwrap();
        assert!(warning.contains("translation along") && warning.contains("pitch"), "{warning}");
        // The claimed weakness is a real one: the error lies within four of its standard deviations.
        let error = difference(&true_camera_from_board(), &found.camera_from_board);
        assert!(error.fixed_rows::<3>(3).dot(&weak.axis_in_board).abs() < 4.0 * weak.std);
        stds.push(weak.std);
        if stds.len() == 1 {
            println!("{warning}");
        }
    }
    let mean = stds.iter().sum::<f64>() / 40.0;
    println!("yaw only: {:.2} mm", mean * 1e3);
    assert!((0.0025..0.0065).contains(&mean), "{mean}");
}

/// A mirror on a swivelling stand: all its poses share a line, and turning the board and each mirror about that line
/// changes no picture. No number of such views shows the transform.
#[test]
fn a_mirror_that_turns_about_its_own_stand_leaves_a_direction_blind() {
    let mut rng = ChaCha8Rng::seed_from_u64(37);
    let pictures = pictures_at(&YAW_ONLY, |_, _| Vector3::new(0.0, 0.0, 0.15));
    for _ in 0..10 {
        let found = calibrate_from_mirror_views(
            &camera(),
            &board(),
            &views(&pictures, &mut rng),
            &MirrorViewOptions::default(),
        )
        .unwrap();
        let warning = found.weakness.warning().unwrap();
        assert!(warning.contains("translation along") && warning.contains("rotation about"), "{warning}");
        assert!(found.weakness.rotation.std > 0.02, "{warning}");
        assert!(found.reprojection_mean_px < 0.3, "{}", found.reprojection_mean_px);
    }
}

/// Weak is a translation beyond a fiftieth of the board's diagonal, and a rotation beyond half a degree.
#[test]
fn weak_is_relative_to_the_diagonal_of_the_board_and_half_a_degree() {
    for (nx, ny) in [(8, 3), (3, 8)] {
        let board = Board::new((nx, ny), 0.02).unwrap();
        let limit_m = 0.02 * 0.02 * 73_f64.sqrt();
        for (share, weak) in [(0.97, false), (1.03, true)] {
            let mut covariance = Matrix6::identity() * 1e-12;
            covariance[(4, 4)] = (share * limit_m).powi(2);
            let found = Weakness::of(&covariance, &board).weak_direction();
            assert_eq!(found.map(|d| d.motion), weak.then_some(Motion::Translation), "{nx} x {ny}, {share}");
            covariance[(4, 4)] = 1e-12;
            covariance[(2, 2)] = (share * 0.5_f64.to_radians()).powi(2);
            let found = Weakness::of(&covariance, &board).weak_direction();
            assert_eq!(found.map(|d| d.motion), weak.then_some(Motion::Rotation), "{nx} x {ny}, {share}");
            covariance[(2, 2)] = 2.5_f64.to_radians().powi(2);
            covariance[(3, 3)] = 0.0123_f64.powi(2);
            let told = Weakness::of(&covariance, &board).warning().unwrap();
            let both = "translation along the board's x: 12.3 mm, and the rotation about the board's z: 2.50 degrees";
            assert!(told.contains(both), "{told}");
        }
    }
}

#[test]
fn a_prior_takes_the_place_of_the_missing_views() {
    let mut rng = ChaCha8Rng::seed_from_u64(33);
    let pictures = pictures(&YAW_ONLY[..2], 0.15);
    let views = views(&pictures, &mut rng);
    assert!(
        calibrate_from_mirror_views(&camera(), &board(), &views, &MirrorViewOptions::default())
            .unwrap_err()
            .to_string()
            .contains("mirror views")
    );
    let prior = Matrix6::identity() * 1e-6;
    let options =
        MirrorViewOptions { prior: Some((true_camera_from_board(), prior)), ..MirrorViewOptions::default() };
    let found = calibrate_from_mirror_views(&camera(), &board(), &views, &options).unwrap();
    assert!((prior - found.covariance).symmetric_eigenvalues().min() > -1e-15);
}

/// The corners alone tell their noise: a nominal transform that is off by two of the prior's deviations is no noise of the pictures.
#[test]
fn a_prior_that_is_off_is_not_taken_for_noise() {
    const TRUE_STD_PX: f64 = 0.05;
    let mut rng = ChaCha8Rng::seed_from_u64(36);
    let (turn_rad, shift_m) = (0.005, 0.001);
    let deviations = [turn_rad, turn_rad, turn_rad, shift_m, shift_m, shift_m].map(|s| s * s);
    let prior = Matrix6::from_diagonal(&deviations.into());
    let off = Isometry3::new(Vector3::new(2.0, -2.0, 2.0) * shift_m, Vector3::new(2.0, -2.0, 2.0) * turn_rad);
    let options = MirrorViewOptions {
        prior: Some((true_camera_from_board() * off, prior)),
        ..MirrorViewOptions::default()
    };
    for (mirrors, unsure) in [(&CROSS[..1], 0.3), (&CROSS[..3], 0.2), (&CROSS[..], 0.15)] {
        let pictures = pictures(mirrors, 0.15);
        let seen = |std: f64, rng: &mut ChaCha8Rng| -> Vec<BoardView> {
            let noisy_view = |pixels: &Vec<Vector2<f64>>| {
                let pixels: Vec<_> = pixels.iter().map(|p| noisy(p, std, rng)).collect();
                BoardView::complete(&board(), &pixels).unwrap()
            };
            pictures.iter().map(noisy_view).collect()
        };
        for _ in 0..5 {
            let views = seen(TRUE_STD_PX, &mut rng);
            let found = calibrate_from_mirror_views(&camera(), &board(), &views, &options).unwrap();
            let ratio = found.corner_std_px / TRUE_STD_PX;
            assert!((ratio - 1.0).abs() < unsure, "{} views: {ratio} of the true noise", mirrors.len());
            if mirrors.len() == 5 {
                let told = MirrorViewOptions { corner_std_px: Some(TRUE_STD_PX), ..options.clone() };
                let told = calibrate_from_mirror_views(&camera(), &board(), &views, &told).unwrap();
                let apart = difference(&told.camera_from_board, &found.camera_from_board);
                assert!(apart.fixed_rows::<3>(3).norm() < 2e-4, "as with the noise given: {apart}");
            }
        }
        // Corners without noise are no reason to fail.
        let found = calibrate_from_mirror_views(&camera(), &board(), &seen(0.0, &mut rng), &options).unwrap();
        assert!(found.corner_std_px < 1e-3, "{}", found.corner_std_px);
    }
}

#[test]
fn a_wrong_grid_is_refused_with_its_reason() {
    let mut rng = ChaCha8Rng::seed_from_u64(34);
    let mut pictures = pictures(&CROSS, 0.15);
    // One line of corners slipped by half a square's picture.
    for pixel in &mut pictures[3][28..] {
        pixel.y += 8.0;
    }
    let views = views(&pictures, &mut rng);
    let found =
        calibrate_from_mirror_views(&camera(), &board(), &views, &MirrorViewOptions::default()).unwrap();
    assert_eq!(found.views, [0, 1, 2, 4]);
    assert_eq!(found.refused.len(), 1);
    assert_eq!(found.refused[0].view, 3);
    assert!(found.refused[0].reason.to_string().contains("grid"), "{}", found.refused[0].reason);
    let error = difference(&true_camera_from_board(), &found.camera_from_board);
    assert!(error.fixed_rows::<3>(3).norm() < 0.004, "{error}");
    // With too few left, the reason of the refusal is the error.
    let error = calibrate_from_mirror_views(&camera(), &board(), &views[1..4], &MirrorViewOptions::default());
    assert!(error.unwrap_err().to_string().contains("grid"));
}

#[test]
fn a_mirror_that_never_turned_shows_nothing() {
    let mut rng = ChaCha8Rng::seed_from_u64(35);
    let pictures = pictures(&[(5.0, 3.0); 4], 0.15);
    match calibrate_from_mirror_views(
        &camera(),
        &board(),
        &views(&pictures, &mut rng),
        &MirrorViewOptions::default(),
    ) {
        Ok(found) => assert!(found.weakness.warning().is_some(), "{:?}", found.weakness),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

/// A second camera and a standing board around the robot, at places drawn at random.
fn snapshot(rng: &mut ChaCha8Rng, stand: &Board, noise: f64) -> SecondCameraSnapshot {
    let mut turn = |size: f64| {
        UnitQuaternion::from_euler_angles(
            rng.random_range(-size..size),
            rng.random_range(-size..size),
            rng.random_range(-size..size),
        )
    };
    // The robot looks along z. The standing board is before it, 0.35 m off, turned towards a place between robot and
    // second camera; the second camera stands behind that board's side and looks back.
    let robot_from_stand = Isometry3::from_parts(
        Vector3::new(-0.06, 0.02, 0.35).into(),
        turn(0.3) * UnitQuaternion::from_euler_angles(0.25, 0.9, 0.0),
    );
    let robot_from_second = Isometry3::from_parts(
        Vector3::new(0.33, 0.0, 0.42).into(),
        turn(0.05) * UnitQuaternion::from_euler_angles(0.0, -2.25, 0.0),
    );
    let second_from_robot = robot_from_second.inverse();
    let eye = Eye::of_the_paper();
    let mut see = |camera_from_board: Isometry3<f64>, corners: &[Point3<f64>], board: &Board| {
        let pixels: Vec<_> = corners
            .iter()
            .map(|p| {
                let at = (camera_from_board * p).coords;
                assert!(at.z > 0.05, "the test's scene is wrong: {at}");
                noisy(&eye.pixel(&at), noise, rng)
            })
            .collect();
        BoardView::complete(board, &pixels).unwrap()
    };
    let stand_corners = places(9, 6, 0.02);
    SecondCameraSnapshot {
        stand_in_robot_camera: see(robot_from_stand, &stand_corners, stand),
        stand_in_second_camera: see(second_from_robot * robot_from_stand, &stand_corners, stand),
        chest_in_second_camera: see(
            second_from_robot * true_camera_from_board(),
            &places(7, 5, 0.014),
            &board(),
        ),
    }
}

fn second_camera() -> (Board, SecondCameraRig) {
    let stand = Board::new((9, 6), 0.02).unwrap();
    let rig = SecondCameraRig {
        robot_camera: camera(),
        second_camera: camera(),
        chest_board: board(),
        stand_board: stand,
    };
    (stand, rig)
}

#[test]
fn a_second_camera_gives_the_transform_with_the_covariance_that_it_claims() {
    let mut rng = ChaCha8Rng::seed_from_u64(36);
    let (stand, rig) = second_camera();
    let (mut squares, mut consistency, mut translation) = (0.0, 0.0, 0.0);
    let trials = 150.0;
    for _ in 0..150 {
        let snapshots: Vec<_> = (0..4).map(|_| snapshot(&mut rng, &stand, NOISE_PX)).collect();
        let found = calibrate_with_second_camera(&rig, &snapshots, &Cancel::default()).unwrap();
        let error = difference(&true_camera_from_board(), &found.camera_from_board);
        squares += error.dot(&(found.covariance.try_inverse().unwrap() * error)) / trials;
        consistency += found.chi_squared / trials;
        translation += error.fixed_rows::<3>(3).norm_squared() / trials;
        assert_eq!(found.degrees_of_freedom, 18);
        assert_eq!(found.snapshots.len(), 4);
    }
    println!(
        "second camera, 4 snapshots: {:.2} mm RMS, chi squared {squares:.2} of 6",
        translation.sqrt() * 1e3
    );
    // The corner noise is estimated from some hundred residuals, which widens the tails by a few per cent.
    assert!((squares - 6.0).abs() < 4.0 * (12.0_f64 / trials).sqrt() + 0.3, "{squares}");
    assert!((consistency - 18.0).abs() < 4.0 * (36.0_f64 / trials).sqrt() + 0.9, "{consistency}");
    assert!(calibrate_with_second_camera(&rig, &[], &Cancel::default()).is_err());
}

#[test]
fn a_second_camera_of_many_snapshots_agrees_and_stops_when_it_is_cancelled() {
    let mut rng = ChaCha8Rng::seed_from_u64(37);
    let (stand, rig) = second_camera();
    // More than are asked for their agreement.
    let snapshots: Vec<_> = (0..150).map(|_| snapshot(&mut rng, &stand, NOISE_PX)).collect();
    let found = calibrate_with_second_camera(&rig, &snapshots, &Cancel::default()).unwrap();
    assert_eq!((found.snapshots.len(), found.degrees_of_freedom), (150, 6 * 149));
    let error = difference(&true_camera_from_board(), &found.camera_from_board);
    let squares = error.dot(&(found.covariance.try_inverse().unwrap() * error));
    // 99.99 % of chi squared with 6 degrees of freedom; an ambiguous pose of one snapshot that was chosen wrongly costs thousands.
    assert!(squares < 27.9, "{squares}");
    assert!((found.chi_squared / 894.0 - 1.0).abs() < 0.25, "{}", found.chi_squared);
    let stopped = Cancel::new();
    stopped.cancel();
    assert_eq!(calibrate_with_second_camera(&rig, &snapshots, &stopped), Err(Error::Cancelled));
}
