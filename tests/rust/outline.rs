//! Balls' outlines: derivatives against differences, covariances against scatter, centres in pictures that are drawn here by supersampling.

use mirror_core::camera::{Camera, Distortion};
use mirror_core::outline::{
    Circle, EdgePoint, Picture, RadiusRange, chroma_step, cone_centroid, fit_circle, fit_cone, measure_ball,
};
use nalgebra::{Point3, Vector2, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

fn camera(lens: Distortion) -> Camera {
    Camera::new((320, 240), Vector2::new(400.0, 410.0), Vector2::new(159.5, 119.5), lens).unwrap()
}

/// Pixels where lines of sight touch a sphere: the tangent circle's points in space, projected.
fn touching_pixels(camera: &Camera, center: Vector3<f64>, radius: f64, count: usize) -> Vec<Vector2<f64>> {
    let distance = center.norm();
    let axis = center / distance;
    // The tangent circle lies in the polar plane of the eye.
    let middle = center - axis * (radius * radius / distance);
    let ring = radius * (1.0 - (radius / distance).powi(2)).sqrt();
    let side = axis.cross(&Vector3::x()).normalize();
    let other = axis.cross(&side);
    (0..count)
        .map(|i| {
            let (s, c) = (core::f64::consts::TAU * i as f64 / count as f64).sin_cos();
            camera.project(&Point3::from(middle + (side * c + other * s) * ring)).unwrap()
        })
        .collect()
}

#[test]
fn the_centroid_of_a_cone_moves_as_its_jacobian_says() {
    for lens in [Distortion::None, Distortion::PlumbBob([-0.2, 0.06, 0.001, -0.002, 0.0])] {
        let camera = camera(lens);
        let axis = Vector3::new(0.22, -0.15, 1.0).normalize();
        let w = axis / 0.05_f64.cos();
        let outline = cone_centroid(&w, &camera).unwrap();
        for column in 0..3 {
            let mut step = Vector3::zeros();
            step[column] = 1e-6;
            let [above, below] =
                [w + step, w - step].map(|w| cone_centroid(&w, &camera).unwrap().centroid_px);
            let difference = (above - below) / 2e-6;
            let analytic = outline.by_parameters.column(column);
            assert!(
                (difference - analytic).norm() < 1e-3 * (1.0 + difference.norm()),
                "{column} {difference} {analytic}"
            );
        }
    }
}

#[test]
fn exact_edges_give_the_exact_sphere_also_from_part_of_its_outline() {
    let camera = camera(Distortion::PlumbBob([-0.1, 0.02, 0.0, 0.0, 0.0]));
    let center = Vector3::new(0.08, -0.05, 0.5);
    let pixels = touching_pixels(&camera, center, 0.018, 90);
    let sphere = camera.project(&Point3::from(center)).unwrap();
    let start = Circle { center_px: sphere + Vector2::new(0.2, -0.2), radius_px: 15.4 };
    for share in [90, 50, 30] {
        let points: Vec<_> = pixels[..share]
            .iter()
            .map(|p| EdgePoint { pixel: *p, std_px: 0.1, shared_std_px: 0.0, common_px: 0.0, lit_px: 0.0 })
            .collect();
        let near = fit_circle(&pixels[..share], 5.0, 40.0, 1.0).unwrap_or(start);
        let fit = fit_cone(&points, &near, &camera, 1.0).unwrap();
        assert!((fit.sphere_center_px - sphere).norm() < 1e-5, "{share}: {}", fit.sphere_center_px - sphere);
        assert!(fit.residual_rms_px < 1e-6);
    }
}

#[test]
fn the_claimed_covariance_of_the_centroid_is_the_scatter() {
    let camera = camera(Distortion::None);
    let pixels = touching_pixels(&camera, Vector3::new(0.1, 0.06, 0.5), 0.02, 100);
    let exact: Vec<_> = pixels
        .iter()
        .map(|p| EdgePoint { pixel: *p, std_px: 0.1, shared_std_px: 0.0, common_px: 0.0, lit_px: 0.0 })
        .collect();
    let start = fit_circle(&pixels, 5.0, 40.0, 1.0).unwrap();
    let truth = fit_cone(&exact, &start, &camera, 1.0).unwrap().centroid_px;
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    // All of the outline, and less than half of it.
    for kept in [100, 42] {
        let trials = 300;
        let mut sum = 0.0;
        for _ in 0..trials {
            let noisy: Vec<_> = exact[..kept]
                .iter()
                .map(|p| {
                    let noise = Vector2::from_fn(|_, _| StandardNormal.sample(&mut rng)) * 0.1;
                    EdgePoint {
                        pixel: p.pixel + noise,
                        std_px: 0.1,
                        shared_std_px: 0.0,
                        common_px: 0.0,
                        lit_px: 0.0,
                    }
                })
                .collect();
            let fit = fit_cone(&noisy, &start, &camera, 1.0).unwrap();
            let error = fit.centroid_px - truth;
            sum += error.dot(&(fit.centroid_covariance_px2.try_inverse().unwrap() * error)) / 2.0;
        }
        let mean = sum / f64::from(trials);
        // The mean of 300 chi-squared values with 2 degrees of freedom, halved, is 1 ± 0.06; the factor for shared errors widens a little.
        assert!((0.6..1.2).contains(&mean), "{kept}: {mean}");
    }
}

#[test]
fn what_one_cause_does_to_all_edges_is_in_the_covariance() {
    let camera = camera(Distortion::None);
    let pixels = touching_pixels(&camera, Vector3::new(0.1, 0.06, 0.5), 0.02, 100);
    let start = fit_circle(&pixels, 5.0, 40.0, 1.0).unwrap();
    // One deviation of the cause moves each edge outward by up to 0.05 px, most at the right.
    let moved = |deviations: f64| -> Vec<EdgePoint> {
        let outward = |p: &Vector2<f64>| (p - start.center_px).normalize();
        pixels
            .iter()
            .map(|p| {
                let common_px = 0.05 * outward(p).x.max(0.0).powi(2);
                let pixel = p + outward(p) * (deviations * common_px);
                EdgePoint { pixel, std_px: 0.02, shared_std_px: 0.0, common_px, lit_px: 0.0 }
            })
            .collect()
    };
    let fit = |deviations: f64| fit_cone(&moved(deviations), &start, &camera, 1.0).unwrap();
    // A tenth of it: no edge is taken for another thing's.
    let shift = (fit(0.1).centroid_px - fit(0.0).centroid_px) * 10.0;
    // Edges moved outward move the centre towards them.
    assert!((fit(0.0).common_moved_px - shift).norm() < 0.05 * shift.norm(), "{shift}");
    assert!(shift.norm() > 0.01, "{shift}");
    // Exact edges scatter not at all: what is left is the cause alone, as large as what it does and in its direction.
    let covariance = fit(0.0).centroid_covariance_px2;
    assert!((covariance - shift * shift.transpose()).norm() < 0.03 * shift.norm_squared(), "{covariance}");
}

#[test]
fn a_circle_is_found_among_points_of_something_else() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let mut points: Vec<_> = (0..40)
        .map(|i| {
            let (s, c) = (0.1 * f64::from(i)).sin_cos();
            Vector2::new(50.0 + 9.0 * c, 40.0 + 9.0 * s)
        })
        .collect();
    points.extend((0..40).map(|_| Vector2::new(rng.random_range(20.0..80.0), rng.random_range(10.0..70.0))));
    let circle = fit_circle(&points, 4.0, 20.0, 0.5).unwrap();
    assert!(
        (circle.center_px - Vector2::new(50.0, 40.0)).norm() < 0.2 && (circle.radius_px - 9.0).abs() < 0.2
    );
    assert!(fit_circle(&points, 30.0, 40.0, 0.5).is_none_or(|c| c.radius_px >= 30.0));
    assert!(fit_circle(&points[..2], 1.0, 20.0, 0.5).is_none());
}

/// A red ball, lit from above and aside, before a background of three greys; a plate may hide its right part.
fn drawn(center: Vector2<f64>, radius: f64, hidden_from: f64) -> Vec<u8> {
    const FINE: usize = 6;
    let lamp = Vector3::new(0.4, -0.7, 0.59).normalize();
    let mut bytes = Vec::with_capacity(320 * 240 * 3);
    for row in 0..240 {
        for column in 0..320 {
            let mut sum = [0.0; 3];
            for i in 0..FINE * FINE {
                let u = column as f64 + ((i % FINE) as f64 + 0.5) / FINE as f64 - 0.5;
                let v = row as f64 + ((i / FINE) as f64 + 0.5) / FINE as f64 - 0.5;
                let away = (Vector2::new(u, v) - center) / radius;
                let light = if u > hidden_from && u < hidden_from + 2.0 * radius {
                    [0.2, 0.21, 0.19]
                } else if away.norm() < 1.0 {
                    let normal = Vector3::new(away.x, away.y, (1.0 - away.norm_squared()).sqrt());
                    let shade = 0.15 + 0.7 * normal.dot(&lamp).max(0.0);
                    [0.04 * shade, 0.05 * shade, 0.8 * shade]
                } else {
                    let grey = 0.1 + 0.15 * f64::from(u32::from(v > 118.0) + u32::from(u > 150.0));
                    [grey; 3]
                };
                for (s, l) in sum.iter_mut().zip(light) {
                    *s += l / (FINE * FINE) as f64;
                }
            }
            bytes.extend(sum.map(|l: f64| (255.0 * l.powf(1.0 / 2.2)).round() as u8));
        }
    }
    bytes
}

#[test]
fn drawn_balls_are_measured_to_a_few_hundredths_of_a_pixel() {
    let camera = camera(Distortion::None);
    for (radius, x, y, hidden_from) in
        [(4.0, 120.3, 100.7, 400.0), (9.0, 150.6, 119.2, 400.0), (14.0, 160.2, 110.4, 400.0)]
    {
        let center = Vector2::new(x, y);
        let bytes = drawn(center, radius, hidden_from);
        let picture = Picture::new(&bytes, 320, 240, (1, 1)).unwrap();
        let start = Circle { center_px: center + Vector2::new(0.7, -0.5), radius_px: radius * 1.05 };
        let range = RadiusRange { min_px: 0.6 * radius, max_px: 1.6 * radius };
        let found = measure_ball(&picture, &start, &range, &camera).unwrap();
        // The drawing is a disc: the outline's centroid is its centre.
        let error = (found.cone.centroid_px - center).norm();
        assert!(error < 0.08, "radius {radius}: {error}");
        assert!((found.cone.mean_radius_px - radius).abs() < 0.1, "{}", found.cone.mean_radius_px);
    }
}

#[test]
fn a_balls_channels_tell_another_curve_of_the_camera() {
    let center = Vector2::new(150.6, 119.2);
    let bytes = drawn(center, 14.0, 400.0);
    let told = |power: f64| {
        let graded: Vec<u8> =
            bytes.iter().map(|b| (255.0 * (f64::from(*b) / 255.0).powf(power)).round() as u8).collect();
        let picture = Picture::new(&graded, 320, 240, (1, 1)).unwrap();
        let start = Circle { center_px: center, radius_px: 14.0 };
        let range = RadiusRange { min_px: 8.0, max_px: 22.0 };
        measure_ball(&picture, &start, &range, &camera(Distortion::None)).unwrap()
    };
    // A deviation is a power of 1.085: 1.3 is 3.2 of them the one way, 0.8 are 2.7 the other way.
    let [less, own, more] = [0.8, 1.0, 1.3].map(|power| told(power).curve_deviations.unwrap());
    assert!(
        own.abs() < 1.0 && (less - own - 2.7).abs() < 1.4 && (own - more - 3.2).abs() < 1.4,
        "{less} {own} {more}"
    );
    // What it moves the centre by is what the covariance has of it.
    assert!(told(1.3).cone.common_moved_px.norm() > 0.002);
}

#[test]
fn where_no_ball_is_none_is_measured() {
    let bytes = vec![90; 320 * 240 * 3];
    let picture = Picture::new(&bytes, 320, 240, (2, 2)).unwrap();
    let range = RadiusRange { min_px: 4.0, max_px: 40.0 };
    for (u, v) in [(100.0, 100.0), (-40.0, 20.0), (319.0, 239.0), (1e9, 1.0), (f64::NAN, 0.0)] {
        let start = Circle { center_px: Vector2::new(u, v), radius_px: 10.0 };
        assert!(measure_ball(&picture, &start, &range, &camera(Distortion::None)).is_none());
    }
    assert!(Picture::new(&bytes, 320, 241, (1, 1)).is_err());
    assert!(Picture::new(&bytes, 320, 240, (3, 1)).is_err());
}

/// A colourful wave, its two colours kept for each sample's own pixels or for pairs, repeated or interpolated.
fn wave(step: usize, interpolated: bool) -> Vec<u8> {
    let colour = |x: f64, y: f64| 70.0 * (0.55 * x + 0.23 * y).sin() + 20.0 * (1.7 * x - 0.4 * y).cos();
    let sample = |i: i64, row: f64| colour((i as f64 + 0.5) * step as f64 - 0.5, row);
    let mut bytes = Vec::new();
    for row in 0..80 {
        for column in 0..120 {
            let at = (f64::from(column) + 0.5) / step as f64 - 0.5;
            let y = f64::from(row);
            let red = if interpolated {
                let low = at.floor();
                (1.0 - (at - low)) * sample(low as i64, y) + (at - low) * sample(low as i64 + 1, y)
            } else {
                sample(at.round() as i64, y)
            };
            // Red and blue move against each other, the brightness hardly.
            let levels = [128.0 - 0.5 * red, 128.0 - 0.2 * red, 128.0 + red];
            bytes.extend(levels.map(|v: f64| v.round().clamp(0.0, 255.0) as u8));
        }
    }
    bytes
}

/// Nothing can be told of lines of fewer than four pixels.
#[test]
fn pictures_of_a_few_pixels_have_a_step_of_colour() {
    for (width, height) in [(1, 100), (2, 100), (3, 3), (100, 2), (1, 1)] {
        let bytes = vec![90; 3 * width * height];
        assert_eq!(chroma_step(&Picture::new(&bytes, width, height, (1, 1)).unwrap()), (1, 1));
    }
}

#[test]
fn a_picture_tells_which_of_its_pixels_share_a_colour() {
    let told = |bytes: &[u8]| chroma_step(&Picture::new(bytes, 120, 80, (1, 1)).unwrap());
    assert_eq!(told(&wave(1, false)), (1, 1));
    assert_eq!(told(&wave(2, true)), (2, 1));
    assert_eq!(told(&wave(2, false)), (2, 1));
    assert_eq!(told(&vec![90; 120 * 80 * 3]), (1, 1));
}
