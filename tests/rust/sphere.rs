//! The picture of a ball against a picture of it: rays cast over a fine grid, those that hit counted.

use mirror_core::camera::{Camera, Distortion};
use mirror_core::geometry::{Plane, Reflection};
use mirror_core::mirror::Sphere;
use nalgebra::{Point3, Vector2, Vector3};

const F_PX: f64 = 693.0;

fn camera(lens: Distortion) -> Camera {
    Camera::new((800, 600), Vector2::new(F_PX, F_PX), Vector2::new(399.5, 299.5), lens).unwrap()
}

/// The centroid of the pixels' area whose rays meet the ball: rows of the picture, their ends found by bisection.
pub fn cast_centroid(camera: &Camera, center: Point3<f64>, radius: f64) -> Vector2<f64> {
    let cosine = (1.0 - (radius / center.coords.norm()).powi(2)).sqrt();
    let axis = center.coords.normalize();
    let hits = |u: f64, v: f64| {
        camera.unproject(&Vector2::new(u, v)).is_ok_and(|direction| direction.dot(&axis) > cosine)
    };
    let middle = camera.project(&center).unwrap();
    let reach = 2.5 * F_PX * radius / center.z;
    let edge = |mut inside: f64, mut outside: f64, v: f64| {
        for _ in 0..45 {
            let half = 0.5 * (inside + outside);
            if hits(half, v) { inside = half } else { outside = half }
        }
        inside
    };
    let rows = 4000;
    let (mut area, mut first_u, mut first_v) = (0.0, 0.0, 0.0);
    for row in 0..rows {
        let v = middle.y + reach * (2.0 * (f64::from(row) + 0.5) / f64::from(rows) - 1.0);
        // A seed inside the row: the ball is convex, so scan coarsely.
        let seed = (0..400).map(|i| middle.x + reach * (f64::from(i) / 200.0 - 1.0)).find(|u| hits(*u, v));
        if let Some(seed) = seed {
            let (left, right) =
                (edge(seed, middle.x - 2.0 * reach, v), edge(seed, middle.x + 2.0 * reach, v));
            area += right - left;
            first_u += 0.5 * (right * right - left * left);
            first_v += v * (right - left);
        }
    }
    Vector2::new(first_u, first_v) / area
}

#[test]
fn the_known_bias_off_axis() {
    let camera = camera(Distortion::None);
    let ball = Sphere::of_diameter_m(0.0116).unwrap();
    for (degrees, expected_px) in [(10.0, 0.05), (20.0, 0.11), (30.0, 0.20), (36.0, 0.29)] {
        let angle = f64::to_radians(degrees);
        let center = Point3::new(0.3 * angle.sin(), 0.0, 0.3 * angle.cos());
        let bias = (ball.project(&camera, &center).unwrap() - camera.project(&center).unwrap()).norm();
        assert!((bias - expected_px).abs() < 0.005, "{degrees} degrees: {bias:.4} px");
    }
}

#[test]
fn the_centroid_is_that_of_the_rays_that_hit() {
    for lens in [
        Distortion::None,
        Distortion::PlumbBob([-0.28, 0.09, 1e-3, -8e-4, -0.012]),
        Distortion::PlumbBob([0.12, -0.1, 2e-3, 1e-3, 0.02]),
    ] {
        let camera = camera(lens);
        let ball = Sphere::of_diameter_m(0.0116).unwrap();
        for center in
            [Point3::new(0.02, 0.01, 0.25), Point3::new(-0.13, 0.09, 0.3), Point3::new(0.1, -0.12, 0.22)]
        {
            let centroid = ball.project(&camera, &center).unwrap();
            let cast = cast_centroid(&camera, center, ball.radius_m());
            assert!((centroid - cast).norm() < 2e-3, "{lens:?} {center:?}: {:?}", centroid - cast);
        }
    }
}

#[test]
fn the_inverse_gives_the_centre_back() {
    for lens in [Distortion::None, Distortion::PlumbBob([-0.28, 0.09, 1e-3, -8e-4, -0.012])] {
        let camera = camera(lens);
        let ball = Sphere::of_diameter_m(0.0116).unwrap();
        // A ball seen in a mirror is a ball behind it.
        let mirror = Reflection::across(Plane::new(Vector3::new(0.1, -0.2, 1.0), 0.16).unwrap());
        for point in
            [Point3::new(0.05, 0.08, 0.02), Point3::new(-0.08, 0.03, 0.0), Point3::new(0.0, 0.0, 0.01)]
        {
            let behind = mirror.point(&point);
            let centroid = ball.project(&camera, &behind).unwrap();
            let back = ball.center_pixel(&camera, &centroid, behind.coords.norm()).unwrap();
            assert!((back - camera.project(&behind).unwrap()).norm() < 1e-9);
        }
    }
}

#[test]
fn the_jacobian_is_the_slope() {
    for (lens, tolerance) in
        [(Distortion::None, 1e-8), (Distortion::PlumbBob([-0.28, 0.09, 1e-3, -8e-4, -0.012]), 1e-3)]
    {
        let camera = camera(lens);
        let ball = Sphere::of_diameter_m(0.0116).unwrap();
        let center = Point3::new(-0.13, 0.09, 0.3);
        let by = ball.project_with_jacobian(&camera, &center).unwrap().by_center;
        for axis in 0..3 {
            let mut e = Vector3::zeros();
            e[axis] = 1e-6;
            let slope = (ball.project(&camera, &(center + e)).unwrap()
                - ball.project(&camera, &(center - e)).unwrap())
                / 2e-6;
            assert!((slope - by.column(axis)).norm() < tolerance * by.norm());
        }
    }
}

#[test]
fn a_point_is_a_ball_of_no_size_and_nonsense_is_refused() {
    let camera = camera(Distortion::None);
    let center = Point3::new(0.1, 0.05, 0.3);
    let point = Sphere::of_diameter_m(0.0).unwrap();
    assert_eq!(point.project(&camera, &center).unwrap(), camera.project(&center).unwrap());
    assert!(Sphere::of_diameter_m(-0.01).is_err());
    assert!(Sphere::of_diameter_m(f64::NAN).is_err());
    let ball = Sphere::of_diameter_m(0.0116).unwrap();
    assert!(ball.project(&camera, &Point3::new(0.0, 0.0, 0.005)).is_err());
    assert!(ball.center_pixel(&camera, &Vector2::new(400.0, 300.0), 0.001).is_err());
}
