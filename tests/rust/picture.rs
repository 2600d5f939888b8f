//! The picture maker against reasoning that is not its own: mirror geometry, Snell's law as an equation, photon statistics.

use approx::assert_abs_diff_eq;
use mirror_core::camera::{Camera, Distortion};
use mirror_core::picture::{
    Beam, Body, Colour, Eye, LightField, Lights, Material, Paint, Pane, PaneOptions, Sampling, Scene, Sensor,
    Shape, ball_truth, furnish, pixel_of, render,
};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector2, Vector3};

const FOCAL_PX: f64 = 693.0;
const CENTER_PX: [f64; 2] = [399.5, 299.5];

fn camera(distortion: Distortion) -> Camera {
    Camera::new((800, 600), Vector2::repeat(FOCAL_PX), Vector2::from(CENTER_PX), distortion).unwrap()
}

/// A thin mirror before an eye at the scene's origin, in the optical frame (z forward).
fn pane(normal: Vector3<f64>, distance_m: f64, options: PaneOptions) -> Pane {
    let normal = normal.normalize();
    Pane::new(normal * distance_m, normal, -Vector3::y(), options).unwrap()
}

fn scene(bodies: &[Body], pane: Pane) -> Scene {
    let dim = Lights { lamps: vec![], sky: Colour::repeat(0.8), ground: Colour::repeat(0.8) };
    Scene::new(bodies, dim, Isometry3::identity(), Some(pane))
}

fn matt_ball(center: Vector3<f64>, radius_m: f64) -> Body {
    Body {
        shape: Shape::Ball { radius_m },
        scene_from_body: Isometry3::from_parts(Translation3::from(center), UnitQuaternion::identity()),
        material: Material { paint: Paint::Plain(Colour::repeat(1.0)), gloss: 0.0 },
    }
}

#[test]
fn a_thin_mirror_shows_a_point_where_its_reflection_stands() {
    let eye = Eye::new(&camera(Distortion::None)).unwrap();
    for (normal, point) in [
        (Vector3::new(0.0, 0.0, 1.0), Vector3::new(0.05, 0.08, 0.02)),
        (Vector3::new(0.2, -0.1, 1.0), Vector3::new(-0.07, 0.03, -0.01)),
        (Vector3::new(-0.15, 0.05, 1.0), Vector3::new(0.02, -0.06, 0.05)),
    ] {
        let thin = PaneOptions { glass_thickness_m: 0.0, ..PaneOptions::default() };
        let n = normal.normalize();
        let traced = pixel_of(&scene(&[], pane(normal, 0.15, thin)), &eye, &point).unwrap();
        let image = point + n * (2.0 * (0.15 - n.dot(&point)));
        let expected = Vector2::new(
            FOCAL_PX * image.x / image.z + CENTER_PX[0],
            FOCAL_PX * image.y / image.z + CENTER_PX[1],
        );
        assert_abs_diff_eq!((traced - expected).norm(), 0.0, epsilon = 1e-8);
    }
}

/// Snell's law in the plane of incidence: the ways across add up to the sideways distance, found by bisection.
fn angle_through_glass(before_m: f64, after_m: f64, thickness_m: f64, index: f64, aside_m: f64) -> f64 {
    let aside = |angle: f64| {
        let inside = (angle.sin() / index).asin();
        (before_m + after_m) * angle.tan() + 2.0 * thickness_m * inside.tan()
    };
    let (mut low, mut high) = (0.0, 1.5);
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if aside(middle) < aside_m { low = middle } else { high = middle }
    }
    low
}

#[test]
fn a_pane_of_glass_shows_a_point_where_snell_says() {
    let eye = Eye::new(&camera(Distortion::None)).unwrap();
    for thickness_m in [0.001, 0.003, 0.006] {
        let glass = PaneOptions { glass_thickness_m: thickness_m, ..PaneOptions::default() };
        let front_m = 0.15;
        let point = Vector3::new(0.09, 0.06, 0.01);
        let traced = pixel_of(&scene(&[], pane(Vector3::z(), front_m, glass)), &eye, &point).unwrap();
        let aside = point.xy().norm();
        let angle = angle_through_glass(front_m, front_m - point.z, thickness_m, 1.52, aside);
        let expected = point.xy() / aside * (FOCAL_PX * angle.tan()) + Vector2::from(CENTER_PX);
        assert_abs_diff_eq!((traced - expected).norm(), 0.0, epsilon = 1e-7);
    }
}

#[test]
fn light_from_the_centre_of_a_concave_mirror_returns_to_it() {
    let radius_m = 0.8;
    for thickness in [0.0, 0.003] {
        let bent = PaneOptions {
            curvature_per_m: 1.0 / radius_m,
            glass_thickness_m: thickness,
            ..PaneOptions::default()
        };
        let pane = pane(Vector3::z(), radius_m, bent);
        for aside in [-0.1, 0.0, 0.07] {
            let along = Vector3::new(aside, 0.05, 1.0).normalize();
            let path = pane.main_path(&Beam { from: Vector3::zeros(), along }).unwrap();
            assert_abs_diff_eq!((path.beam.along + along).norm(), 0.0, epsilon = 1e-12);
            assert!(path.share > 0.8 && path.share < 0.93);
        }
    }
}

#[test]
fn the_lens_of_the_tracer_agrees_with_the_lens_of_the_estimators() {
    for distortion in [
        Distortion::PlumbBob([0.052, -0.113, 0.0006, -0.0008, 0.02]),
        Distortion::PlumbBob([-0.2, 0.06, -0.001, 0.002, -0.005]),
        Distortion::RationalPolynomial([0.1, -0.05, 0.001, -0.0005, 0.01, 0.08, -0.03, 0.005]),
    ] {
        let camera = camera(distortion);
        let eye = Eye::new(&camera).unwrap();
        for pixel in [[0.0, 0.0], [799.0, 599.0], [400.0, 300.0], [123.4, 567.8], [-0.5, 599.5]] {
            let pixel = Vector2::from(pixel);
            let beam = eye.exact_beam(&pixel, &Isometry3::identity()).unwrap();
            let again = camera.project(&Point3::from(beam.along)).unwrap();
            assert_abs_diff_eq!((again - pixel).norm(), 0.0, epsilon = 1e-8);
            let by_table = eye.beam(&pixel, &Vector3::zeros(), &nalgebra::Matrix3::identity());
            let near = camera.project(&Point3::from(by_table.along)).unwrap();
            assert_abs_diff_eq!((near - pixel).norm(), 0.0, epsilon = 1e-3);
        }
    }
}

#[test]
fn a_drawn_ball_has_its_true_outline() {
    let eye = Eye::new(&camera(Distortion::PlumbBob([0.05, -0.1, 0.0005, -0.0008, 0.0]))).unwrap();
    let plain = PaneOptions { ghosts: false, ..PaneOptions::default() };
    let ball = matt_ball(Vector3::new(0.06, -0.05, 0.02), 0.0058);
    // A large matt black wall behind: only the ball shines.
    let mut wall = matt_ball(Vector3::new(0.0, 0.0, -5.0), 4.0);
    wall.material.paint = Paint::Plain(Colour::zeros());
    let scene = scene(&[wall, ball], pane(Vector3::new(0.1, 0.05, 1.0), 0.15, plain));
    let light = render(&scene, &eye, &Sampling { edge_grid: 8, ..Sampling::default() }).unwrap();
    let stopped = Sampling { cancel: mirror_core::Cancel::new(), ..Sampling::default() };
    stopped.cancel.cancel();
    assert!(matches!(render(&scene, &eye, &stopped), Err(mirror_core::Error::Cancelled)));
    let (mut sum, mut mean) = (0.0, Vector2::zeros());
    let mut brightest: f64 = 0.0;
    for (i, pixel) in light.pixels.iter().enumerate() {
        sum += pixel.x;
        mean += Vector2::new((i % light.width) as f64, (i / light.width) as f64) * pixel.x;
        brightest = brightest.max(pixel.x);
    }
    mean /= sum;
    let truth = ball_truth(&scene, &eye, 1).mirror.unwrap();
    assert!(truth.in_image && truth.visible_fraction == 1.0);
    // The oblique outline is not centred on the centre's pixel, and the picture shows it.
    assert!((truth.outline_px - truth.center_px).norm() > 0.03);
    assert_abs_diff_eq!((mean - truth.outline_px).norm(), 0.0, epsilon = 0.02);
    assert_abs_diff_eq!(sum / brightest / truth.outline_area_px2, 1.0, epsilon = 0.01);
}

#[test]
fn hidden_and_cut_off_balls_are_told() {
    let eye = Eye::new(&camera(Distortion::None)).unwrap();
    let seen = matt_ball(Vector3::new(-0.05, 0.04, 0.0), 0.0058);
    let hidden = matt_ball(Vector3::new(0.05, 0.04, 0.0), 0.0058);
    // Between the hidden ball and the mirror, on the way that its light takes to the eye at the origin.
    let cover = matt_ball(Vector3::new(0.05 * 0.8, 0.04 * 0.8, 0.06), 0.012);
    let outside = matt_ball(Vector3::new(0.30, 0.0, 0.0), 0.0058);
    let behind = matt_ball(Vector3::new(0.05, 0.0, 0.30), 0.0058);
    let pane = pane(Vector3::z(), 0.15, PaneOptions::default());
    let scene = scene(&[seen, hidden, cover, outside, behind], pane);
    let fraction = |i: usize| ball_truth(&scene, &eye, i).mirror.map_or(0.0, |via| via.visible_fraction);
    assert_eq!(fraction(0), 1.0);
    assert_eq!(fraction(1), 0.0);
    assert_eq!(fraction(3), 0.0);
    assert_eq!(fraction(4), 0.0);
}

#[test]
fn the_square_beyond_the_first_corner_is_dark() {
    let eye = Eye::new(&camera(Distortion::None)).unwrap();
    // The board faces the mirror (+z), x to the left of the picture's viewer, as on the robot's chest.
    let pose = Isometry3::from_parts(
        Translation3::new(0.0, 0.07, 0.0),
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI),
    );
    let board = Body::chessboard(pose, [6, 5], 0.014, 0.006).unwrap();
    let scene = scene(&[board], pane(Vector3::z(), 0.15, PaneOptions::default()));
    let light = render(&scene, &eye, &Sampling::default()).unwrap();
    let light_at = |x: f64, y: f64| {
        let point = pose * Point3::new(x * 0.014, y * 0.014, 0.0);
        let pixel = pixel_of(&scene, &eye, &point.coords).unwrap();
        light.pixels[pixel.y.round() as usize * light.width + pixel.x.round() as usize].x
    };
    assert!(light_at(-3.0, -2.5) < 0.1, "beyond corner 0");
    assert!(light_at(-2.0, -2.5) > 0.5);
    assert!(light_at(-3.0, -1.5) > 0.5);
    // 7 by 6 squares: turned by 180 degrees the opposite corner is bright.
    assert!(light_at(3.0, 2.5) > 0.5);
}

#[test]
fn the_same_seed_gives_the_same_picture_on_any_number_of_threads() {
    let camera = Camera::new((160, 120), Vector2::repeat(140.0), Vector2::new(79.5, 59.5), Distortion::None);
    let eye = Eye::new(&camera.unwrap()).unwrap();
    let pane = pane(Vector3::z(), 0.15, PaneOptions::default());
    let mut bodies = furnish(-0.12, Some(&pane));
    bodies.push(matt_ball(Vector3::new(0.02, 0.0, 0.02), 0.03));
    let scene = Scene::new(&bodies, Lights::default(), Isometry3::identity(), Some(pane));
    let draw = |threads: usize, seed: u64| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let light = render(&scene, &eye, &Sampling { seed, ..Sampling::default() }).unwrap();
            Sensor { seed, ..Sensor::default() }.expose(&light).unwrap()
        })
    };
    let one = draw(1, 5);
    assert_eq!(one, draw(3, 5));
    assert_ne!(one, draw(1, 6));
}

fn grey_field(light: f64) -> LightField {
    LightField { width: 200, height: 150, pixels: vec![Colour::repeat(light); 200 * 150] }
}

#[test]
fn noise_is_that_of_the_counted_electrons() {
    let sensor = Sensor {
        blur_px: 0.0,
        gamma: 1.0,
        full_well_electrons: 2000.0,
        read_noise_electrons: 20.0,
        ..Sensor::default()
    };
    let picture = sensor.expose(&grey_field(0.4)).unwrap();
    let values: Vec<f64> = picture.as_raw().iter().map(|&v| f64::from(v)).collect();
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (count - 1.0);
    // 0.4 of the full well, shot and read noise, and the rounding to whole numbers.
    let expected = (800.0 + 400.0) / (2000.0_f64 / 255.0).powi(2) + 1.0 / 12.0;
    assert_abs_diff_eq!(mean, 0.4 * 255.0, epsilon = 0.1);
    assert_abs_diff_eq!(variance / expected, 1.0, epsilon = 0.03);
}

#[test]
fn blur_moves_nothing_and_keeps_the_light() {
    let mut light = grey_field(0.0);
    light.pixels[70 * 200 + 90] = Colour::repeat(40.0);
    let sensor = Sensor { blur_px: 3.0, gamma: 1.0, full_well_electrons: f64::INFINITY, ..Sensor::default() };
    let picture = sensor.expose(&light).unwrap();
    let (mut sum, mut mean) = (0.0, Vector2::zeros());
    for (x, y, pixel) in picture.enumerate_pixels() {
        sum += f64::from(pixel[1]);
        mean += Vector2::new(f64::from(x), f64::from(y)) * f64::from(pixel[1]);
    }
    assert_abs_diff_eq!((mean / sum - Vector2::new(90.0, 70.0)).norm(), 0.0, epsilon = 1e-9);
    assert_abs_diff_eq!(sum / 255.0, 40.0, epsilon = 0.5);
}

#[test]
fn what_cannot_be_meant_is_refused() {
    let make = |options: PaneOptions| Pane::new(Vector3::z() * 0.2, Vector3::z(), -Vector3::y(), options);
    assert!(make(PaneOptions { glass_thickness_m: -0.001, ..PaneOptions::default() }).is_err());
    assert!(make(PaneOptions { refractive_index: 0.5, ..PaneOptions::default() }).is_err());
    assert!(make(PaneOptions { width_m: 0.0, ..PaneOptions::default() }).is_err());
    assert!(Pane::new(Vector3::z(), Vector3::zeros(), Vector3::y(), PaneOptions::default()).is_err());
    assert!(Pane::new(Vector3::z(), Vector3::z(), Vector3::z(), PaneOptions::default()).is_err());
    assert!(Body::ball(Vector3::zeros(), 0.0, [1.0; 3]).is_err());
    for sensor in [
        Sensor { jpeg_quality: Some(0), ..Sensor::default() },
        Sensor { exposure: f64::NAN, ..Sensor::default() },
        Sensor { full_well_electrons: 0.0, ..Sensor::default() },
    ] {
        assert!(sensor.expose(&grey_field(0.5)).is_err());
    }
    let folding = Camera::new(
        (800, 600),
        Vector2::repeat(300.0),
        Vector2::from(CENTER_PX),
        Distortion::PlumbBob([-0.9, 0.0, 0.0, 0.0, 0.0]),
    );
    assert!(Eye::new(&folding.unwrap()).is_err());
}
