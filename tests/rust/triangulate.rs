//! Triangulation against traced light: exact without noise, refusals, sensitivities against differences, bias.

use crate::mirror::{pixels, scene};
use crate::traced::{Glass, noisy};
use approx::assert_relative_eq;
use mirror_core::camera::{Camera, Distortion};
use mirror_core::geometry::{Ray, Reflection, rotation};
use mirror_core::mirror::*;
use mirror_core::triangulate::*;
use mirror_core::{Cancel, Error};
use nalgebra::{Matrix6, Point3, Vector2, Vector3, Vector6};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const MARKER: [f64; 3] = [0.06, 0.05, 0.03];

fn glasses() -> [Glass; 3] {
    let at = Vector3::new(0.0, 0.0, 0.16);
    [Glass::turned(at, 0.0, 0.0), Glass::turned(at, 0.25, 0.02), Glass::turned(at, -0.1, 0.15)]
}

struct Seen {
    mirrors: Vec<MirrorEstimate>,
    pixels: Vec<Vector2<f64>>,
}

fn seen(
    scene: &crate::mirror::Scene,
    rig: &Rig,
    views: usize,
    error: impl Fn(usize) -> Vector2<f64>,
) -> Seen {
    let marker = Vector3::from(MARKER);
    let (mut mirrors, mut marks) = (Vec::new(), Vec::new());
    for (k, glass) in glasses().iter().take(views).enumerate() {
        let view = BoardView::complete(&rig.board, &pixels(scene, glass)).unwrap();
        let options = EstimatorOptions { noise_px: Some(0.2), ..Default::default() };
        mirrors.push(MirrorEstimator::MaximumLikelihood.estimate(rig, &view, &options).unwrap());
        marks.push(scene.eye.pixel_in(glass, &marker) + error(k));
    }
    Seen { mirrors, pixels: marks }
}

fn triangulated(
    way: Triangulator,
    rig: &Rig,
    seen: &Seen,
    options: &TriangulationOptions,
) -> mirror_core::Result<Triangulated> {
    let pairs = seen.mirrors.iter().zip(&seen.pixels);
    match way {
        Triangulator::MaximumLikelihood => {
            let views: Vec<_> = pairs.map(|(m, p)| MarkerView::new(m, *p, 0.2).unwrap()).collect();
            maximum_likelihood(&rig.camera, &views, options)
        }
        _ => {
            let rays: Vec<_> =
                pairs.map(|(m, p)| m.virtual_camera().ray(&rig.camera, p, 0.2).unwrap()).collect();
            match way {
                Triangulator::Midpoint => midpoint(&rays, options),
                Triangulator::LeeCiveraMid2 => lee_civera_mid2(&rays, options),
                _ => unbiased(&rays, options),
            }
        }
    }
}

#[test]
fn every_way_finds_the_traced_marker() {
    let scene = scene([-0.21, 0.07, 8e-4, -6e-4, 0.0], 0.1, -0.1);
    for views in [2, 3] {
        let seen = seen(&scene, &scene.rig, views, |_| Vector2::zeros());
        for way in Triangulator::ALL {
            let got = triangulated(way, &scene.rig, &seen, &TriangulationOptions::default());
            if matches!(way, Triangulator::LeeCiveraMid2 | Triangulator::Unbiased) && views == 3 {
                assert!(matches!(got, Err(Error::LengthMismatch { got: 3, needed: 2, .. })));
                continue;
            }
            let got = got.unwrap();
            // `unbiased` takes away the bias of the noise that it is told of: some micrometres.
            let near = if way == Triangulator::Unbiased { 5e-6 } else { 1e-7 };
            assert_relative_eq!(got.point_in_camera, Point3::from(MARKER), epsilon = near);
            assert!(got.rms_ray_distance_m < near);
            assert!(got.covariance_m2.cholesky().is_some());
        }
    }
}

#[test]
fn sensitivity_to_the_camera_board_transform_matches_differences() {
    let scene = scene([0.0; 5], 0.1, -0.1);
    for way in Triangulator::ALL {
        let run = |rig: &Rig| {
            let seen = seen(&scene, rig, 2, |_| Vector2::zeros());
            triangulated(way, rig, &seen, &TriangulationOptions::default()).unwrap()
        };
        let at = run(&scene.rig);
        for axis in 0..6 {
            let moved = |h: f64| {
                let mut step = Vector6::zeros();
                step[axis] = h;
                let camera_from_board = rotation::moved(&scene.rig.camera_from_board, &step);
                run(&Rig { camera_from_board, ..scene.rig.clone() }).point_in_camera
            };
            let difference = (moved(1e-5) - moved(-1e-5)) / 2e-5;
            let claimed = at.point_by_camera_from_board.column(axis).into_owned();
            // At the larger angles of these steps maximum likelihood's own rays disagree slightly: 1 %.
            assert_relative_eq!(difference, claimed, epsilon = 5e-3, max_relative = 1e-2);
        }
    }
}

#[test]
fn maximum_likelihood_with_a_shared_error_has_the_full_covariance() {
    // Eliminating the shared error in the normal equations against the whole covariance written out.
    let scene = scene([0.0; 5], 0.1, -0.1);
    let seen = seen(&scene, &scene.rig, 3, |k| Vector2::new(0.1, -0.2) * k as f64);
    let root = Matrix6::from_fn(|i, j| 1e-3 * ((3 * i + 5 * j) as f64).sin());
    let shared = root * root.transpose();
    let options = TriangulationOptions { camera_from_board_covariance: Some(shared), ..Default::default() };
    let got = triangulated(Triangulator::MaximumLikelihood, &scene.rig, &seen, &options).unwrap();
    let mut whole = nalgebra::SMatrix::<f64, 6, 6>::identity() * 0.04;
    let mut by_point = nalgebra::SMatrix::<f64, 6, 3>::zeros();
    let mut by_shared = Matrix6::zeros();
    for k in 0..3 {
        // By differences of the reflection's own formula.
        let pixel = |foot: Vector3<f64>, x: Vector3<f64>| {
            let n = foot.normalize();
            let r = x + n * (2.0 * (foot.norm() - n.dot(&x)));
            scene.eye.pixel(&r)
        };
        let foot = seen.mirrors[k].plane.foot_point();
        let mut by_foot = nalgebra::Matrix2x3::zeros();
        let mut at_point = nalgebra::Matrix2x3::zeros();
        for axis in 0..3 {
            let mut h = Vector3::zeros();
            h[axis] = 1e-6;
            let x = got.point_in_camera.coords;
            by_foot.set_column(axis, &((pixel(foot + h, x) - pixel(foot - h, x)) / 2e-6));
            at_point.set_column(axis, &((pixel(foot, x + h) - pixel(foot, x - h)) / 2e-6));
        }
        if k < 3 {
            by_point.fixed_view_mut::<2, 3>(2 * k, 0).copy_from(&at_point);
            by_shared
                .fixed_view_mut::<2, 6>(2 * k, 0)
                .copy_from(&(by_foot * seen.mirrors[k].foot_by_camera_from_board));
            let mut block = whole.fixed_view_mut::<2, 2>(2 * k, 2 * k);
            block += by_foot * seen.mirrors[k].measurement_covariance_m2 * by_foot.transpose();
        }
    }
    whole += by_shared * shared * by_shared.transpose();
    let information = by_point.transpose() * whole.try_inverse().unwrap() * by_point;
    let expected = information.try_inverse().unwrap();
    assert_relative_eq!(got.covariance_m2, expected, max_relative = 1e-4, epsilon = 1e-12);
}

#[test]
fn too_little_parallax_says_how_much_there_is_and_how_much_is_needed() {
    let scene = scene([0.0; 5], 0.0, 0.0);
    let both = seen(&scene, &scene.rig, 2, |_| Vector2::zeros());
    let twice = Seen {
        mirrors: vec![both.mirrors[0].clone(), both.mirrors[0].clone()],
        pixels: vec![both.pixels[0], both.pixels[0] + Vector2::new(3.0, 0.0)],
    };
    for way in Triangulator::ALL {
        match triangulated(way, &scene.rig, &twice, &TriangulationOptions::default()) {
            Err(Error::TooLittleParallax { got_rad, needed_rad }) => {
                // Three pixels at 693 px, some way off the axis.
                assert!(got_rad > 0.8 * 3.0 / 693.0 && got_rad < 3.0 / 693.0, "{got_rad}");
                assert_relative_eq!(needed_rad, 1f64.to_radians());
            }
            other => panic!("{way:?}: {other:?}"),
        }
    }
    let one = midpoint(&[], &TriangulationOptions::default());
    assert!(matches!(one, Err(Error::LengthMismatch { got: 0, needed: 2, .. })));
}

#[test]
fn points_on_the_wrong_side_are_refused() {
    let scene = scene([0.0; 5], 0.0, 0.0);
    let mut crossed = seen(&scene, &scene.rig, 2, |_| Vector2::zeros());
    crossed.pixels[1] += Vector2::new(430.0, 0.0);
    for way in Triangulator::ALL {
        let got = triangulated(way, &scene.rig, &crossed, &TriangulationOptions::default());
        assert!(matches!(got, Err(Error::WrongSide { .. })), "{way:?}: {got:?}");
    }
    let a = Ray::new(Point3::new(0.0, 0.0, 1.0), Vector3::new(0.1, 0.0, -1.0)).unwrap();
    let b = Ray::new(Point3::new(0.1, 0.0, 1.0), Vector3::new(0.3, 0.0, -1.0)).unwrap();
    assert!(matches!(midpoint_of_two(&a, &b, 0.01), Err(Error::WrongSide { .. })));
}

/// Rays that meet between the virtual cameras and the mirror: light has no such way.
#[test]
fn points_behind_the_mirror_are_refused() {
    let scene = scene([0.0; 5], 0.0, 0.0);
    let mut behind = seen(&scene, &scene.rig, 2, |_| Vector2::zeros());
    let point = Vector3::new(0.03, 0.02, 0.2);
    for (mirror, pixel) in behind.mirrors.iter().zip(&mut behind.pixels) {
        let (n, d) = (mirror.plane.normal().into_inner(), mirror.plane.foot_point().norm());
        assert!(n.dot(&point) > d + 0.02);
        *pixel = scene.eye.pixel(&(point + n * (2.0 * (d - n.dot(&point)))));
    }
    for way in Triangulator::ALL {
        let got = triangulated(way, &scene.rig, &behind, &TriangulationOptions::default());
        assert!(matches!(got, Err(Error::WrongSide { place: "behind the mirror", .. })), "{way:?}: {got:?}");
    }
    // So are they in bulk: the board's origin and its reflections make the same planes.
    let board = Point3::new(0.0, 0.05, 0.0);
    let reflected = |k: usize| {
        let plane = &behind.mirrors[k].plane;
        Reflection::across(*plane).point(&board)
    };
    let (a, b) = (reflected(0), reflected(1));
    let boards = [[a.x, a.y, a.z, b.x, b.y, b.z]];
    let pixels = [[behind.pixels[0].x, behind.pixels[0].y, behind.pixels[1].x, behind.pixels[1].y]];
    let batch =
        point_pair_markers(&scene.rig.camera, &board, &boards, &pixels, 0.01, &Cancel::default()).unwrap();
    assert!(
        matches!(batch.refused[0].error, Error::WrongSide { place: "behind the mirror", .. }),
        "{batch:?}"
    );
}

#[test]
fn lines_cross_by_a_right_angle_at_most() {
    let camera =
        Camera::new((800, 600), Vector2::new(693.0, 693.0), Vector2::new(400.0, 300.0), Distortion::None)
            .unwrap();
    let markers = |least| point_pair_markers(&camera, &Point3::origin(), &[], &[], least, &Cancel::default());
    assert!(markers(1.5).is_ok());
    for least in [1.6, 0.0, -0.1, f64::NAN] {
        assert!(markers(least).is_err(), "{least}");
    }
}

#[test]
fn midpoint_of_two_is_the_least_squares_point() {
    let scene = scene([0.0; 5], 0.1, -0.1);
    let seen = seen(&scene, &scene.rig, 2, |k| Vector2::new(4.0, -7.0) * k as f64);
    let least_squares =
        triangulated(Triangulator::Midpoint, &scene.rig, &seen, &TriangulationOptions::default()).unwrap();
    let rays: Vec<_> = (0..2)
        .map(|k| virtual_ray(&scene.rig.camera, &seen.mirrors[k].plane, &seen.pixels[k]).unwrap())
        .collect();
    let closest = midpoint_of_two(&rays[0], &rays[1], 0.01).unwrap();
    assert!(least_squares.rms_ray_distance_m > 1e-4);
    assert_relative_eq!(closest, least_squares.point_in_camera, epsilon = 1e-12);
}

#[test]
fn biases_at_small_parallax_are_as_told() {
    let scene = scene([0.0; 5], 0.0, 0.0);
    let both = seen(&scene, &scene.rig, 2, |_| Vector2::zeros());
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let glass = [glasses()[0], Glass::turned(Vector3::new(0.0, 0.0, 0.16), 0.06, 0.0)];
    let marker = Vector3::from(MARKER);
    let mut mirrors = both.mirrors;
    let view = BoardView::complete(&scene.rig.board, &pixels(&scene, &glass[1])).unwrap();
    mirrors[1] =
        MirrorEstimator::PointPair.estimate(&scene.rig, &view, &EstimatorOptions::default()).unwrap();
    let exact = glass.map(|g| scene.eye.pixel_in(&g, &marker));
    const TRIALS: usize = 8000;
    const NOISE_PX: f64 = 4.0;
    // No trial may be left out: that would be a bias of the test's own.
    let all = TriangulationOptions { least_parallax_rad: 1e-6, ..Default::default() };
    let ways = [Triangulator::Midpoint, Triangulator::LeeCiveraMid2, Triangulator::Unbiased];
    // Depth is where the bias is: away from the mirror is down in z.
    let mut depths = ways.map(|_| Vec::with_capacity(TRIALS));
    for _ in 0..TRIALS {
        // Antithetic pairs: the first-order error cancels, the bias stays.
        let noise = exact.map(|p| noisy(&p, NOISE_PX, &mut rng) - p);
        for sign in [1.0, -1.0] {
            let rays: Vec<_> = (0..2)
                .map(|k| {
                    let pixel = exact[k] + noise[k] * sign;
                    mirrors[k].virtual_camera().ray(&scene.rig.camera, &pixel, NOISE_PX).unwrap()
                })
                .collect();
            for (depths, way) in depths.iter_mut().zip(ways) {
                let got = match way {
                    Triangulator::Midpoint => midpoint(&rays, &all),
                    Triangulator::LeeCiveraMid2 => lee_civera_mid2(&rays, &all),
                    _ => unbiased(&rays, &all),
                };
                depths.push(got.unwrap().point_in_camera.z - marker.z);
            }
        }
    }
    let means = depths.each_ref().map(|d| d.iter().sum::<f64>() / d.len() as f64 * 1e3);
    let medians = depths.each_mut().map(|d| {
        d.sort_by(f64::total_cmp);
        d[d.len() / 2] * 1e3
    });
    println!("mean bias {means:.3?} mm, median bias {medians:.3?} mm");
    assert!(medians[0] > 3.0 && medians[1] < 0.6 * medians[0]);
    assert!(means[1] < -1.5 && means[2].abs() < 0.3 * means[1].abs(), "{means:?}");
}

/// Two views of a marker through a lens, by formulas written out here: reflected boards and pixels.
fn two_views(camera: &Camera, board: &Vector3<f64>, rng: &mut ChaCha8Rng) -> ([f64; 6], [f64; 4]) {
    let mut one = |low: f64, high: f64| rng.random_range(low..high);
    let marker = Vector3::new(one(-0.09, 0.09), one(0.02, 0.1), one(0.0, 0.04));
    let (mut boards, mut pixels) = ([0.0; 6], [0.0; 4]);
    for view in 0..2 {
        let normal = Vector3::new(0.25 * view as f64 + one(-0.03, 0.03), one(-0.03, 0.03), 1.0).normalize();
        let distance = one(0.14, 0.16);
        let reflected = |p: &Vector3<f64>| p + normal * (2.0 * (distance - normal.dot(p)));
        boards[3 * view..3 * view + 3].copy_from_slice(reflected(board).as_slice());
        let pixel = camera.project(&Point3::from(reflected(&marker))).unwrap();
        pixels[2 * view..2 * view + 2].copy_from_slice(pixel.as_slice());
    }
    (boards, pixels)
}

#[test]
fn a_batch_says_what_its_rows_say_one_by_one() {
    let lenses = [
        Distortion::None,
        Distortion::PlumbBob([-0.21, 0.07, 8e-4, -6e-4, 0.01]),
        // Folds at a tangent of 1.05, and rises again.
        Distortion::PlumbBob([-0.45, 0.08, 2e-4, -1e-4, 0.0]),
        Distortion::RationalPolynomial([0.3, 0.1, 1e-3, -1e-3, 0.02, 0.6, 0.2, 0.03]),
        Distortion::Equidistant([0.02, -0.01, 0.004, -0.001]),
    ];
    let least = 0.0175;
    let board = Vector3::new(0.0, 0.075, 0.0);
    for lens in lenses {
        let camera =
            Camera::new((800, 600), Vector2::new(693.0, 700.0), Vector2::new(399.5, 290.0), lens).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(12);
        // More than one share, and no multiple of anything.
        let (mut boards, mut pixels): (Vec<_>, Vec<_>) =
            (0..2300).map(|_| two_views(&camera, &board, &mut rng)).unzip();
        // What has no result, beside rows that have one, in the first and in the last block.
        for first in [3, 2291] {
            boards[first][..3].copy_from_slice(board.as_slice());
            boards[first + 1][4] = f64::INFINITY;
            boards[first + 2].copy_within(..3, 3);
            pixels[first + 2].copy_within(..2, 2);
            pixels[first + 3][1] = f64::NAN;
            pixels[first + 4][0] = 1e30;
            // Far outside the picture: beyond the fold of some lenses.
            pixels[first + 5] = [-2500.0, 900.0, -2500.0, 300.0];
            // Rays that meet behind their starts.
            pixels[first + 6].rotate_left(2);
            // Beyond the fold, where another ray comes to the same pixel.
            pixels[first + 7][..2].copy_from_slice(&[399.5 + 693.0 * 2.3717, 290.0]);
            // A parallax of a thousandth.
            boards[first + 8].copy_within(..3, 3);
            boards[first + 8][3] += 2e-4;
            pixels[first + 8].copy_within(..2, 2);
        }
        let origin = Point3::from(board);
        let batch =
            point_pair_markers(&camera, &origin, &boards, &pixels, least, &Cancel::default()).unwrap();
        let mut refused = batch.refused.iter();
        for row in 0..boards.len() {
            let (b, p) = (boards[row], pixels[row]);
            let views = TwoViews {
                reflected_boards: [Point3::new(b[0], b[1], b[2]), Point3::new(b[3], b[4], b[5])],
                pixels: [Vector2::new(p[0], p[1]), Vector2::new(p[2], p[3])],
            };
            let got = Point3::from(batch.points_m[row]);
            match point_pair_marker(&camera, &origin, &views, least) {
                Ok(point) => {
                    let off = (got - point).norm() / (1.0 + point.coords.norm());
                    assert!(off < 1e-11, "{lens:?} row {row}: {got} {point}");
                }
                Err(error) => {
                    let told = refused.next().unwrap();
                    assert_eq!((told.row, told.error.to_string()), (row, error.to_string()), "{lens:?}");
                    assert!(got.coords.iter().all(|x| x.is_nan()), "{lens:?} row {row}: {got}");
                }
            }
        }
        assert_eq!(refused.next(), None, "{lens:?}");
        assert!(batch.refused.len() >= 10, "{lens:?}: {:?}", batch.refused);
    }
}
