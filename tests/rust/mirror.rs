//! The ladder of mirror estimators against traced light: exact without noise, labels, Jacobians, refusals.

use crate::traced::{Eye, Glass};
use approx::assert_relative_eq;
use mirror_core::Error;
use mirror_core::camera::{Camera, Distortion};
use mirror_core::geometry::rotation;
use mirror_core::mirror::*;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector2, Vector3};

/// Edge points of a board in the camera frame, by plain trigonometry: x to the right, y down, turned by yaw and pitch.
pub fn board_points(origin: Vector3<f64>, glass_like: [Vector3<f64>; 2]) -> Vec<Vector3<f64>> {
    let mut points = Vec::new();
    for iy in 0..5 {
        for ix in 0..7 {
            let (x, y) = ((f64::from(ix) - 3.0) * 0.014, (f64::from(iy) - 2.0) * 0.014);
            points.push(origin + glass_like[0] * x + glass_like[1] * y);
        }
    }
    points
}

/// A rig with a turned board, and the same thing as plain numbers for the tracer.
pub struct Scene {
    pub rig: Rig,
    pub eye: Eye,
    pub corners: Vec<Vector3<f64>>,
}

pub fn scene(lens: [f64; 5], yaw: f64, pitch: f64) -> Scene {
    let eye = Eye { lens, ..Eye::of_the_paper() };
    let origin = Vector3::new(0.004, 0.075, 0.01);
    let turned = Glass::turned(origin, yaw, pitch);
    let [x, y] = turned.edges;
    let matrix = nalgebra::Matrix3::from_columns(&[x, y, x.cross(&y)]);
    let rotation = UnitQuaternion::from_matrix(&matrix);
    let distortion = if lens == [0.0; 5] { Distortion::None } else { Distortion::PlumbBob(lens) };
    let camera = Camera::new((800, 600), Vector2::new(693.0, 693.0), eye.centre, distortion).unwrap();
    let camera_from_board = Isometry3::from_parts(Translation3::from(origin), rotation);
    let rig = Rig::new(camera, Board::new((7, 5), 0.014).unwrap(), camera_from_board);
    Scene { rig, eye, corners: board_points(origin, turned.edges) }
}

pub fn pixels(scene: &Scene, glass: &Glass) -> Vec<Vector2<f64>> {
    scene.corners.iter().map(|x| scene.eye.pixel_in(glass, x)).collect()
}

/// The plane that was traced, told by a normal from its edges.
pub fn truth(glass: &Glass) -> (Vector3<f64>, f64) {
    let n = glass.edges[0].cross(&glass.edges[1]).normalize();
    let n = if n.dot(&glass.at) < 0.0 { -n } else { n };
    (n, n.dot(&glass.at))
}

const LENSES: [[f64; 5]; 2] = [[0.0; 5], [-0.21, 0.07, 8e-4, -6e-4, 0.0]];

#[test]
fn every_estimator_finds_the_traced_mirror() {
    for lens in LENSES {
        for (board_yaw, board_pitch) in [(0.0, 0.0), (0.2, -0.1)] {
            let scene = scene(lens, board_yaw, board_pitch);
            for (yaw, pitch) in [(0.0, 0.0), (0.15, 0.0), (-0.1, 0.12), (0.05, -0.08)] {
                let glass = Glass::turned(Vector3::new(0.0, 0.0, 0.16), yaw, pitch);
                let view = BoardView::complete(&scene.rig.board, &pixels(&scene, &glass)).unwrap();
                let (n, d) = truth(&glass);
                for estimator in MirrorEstimator::ALL {
                    let found = estimator.estimate(&scene.rig, &view, &EstimatorOptions::default()).unwrap();
                    assert_relative_eq!(found.plane.normal().into_inner(), n, epsilon = 1e-7);
                    assert_relative_eq!(found.plane.offset_m(), d, epsilon = 1e-8);
                    assert!(found.rms_px < 1e-5, "{estimator:?}: {}", found.rms_px);
                    // The virtual ray of a corner passes through the corner itself: the handedness is right.
                    let camera = found.virtual_camera();
                    for index in [0, 6, 17, 34] {
                        let pixel = view.corners()[index].pixel;
                        let ray = camera.ray(&scene.rig.camera, &pixel, 0.2).unwrap().ray;
                        assert!(ray.distance_m(&Point3::from(scene.corners[index])) < 1e-7, "{estimator:?}");
                    }
                }
            }
        }
    }
}

#[test]
fn the_reflected_board_with_true_labels_is_left_handed() {
    let scene = scene([0.0; 5], 0.0, 0.0);
    let glass = Glass::turned(Vector3::new(0.0, 0.0, 0.16), 0.1, 0.05);
    let view = BoardView::complete(&scene.rig.board, &pixels(&scene, &glass)).unwrap();
    let pose = planar_pose(&scene.rig.camera, &view, &EstimatorOptions::default()).unwrap();
    // D's z axis points away from the camera, the reflected board's towards it.
    let d = pose.camera_from_pattern;
    assert!((d.rotation * Vector3::z()).dot(&d.translation.vector) > 0.0);
    let reflected = mirror_core::geometry::ImproperIsometry::with_z_reversed(&d);
    // A point off the board's plane tells: traced, and by the left-handed frame.
    let off = scene.rig.camera_from_board * Point3::new(0.01, -0.02, 0.015);
    let traced = scene.eye.pixel_in(&glass, &off.coords);
    let seen = scene.rig.camera.project(&reflected.point(&Point3::new(0.01, -0.02, 0.015))).unwrap();
    assert_relative_eq!(seen, traced, epsilon = 1e-6);
}

#[test]
fn labels_turned_by_half_a_turn_cost_eq1_the_marker_and_eq2_nothing() {
    let scene = scene([0.0; 5], 0.0, 0.0);
    let glass = Glass::turned(Vector3::new(0.0, 0.0, 0.16), 0.05, 0.02);
    let mut turned = pixels(&scene, &glass);
    turned.reverse();
    let view = BoardView::complete(&scene.rig.board, &turned).unwrap();
    let marker = Vector3::new(0.06, 0.05, 0.03);
    let pixel = scene.eye.pixel_in(&glass, &marker);
    let distance = |estimator: MirrorEstimator| {
        let found = estimator.estimate(&scene.rig, &view, &EstimatorOptions::default());
        found.map(|f| {
            let ray = f.virtual_camera().ray(&scene.rig.camera, &pixel, 0.2).unwrap().ray;
            ray.distance_m(&Point3::from(marker))
        })
    };
    assert!(distance(MirrorEstimator::PointPair).unwrap() < 1e-7);
    // Far off, or refused at once.
    assert!(distance(MirrorEstimator::Pose).is_err() || distance(MirrorEstimator::Pose).unwrap() > 0.02);
}

#[test]
fn covariances_carry_the_camera_board_transform() {
    // Jacobians by the camera-board transform against differences of the whole estimator.
    let scene = scene(LENSES[1], 0.2, -0.1);
    let glass = Glass::turned(Vector3::new(0.0, 0.0, 0.16), 0.15, 0.08);
    let mut seen = pixels(&scene, &glass);
    for (i, pixel) in seen.iter_mut().enumerate() {
        // Fixed small errors: a residual must not spoil Eq. 1 and Eq. 2, which do not weigh it.
        *pixel += Vector2::new((i as f64 * 2.7).sin(), (i as f64 * 1.3).cos()) * 0.01;
    }
    let view = BoardView::complete(&scene.rig.board, &seen).unwrap();
    let options = EstimatorOptions { smallest_decrease_px2: 1e-18, ..Default::default() };
    for estimator in MirrorEstimator::ALL {
        let at = estimator.estimate(&scene.rig, &view, &options).unwrap();
        let moved = |axis: usize, h: f64| {
            let mut rig = scene.rig.clone();
            let mut step = nalgebra::Vector6::zeros();
            step[axis] = h;
            rig.camera_from_board = rotation::moved(&rig.camera_from_board, &step);
            estimator.estimate(&rig, &view, &options).unwrap()
        };
        for axis in 0..6 {
            let (ahead, behind) = (moved(axis, 1e-5), moved(axis, -1e-5));
            let foot = (ahead.plane.foot_point() - behind.plane.foot_point()) / 2e-5;
            let claimed = at.foot_by_camera_from_board.column(axis).into_owned();
            // Maximum likelihood leaves out second derivatives times the residual: hence 1 %.
            assert_relative_eq!(foot, claimed, epsilon = 2e-3, max_relative = 1e-2);
            let pixel = Vector2::new(500.0, 420.0);
            let ray = |e: &MirrorEstimate| {
                let ray = e.virtual_camera().ray(&scene.rig.camera, &pixel, 0.2).unwrap().ray;
                (ray.origin.coords, ray.direction.into_inner())
            };
            let claimed =
                at.virtual_camera().ray(&scene.rig.camera, &pixel, 0.2).unwrap().by_camera_from_board;
            let ((o1, d1), (o0, d0)) = (ray(&ahead), ray(&behind));
            assert_relative_eq!(
                (o1 - o0) / 2e-5,
                claimed.fixed_view::<3, 1>(0, axis).into_owned(),
                epsilon = 5e-3,
                max_relative = 1e-2
            );
            assert_relative_eq!(
                (d1 - d0) / 2e-5,
                claimed.fixed_view::<3, 1>(3, axis).into_owned(),
                epsilon = 2e-2,
                max_relative = 1e-2
            );
        }
    }
}

#[test]
fn point_pair_jacobians_match_differences() {
    let (b, r) = (Point3::new(0.01, 0.07, 0.02), Point3::new(0.03, 0.09, 0.33));
    let at = point_pair_plane(&b, &r).unwrap();
    for axis in 0..3 {
        let mut h = Vector3::zeros();
        h[axis] = 1e-6;
        let foot = |b: &Point3<f64>, r: &Point3<f64>| point_pair_plane(b, r).unwrap().plane.foot_point();
        let by_b = (foot(&(b + h), &r) - foot(&(b - h), &r)) / 2e-6;
        let by_r = (foot(&b, &(r + h)) - foot(&b, &(r - h))) / 2e-6;
        assert_relative_eq!(by_b, at.foot_by_point.column(axis).into_owned(), epsilon = 1e-7);
        assert_relative_eq!(by_r, at.foot_by_reflection.column(axis).into_owned(), epsilon = 1e-7);
    }
}

#[test]
fn bad_views_are_refused_with_their_reason() {
    let board = Board::new((7, 5), 0.014).unwrap();
    let corner = |index, u| DetectedCorner { index, pixel: Vector2::new(u, 100.0 + index as f64) };
    assert!(matches!(Board::new((1, 5), 0.014), Err(Error::OutOfRange { .. })));
    assert!(matches!(Board::new((7, 5), 0.0), Err(Error::OutOfRange { .. })));
    let view = |corners: &[DetectedCorner]| BoardView::new(&board, corners);
    assert!(matches!(view(&[corner(35, 1.0)]), Err(Error::CornerOutsideBoard { index: 35, nx: 7, ny: 5 })));
    assert!(matches!(view(&[corner(3, 1.0), corner(3, 2.0)]), Err(Error::CornerTwice { index: 3 })));
    assert!(matches!(view(&[corner(3, f64::NAN)]), Err(Error::NotFinite { .. })));
    assert!(matches!(
        view(&[corner(0, 1.0), corner(1, 2.0), corner(8, 3.0)]),
        Err(Error::CornersDegenerate { got: 3, .. })
    ));
    let line: Vec<_> = (0..7).map(|i| corner(i, 10.0 * i as f64)).collect();
    assert!(matches!(view(&line), Err(Error::CornersDegenerate { got: 7, .. })));
    // So are those of a diagonal.
    let diagonal: Vec<_> = (0..5).map(|i| corner(8 * i, 10.0 * i as f64)).collect();
    assert!(matches!(view(&diagonal), Err(Error::CornersDegenerate { got: 5, .. })));
    // Of all but one on a line a family of homographies fits: its plane would be anywhere.
    for lonely in [7, 20] {
        let mut all_but_one: Vec<_> = (0..7).map(|i| corner(i, 10.0 * i as f64)).collect();
        all_but_one.insert(0, corner(lonely, 3.0));
        assert!(matches!(view(&all_but_one), Err(Error::CornersDegenerate { got: 8, .. })));
        all_but_one.push(corner(30, 5.0));
        assert!(view(&all_but_one).is_ok());
    }
    // A picture that collapses to one pixel: an error of every estimator, no number that is not one.
    let scene = scene([0.0; 5], 0.0, 0.0);
    let flat = BoardView::complete(&board, &[Vector2::new(300.0, 200.0); 35]).unwrap();
    for estimator in MirrorEstimator::ALL {
        assert!(estimator.estimate(&scene.rig, &flat, &EstimatorOptions::default()).is_err());
    }
    assert!(matches!(MirrorEstimator::from_name("best"), Err(Error::UnknownName { .. })));
}
