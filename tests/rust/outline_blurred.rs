//! Balls that a shake or a lens out of focus blurs over much of their radius: drawn here by averaging over the shutter's time, with noise.

use mirror_core::camera::{Camera, Distortion};
use mirror_core::outline::{Circle, CommonBlur, ExpectedRadius, Picture, measure_blurred_ball};
use nalgebra::{Matrix2, Vector2, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const SIDE: usize = 72;

fn camera() -> Camera {
    let middle = 0.5 * (SIDE as f64 - 1.0);
    Camera::new((72, 72), Vector2::new(600.0, 600.0), Vector2::new(middle, middle), Distortion::None).unwrap()
}

/// A green ball before two greys, moved by `motion` while the shutter is open; levels with noise.
fn moved(center: Vector2<f64>, radius: f64, motion: Vector2<f64>, random: &mut ChaCha8Rng) -> Vec<u8> {
    const FINE: usize = 4;
    const TIMES: usize = 25;
    let lamp = Vector3::new(-0.3, -0.6, 0.74).normalize();
    let mut bytes = Vec::with_capacity(SIDE * SIDE * 3);
    for row in 0..SIDE {
        for column in 0..SIDE {
            let mut sum = [0.0; 3];
            for i in 0..FINE * FINE * TIMES {
                let (place, time) = (i % (FINE * FINE), i / (FINE * FINE));
                let shift = motion * ((time as f64 + 0.5) / TIMES as f64 - 0.5);
                let u = column as f64 + ((place % FINE) as f64 + 0.5) / FINE as f64 - 0.5 - shift.x;
                let v = row as f64 + ((place / FINE) as f64 + 0.5) / FINE as f64 - 0.5 - shift.y;
                let away = (Vector2::new(u, v) - center) / radius;
                let light = if away.norm() < 1.0 {
                    let normal = Vector3::new(away.x, away.y, (1.0 - away.norm_squared()).sqrt());
                    let shade = 0.2 + 0.6 * normal.dot(&lamp).max(0.0);
                    [0.06 * shade, 0.8 * shade, 0.1 * shade]
                } else {
                    [if u + 0.4 * v < 44.0 { 0.1 } else { 0.28 }; 3]
                };
                for (s, l) in sum.iter_mut().zip(light) {
                    *s += l / (FINE * FINE * TIMES) as f64;
                }
            }
            bytes.extend(sum.map(|l: f64| {
                let noise: f64 = StandardNormal.sample(random);
                (255.0 * l.powf(1.0 / 2.2) + noise).round().clamp(0.0, 255.0) as u8
            }));
        }
    }
    bytes
}

#[test]
fn a_ball_that_moved_by_its_radius_is_measured_as_a_whole() {
    let camera = camera();
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let (mut squares, mut number) = (0.0, 0.0);
    for turn in 0..12 {
        let (sine, cosine) = (0.55 * f64::from(turn)).sin_cos();
        let radius = 7.5 + 0.25 * f64::from(turn);
        let center = Vector2::new(35.2 + 0.13 * f64::from(turn), 34.6);
        let motion = Vector2::new(cosine, sine) * 10.0;
        let bytes = moved(center, radius, motion, &mut random);
        let picture = Picture::new(&bytes, SIDE, SIDE, (1, 1)).unwrap();
        let start = Circle { center_px: center + Vector2::new(1.5, -1.0), radius_px: radius * 1.015 };
        let expected = ExpectedRadius { radius_px: start.radius_px, std_px: 0.03 * radius };
        let found = measure_blurred_ball(&picture, &start, &expected, None, &camera).unwrap();
        let cone = &found.outline.cone;
        let error = cone.centroid_px - center;
        assert!(error.norm() < 0.6, "{turn}: {error}");
        let covariance = cone.centroid_covariance_px2.try_inverse().unwrap();
        squares += (error.transpose() * covariance * error)[(0, 0)];
        number += 2.0;
        // The blur is the motion's: a twelfth of the square of its length, along it.
        let along = motion.normalize();
        let shown = (along.transpose() * found.blur_px2 * along)[(0, 0)];
        assert!((shown - 100.0 / 12.0).abs() < 3.0, "{turn}: {shown}");
        assert!(found.outline.narrow_blur_px < 0.6 * found.outline.blur_px);
    }
    let claimed = squares / number;
    assert!(claimed < 1.5, "{claimed}");
}

#[test]
fn balls_of_a_picture_share_the_blur_of_the_most() {
    let blurs = [[8.0, 1.0, 2.0], [8.2, 1.1, 1.9], [7.9, 0.8, 2.1], [30.0, -3.0, 0.2]]
        .map(|[a, b, c]| Matrix2::new(a, b, b, c));
    let common = CommonBlur::of(&blurs).unwrap();
    assert!((common.covariance_px2 - Matrix2::new(8.0, 1.0, 1.0, 2.0)).norm() < 0.5, "{common:?}");
    assert!(common.std_px2 < 1.0);
    assert!(CommonBlur::of(&blurs[..2]).is_none());
}

#[test]
fn grey_things_and_places_outside_are_no_blurred_balls() {
    let bytes = vec![90; SIDE * SIDE * 3];
    let picture = Picture::new(&bytes, SIDE, SIDE, (1, 1)).unwrap();
    for (u, v, radius) in
        [(30.0, 30.0, 8.0), (-60.0, 20.0, 8.0), (1e9, 1.0, 8.0), (f64::NAN, 0.0, 8.0), (30.0, 30.0, 1e9)]
    {
        let start = Circle { center_px: Vector2::new(u, v), radius_px: radius };
        let expected = ExpectedRadius { radius_px: radius, std_px: 0.3 };
        assert!(measure_blurred_ball(&picture, &start, &expected, None, &camera()).is_none());
    }
}
