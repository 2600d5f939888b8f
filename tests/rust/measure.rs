//! Measuring a session view by view, on traced light: every estimator, grouping by posture, masks and refusals.

use crate::mirror::{Scene, pixels, scene};
use crate::traced::Glass;
use approx::assert_relative_eq;
use mirror_core::joint::{JointFrame, MarkerSighting, Via};
use mirror_core::measure::{MeasureOptions, measure_ladder};
use mirror_core::mirror::*;
use mirror_core::triangulate::Triangulator;
use mirror_core::{Cancel, Error};
use nalgebra::{Isometry3, Vector3};

const MARKERS: [[f64; 3]; 2] = [[0.06, 0.05, 0.03], [-0.05, 0.08, 0.02]];
/// How far the second posture's markers are from the first one's.
const MOVED: [f64; 3] = [0.01, -0.02, 0.005];

fn glasses() -> [Glass; 3] {
    let at = Vector3::new(0.0, 0.0, 0.16);
    [Glass::turned(at, 0.0, 0.0), Glass::turned(at, 0.25, 0.02), Glass::turned(at, -0.1, 0.15)]
}

fn marker(posture: i64, index: usize) -> Vector3<f64> {
    Vector3::from(MARKERS[index]) + Vector3::from(MOVED) * (posture as f64)
}

/// Two postures before three mirrors each, in an order that mixes the postures.
fn frames(scene: &Scene) -> Vec<JointFrame> {
    let order = [(1, 0), (0, 0), (0, 1), (1, 1), (1, 2), (0, 2)];
    let frame = |(posture, view): (i64, usize)| {
        let glass = &glasses()[view];
        JointFrame {
            posture,
            nominal_camera_from_board: scene.rig.camera_from_board,
            corners: BoardView::complete(&scene.rig.board, &pixels(scene, glass)).unwrap(),
            markers: (0..2)
                .map(|index| MarkerSighting {
                    marker: index,
                    pixel: scene.eye.pixel_in(glass, &marker(posture, index)),
                    via: Via::Mirror,
                })
                .collect(),
        }
    };
    order.into_iter().map(frame).collect()
}

fn points() -> [Sphere; 2] {
    [Sphere::of_diameter_m(0.0).unwrap(); 2]
}

fn options(estimator: MirrorEstimator) -> MeasureOptions {
    MeasureOptions {
        estimator,
        corners: EstimatorOptions { noise_px: Some(0.2), ..Default::default() },
        ..Default::default()
    }
}

#[test]
fn every_estimator_finds_the_traced_markers_of_both_postures() {
    let scene = scene([-0.21, 0.07, 8e-4, -6e-4, 0.0], 0.1, -0.1);
    let frames = frames(&scene);
    for estimator in MirrorEstimator::ALL {
        let done =
            measure_ladder(&scene.rig.camera, &scene.rig.board, &points(), &frames, &options(estimator))
                .unwrap();
        assert!(done.mirrors.iter().all(Result::is_ok));
        let told: Vec<_> = done.markers.iter().map(|m| (m.posture, m.marker, m.views)).collect();
        assert_eq!(told, [(0, 0, 3), (0, 1, 3), (1, 0, 3), (1, 1, 3)]);
        for found in &done.markers {
            let at = found.result.as_ref().unwrap();
            let truth = marker(found.posture, found.marker);
            assert_relative_eq!(at.point_in_camera.coords, truth, epsilon = 2e-7);
            assert!(at.covariance_m2.symmetric_eigenvalues().min() > 0.0);
            assert_eq!(at.pixel_fit.is_some(), estimator == MirrorEstimator::MaximumLikelihood);
        }
    }
}

#[test]
fn one_bad_mirror_costs_its_view_and_nothing_else() {
    let scene = scene([0.0; 5], 0.0, 0.0);
    let mut frames = frames(&scene);
    // A board that is given upside down and behind: its mirror would stand behind the camera.
    frames[1].nominal_camera_from_board = Isometry3::translation(0.0, 0.0, 5.0) * scene.rig.camera_from_board;
    let moved = measure_ladder(
        &scene.rig.camera,
        &scene.rig.board,
        &points(),
        &frames,
        &options(MirrorEstimator::PointPair),
    );
    assert!(matches!(moved, Err(Error::HeadMoved { posture: 0, by }) if by > 4.9));

    frames[1].posture = 7;
    let done = measure_ladder(
        &scene.rig.camera,
        &scene.rig.board,
        &points(),
        &frames,
        &options(MirrorEstimator::PointPair),
    )
    .unwrap();
    assert!(matches!(done.mirrors[1], Err(Error::MirrorBehind { .. })));
    let views: Vec<_> = done.markers.iter().map(|m| (m.posture, m.views, m.result.is_ok())).collect();
    assert_eq!(views, [(0, 2, true), (0, 2, true), (1, 3, true), (1, 3, true), (7, 0, false), (7, 0, false)]);
}

#[test]
fn markers_seen_directly_or_unknown_take_no_part() {
    let scene = scene([0.0; 5], 0.0, 0.0);
    let mut seen = frames(&scene);
    for frame in &mut seen {
        frame.markers[1].via = Via::Direct;
    }
    let run = |frames: &[JointFrame], options: &MeasureOptions| {
        measure_ladder(&scene.rig.camera, &scene.rig.board, &points(), frames, options)
    };
    let done = run(&seen, &MeasureOptions::default()).unwrap();
    assert!(done.markers.iter().all(|m| m.marker == 0) && done.markers.len() == 2);
    seen[0].markers[0].marker = 2;
    assert!(matches!(run(&seen, &MeasureOptions::default()), Err(Error::OutOfRange { .. })));

    let likelihood_of_no_mirror = MeasureOptions {
        estimator: MirrorEstimator::Pose,
        triangulator: Some(Triangulator::MaximumLikelihood),
        ..Default::default()
    };
    assert!(matches!(run(&frames(&scene), &likelihood_of_no_mirror), Err(Error::UnknownName { .. })));
    let noiseless = MeasureOptions { marker_noise_px: 0.0, ..Default::default() };
    assert!(matches!(run(&frames(&scene), &noiseless), Err(Error::OutOfRange { .. })));
    let stopped = MeasureOptions { cancel: Cancel::new(), ..Default::default() };
    stopped.cancel.cancel();
    assert!(matches!(run(&frames(&scene), &stopped), Err(Error::Cancelled)));
}

#[test]
fn a_ball_is_corrected_for_its_ellipse() {
    let scene = scene([0.0; 5], 0.0, 0.0);
    let mut frames = frames(&scene);
    let ball = Sphere::of_diameter_m(0.03).unwrap();
    // The centroid of a ball's picture is that of the point z − R²/z before the camera (Hartley and Zisserman, 8.3).
    for (frame, view) in frames.iter_mut().zip([0, 0, 1, 1, 2, 2]) {
        let glass = &glasses()[view];
        for sight in &mut frame.markers {
            let real = marker(frame.posture, sight.marker);
            let normal = glass.edges[0].cross(&glass.edges[1]);
            let behind = real + normal * (2.0 * normal.dot(&(glass.at - real)));
            let drawn = Vector3::new(behind.x, behind.y, behind.z - 0.015 * 0.015 / behind.z);
            sight.pixel = scene.eye.pixel(&drawn);
        }
    }
    let error = |spheres: [Sphere; 2]| {
        let options = options(MirrorEstimator::MaximumLikelihood);
        let done = measure_ladder(&scene.rig.camera, &scene.rig.board, &spheres, &frames, &options).unwrap();
        let each = done.markers.iter().map(|m| {
            (m.result.as_ref().unwrap().point_in_camera.coords - marker(m.posture, m.marker)).norm()
        });
        each.fold(0.0, f64::max)
    };
    assert!(error(points()) > 1e-4, "uncorrected the bias must show: {}", error(points()));
    assert!(error([ball; 2]) < 1e-5, "{}", error([ball; 2]));
}
