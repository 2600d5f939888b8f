//! A camera's tone curve by a board's pattern that is drawn here, and balls read by it.

use mirror_core::camera::{Camera, Distortion};
use mirror_core::outline::{Circle, PatternLevels, Picture, RadiusRange, measure_ball, pattern_curve};
use nalgebra::{Vector2, Vector3};

const WIDTH: usize = 96;
const HEIGHT: usize = 72;
const SQUARE_PX: f64 = 20.0;
const FINE: usize = 4;

fn encoded(light: f64) -> f64 {
    if light <= 0.0031308 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
}

/// A wave of squares, 1 and −1, with edges of a blur (a logistic curve).
fn wave(at_px: f64, blur_px: f64) -> f64 {
    let from = at_px.rem_euclid(2.0 * SQUARE_PX);
    let step = |edge: f64| (0.851 * (from - edge) / blur_px).tanh();
    step(0.0) - step(SQUARE_PX) + step(2.0 * SQUARE_PX)
}

/// The pattern, turned by a tenth, averaged over pixels.
fn pattern(blur_px: f64) -> Vec<f64> {
    let (sine, cosine) = 0.1f64.sin_cos();
    let at = |u: f64, v: f64| {
        wave(cosine * u + sine * v + 7.0, blur_px) * wave(cosine * v - sine * u + 9.0, blur_px)
    };
    let fine = |i: usize| ((i % FINE) as f64 + 0.5) / FINE as f64 - 0.5;
    (0..WIDTH * HEIGHT)
        .map(|i| {
            let (u, v) = ((i % WIDTH) as f64, (i / WIDTH) as f64);
            (0..FINE * FINE).map(|k| at(u + fine(k), v + fine(k / FINE))).sum::<f64>() / (FINE * FINE) as f64
        })
        .collect()
}

/// Levels of the pattern in light that falls from left to right, by sRGB's curve and then to a power.
fn levels(power: f64, exposure: f64) -> Vec<u8> {
    pattern(0.8)
        .iter()
        .enumerate()
        .map(|(i, p)| {
            let lit = exposure * (1.0 - 0.2 * (i % WIDTH) as f64 / WIDTH as f64);
            let light = lit * (0.03 + 0.62 * 0.5 * (1.0 + p));
            (255.0 * encoded(light.min(1.0)).powf(power)).round() as u8
        })
        .collect()
}

fn view<'a>(levels: &'a [u8], pattern: &'a [f32], ink_px: f64) -> PatternLevels<'a> {
    PatternLevels {
        width: WIDTH,
        height: HEIGHT,
        levels,
        pattern,
        shared_pixels: 2.0 * SQUARE_PX,
        ink_px,
        sharpening: None,
    }
}

#[test]
fn a_pattern_tells_the_cameras_curve() {
    let drawn: Vec<f32> = pattern(0.05).iter().map(|p| *p as f32).collect();
    for power in [0.8, 1.0, 1.3] {
        let seen = levels(power, 1.0);
        let told = pattern_curve(&view(&seen, &drawn, 0.0)).unwrap().unwrap();
        // The light is sRGB's of the level to 1 / power, which is about its power of 1 / power.
        let true_deviations = -f64::ln(power) / 1.085f64.ln();
        assert!(
            (told.deviations - true_deviations).abs() < 0.6 + 0.2 * true_deviations.abs(),
            "{power}: {told:?}"
        );
        assert!(
            (told.deviations - true_deviations).abs() < 3.0 * told.std + 0.2 && told.std < 1.2,
            "{power}: {told:?}"
        );
        // Ink that may have spread leaves less known.
        let inked = pattern_curve(&view(&seen, &drawn, 0.05)).unwrap().unwrap();
        assert!(inked.std > told.std + 0.2 && inked.deviations == told.deviations, "{inked:?} {told:?}");
    }
}

#[test]
fn where_squares_are_cut_off_no_curve_is_told() {
    let drawn: Vec<f32> = pattern(0.05).iter().map(|p| *p as f32).collect();
    let bright = levels(1.0, 2.5);
    assert!(pattern_curve(&view(&bright, &drawn, 0.0)).unwrap().is_none());
    let even = vec![90; WIDTH * HEIGHT];
    assert!(pattern_curve(&view(&even, &vec![0.0; WIDTH * HEIGHT], 0.0)).unwrap().is_none());
    assert!(pattern_curve(&view(&bright[1..], &drawn, 0.0)).is_err());
}

/// A ball before a background that is dark on one side and bright on the other, its levels to a power.
fn ball(power: f64) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(160 * 120 * 3);
    for i in 0..160 * 120 {
        let (u, v) = ((i % 160) as f64, (i / 160) as f64);
        let away = Vector2::new(u - 80.3, v - 60.4);
        let covered = 0.5 * (1.0 - (0.851 * (away.norm() - 15.0) / 1.2).tanh());
        let behind = if u > 80.0 { 0.5 } else { 0.03 };
        bytes.extend(Vector3::new(0.03, 0.06, 0.45).iter().map(|own| {
            let light = covered * own + (1.0 - covered) * behind;
            (255.0 * encoded(light).powf(power)).round() as u8
        }));
    }
    bytes
}

#[test]
fn a_ball_is_read_by_the_curve_that_is_told() {
    let camera =
        Camera::new((160, 120), Vector2::new(200.0, 200.0), Vector2::new(79.5, 59.5), Distortion::None)
            .unwrap();
    let start = Circle { center_px: Vector2::new(80.0, 60.0), radius_px: 15.0 };
    let range = RadiusRange { min_px: 10.0, max_px: 20.0 };
    let centre = |power: f64, deviations: f64| {
        let bytes = ball(power);
        let picture = Picture::new(&bytes, 160, 120, (1, 1)).unwrap().with_curve(deviations);
        measure_ball(&picture, &start, &range, &camera).unwrap().cone.centroid_px
    };
    let own = centre(1.0, 0.0);
    let misread = (centre(1.3, 0.0) - own).norm();
    let read = (centre(1.3, -f64::ln(1.3) / 1.085f64.ln()) - own).norm();
    assert!(misread > 0.02 && read < 0.5 * misread, "{misread} {read}");
}
