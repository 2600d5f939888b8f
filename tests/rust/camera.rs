//! The camera against differences and against itself: Jacobians, and an inverse that is exact over the whole picture.

use approx::assert_relative_eq;
use mirror_core::camera::{Camera, Distortion};
use nalgebra::{Point3, Vector2, Vector3};
use proptest::prelude::*;

fn lenses() -> Vec<Distortion> {
    vec![
        Distortion::None,
        Distortion::PlumbBob([-0.28, 0.09, 1e-3, -8e-4, -0.012]),
        Distortion::PlumbBob([0.12, -0.2, 2e-3, 1e-3, 0.05]),
        Distortion::RationalPolynomial([0.42, -0.11, 4e-4, -3e-4, 0.006, 0.75, -0.08, 0.01]),
        Distortion::Equidistant([-0.02, 0.011, -0.006, 0.0012]),
    ]
}

fn camera(lens: Distortion) -> Camera {
    Camera::new((800, 600), Vector2::new(693.0, 695.5), Vector2::new(402.3, 297.1), lens).unwrap()
}

#[test]
fn unprojection_is_exact_over_the_whole_picture() {
    for lens in lenses() {
        let camera = camera(lens);
        for u in (0..=800).step_by(20) {
            for v in (0..=600).step_by(20) {
                let pixel = Vector2::new(f64::from(u) - 0.5, f64::from(v) - 0.5);
                let direction = camera.unproject(&pixel).unwrap();
                let back = camera.project(&Point3::from(direction.into_inner() * 0.7)).unwrap();
                assert!(
                    (back - pixel).norm() < 1e-9,
                    "{lens:?} {pixel:?}: off by {:e} px",
                    (back - pixel).norm()
                );
            }
        }
    }
}

#[test]
fn what_the_camera_cannot_see_is_refused() {
    let camera = camera(Distortion::PlumbBob([-0.5, 0.0, 0.0, 0.0, 0.0]));
    assert!(camera.project(&Point3::new(0.0, 0.0, -1.0)).is_err());
    assert!(camera.project(&Point3::new(0.0, 0.0, 0.0)).is_err());
    assert!(camera.project(&Point3::new(f64::NAN, 0.0, 1.0)).is_err());
    for far in [1e200, f64::INFINITY] {
        assert!(self::camera(Distortion::None).project(&Point3::new(far, 0.0, 1.0)).is_err(), "{far}");
    }
    // A weak barrel folds beyond 80° off axis, as far out as the search for the fold goes.
    let weak = self::camera(Distortion::PlumbBob([-0.008, 0.0, 0.0, 0.0, 0.0]));
    assert!(
        weak.project(&Point3::new(5.6, 0.0, 1.0)).is_ok()
            && weak.project(&Point3::new(11.2, 0.0, 1.0)).is_err()
    );
    // With k1 = -0.5 the picture folds back at tan = 0.816: two rays would share a pixel.
    assert!(camera.project(&Point3::new(0.9, 0.0, 1.0)).is_err());
    assert!(camera.unproject(&Vector2::new(5000.0, 300.0)).is_err());
    assert!(camera.unproject(&Vector2::new(f64::NAN, 300.0)).is_err());
    assert!(Camera::new((0, 600), Vector2::new(1.0, 1.0), Vector2::zeros(), Distortion::None).is_err());
    assert!(Camera::new((8, 6), Vector2::new(-1.0, 1.0), Vector2::zeros(), Distortion::None).is_err());
}

/// x / (1 − 0.5 ρ²) has a pole at ρ² = 2: what lies beyond it comes in again from the other side.
#[test]
fn a_rational_lens_ends_at_its_pole() {
    let camera = camera(Distortion::RationalPolynomial([0.0, 0.0, 0.0, 0.0, 0.0, -0.5, 0.0, 0.0]));
    assert!(camera.project(&Point3::new(1.40, 0.0, 1.0)).is_ok());
    for x in [1.43, 2.0, 4.0] {
        assert!(camera.project(&Point3::new(x, 0.0, 1.0)).is_err(), "{x}");
    }
}

/// Decentred lenses fold nearer to the axis on one side: what is projected comes back, and what would not is refused.
#[test]
fn what_a_decentred_lens_projects_comes_back() {
    for (lens, least) in [
        (Distortion::PlumbBob([-0.35, 0.15, 1e-3, 1e-3, -0.03]), 0.9),
        (Distortion::PlumbBob([-0.3, 0.0, -0.01, 0.004, 0.0]), 0.6),
        (Distortion::PlumbBob([0.0, 0.0, 0.2, 0.0, 0.0]), 0.6),
        (Distortion::RationalPolynomial([0.5, -0.2, 1e-3, -2e-3, 0.01, 0.9, -0.1, 0.02]), 0.85),
    ] {
        let camera = camera(lens);
        let mut widest: f64 = 0.0;
        for step in 1..1500 {
            let angle = f64::from(step) * 1e-3;
            for turn in 0..32 {
                let around = f64::from(turn) * std::f64::consts::TAU / 32.0 + 0.05;
                let ray = Vector3::new(angle.sin() * around.cos(), angle.sin() * around.sin(), angle.cos());
                let Ok(pixel) = camera.project(&Point3::from(ray)) else { continue };
                let back = camera.unproject(&pixel).unwrap().into_inner();
                assert!(
                    (back - ray).norm() < 1e-8,
                    "{lens:?}: {angle} rad, {around}: off by {}",
                    (back - ray).norm()
                );
                widest = widest.max(angle);
            }
        }
        assert!(widest > least, "{lens:?}: only {widest} rad");
    }
    let folded = Vector3::new(-0.545_382_7, -0.631_456_3, 0.551_112);
    let lens = camera(Distortion::PlumbBob([-0.35, 0.15, 1e-3, 1e-3, -0.03]));
    assert!(lens.project(&Point3::from(folded)).is_err());
}

/// Pixel 0 is the middle of the first pixel: the picture reaches from −0.5 to its size less 0.5.
#[test]
fn a_picture_contains_its_outermost_pixels_to_their_edges() {
    let camera = camera(Distortion::None);
    for (u, v, inside) in [
        (-0.5, 300.0, true),
        (-0.51, 300.0, false),
        (799.5, 300.0, true),
        (799.51, 300.0, false),
        (400.0, -0.5, true),
        (400.0, -0.51, false),
        (400.0, 599.5, true),
        (400.0, 599.51, false),
        (f64::NAN, 300.0, false),
    ] {
        assert_eq!(camera.contains(&Vector2::new(u, v)), inside, "{u}, {v}");
    }
}

#[test]
fn a_fisheye_sees_nearly_to_the_side_and_refuses_what_folds() {
    let wide = |k| {
        Camera::new(
            (1200, 1200),
            Vector2::new(330.0, 330.0),
            Vector2::new(599.5, 599.5),
            Distortion::Equidistant(k),
        )
        .unwrap()
    };
    let camera = wide([0.0; 4]);
    // Without coefficients the picture's radius is the focal length times the angle.
    for degrees in [0.0, 0.001, 1.0, 30.0, 60.0, 85.0_f64] {
        let angle = degrees.to_radians();
        let pixel = camera.project(&Point3::new(angle.sin(), 0.0, angle.cos())).unwrap();
        assert_relative_eq!(pixel.x, 599.5 + 330.0 * angle, epsilon = 1e-8);
        let ray = camera.unproject(&pixel).unwrap();
        assert_relative_eq!(ray.x.atan2(ray.z), angle, epsilon = 1e-11);
    }
    assert!(camera.project(&Point3::new(1.0, 0.0, -0.1)).is_err());
    // θ (1 − 0.3 θ²) falls from 1.054 rad on.
    let folding = wide([-0.3, 0.0, 0.0, 0.0]);
    assert!(folding.project(&Point3::new(1.1_f64.tan(), 0.0, 1.0)).is_err());
    assert!(folding.project(&Point3::new(1.0_f64.tan(), 0.0, 1.0)).is_ok());
    assert!(folding.unproject(&Vector2::new(599.5 + 330.0 * 0.71, 599.5)).is_err());
}

proptest! {
    #[test]
    fn projection_jacobians_match_differences(x in -0.4..0.4f64, y in -0.3..0.3f64, z in 0.2..1.5f64, lens in 0..5usize) {
        let distortion = lenses()[lens];
        let eye = camera(distortion);
        let point = Point3::new(x * z, y * z, z);
        let at = eye.project_with_jacobians(&point).unwrap();
        let (pixel, by_point) = eye.project_with_point_jacobian(&point).unwrap();
        prop_assert_eq!(pixel, at.pixel);
        prop_assert_eq!(by_point, at.by_point);
        // Its own code without Jacobians: the compiler may round it another way.
        prop_assert!((eye.project(&point).unwrap() - at.pixel).amax() < 1e-10);
        let h = 1e-6;
        for axis in 0..3 {
            let mut step = Vector3::zeros();
            step[axis] = h;
            let d = (eye.project(&(point + step)).unwrap() - eye.project(&(point - step)).unwrap()) / (2.0 * h);
            assert_relative_eq!(d, at.by_point.column(axis).into_owned(), epsilon = 1e-4, max_relative = 1e-6);
        }
        let moved = |intrinsic: usize, h: f64| {
            let mut f = eye.focal_px();
            let mut c = eye.center_px();
            if intrinsic < 2 { f[intrinsic] += h } else { c[intrinsic - 2] += h }
            Camera::new((800, 600), f, c, distortion).unwrap().project(&point).unwrap()
        };
        for i in 0..4 {
            let d = (moved(i, 1e-3) - moved(i, -1e-3)) / 2e-3;
            assert_relative_eq!(d, at.by_intrinsics.column(i).into_owned(), epsilon = 1e-8);
        }
        let bent = |coefficient: usize, h: f64| {
            let mut k = distortion.coefficients();
            k[coefficient] += h;
            let lens = match distortion {
                Distortion::Equidistant(_) => Distortion::Equidistant([k[0], k[1], k[2], k[3]]),
                _ => Distortion::RationalPolynomial(k),
            };
            Camera::new((800, 600), eye.focal_px(), eye.center_px(), lens).unwrap().project(&point).unwrap()
        };
        let coefficients = if matches!(distortion, Distortion::Equidistant(_)) { 4 } else { 8 };
        for i in 0..coefficients {
            let d = (bent(i, 1e-6) - bent(i, -1e-6)) / 2e-6;
            assert_relative_eq!(d, at.by_distortion.column(i).into_owned(), epsilon = 1e-5, max_relative = 1e-6);
        }
    }

    #[test]
    fn unprojection_jacobian_matches_differences(u in 0.0..800.0f64, v in 0.0..600.0f64, lens in 0..5usize) {
        let camera = camera(lenses()[lens]);
        let at = camera.unproject_with_jacobian(&Vector2::new(u, v)).unwrap();
        prop_assert_eq!(at.direction, camera.unproject(&Vector2::new(u, v)).unwrap());
        for axis in 0..2 {
            let mut step = Vector2::zeros();
            step[axis] = 1e-3;
            let ahead = camera.unproject(&(Vector2::new(u, v) + step)).unwrap().into_inner();
            let behind = camera.unproject(&(Vector2::new(u, v) - step)).unwrap().into_inner();
            assert_relative_eq!((ahead - behind) / 2e-3, at.by_pixel.column(axis).into_owned(), epsilon = 1e-9);
        }
    }
}
