//! Glass and curvature against rays traced by other means: vector Snell through two faces, a sphere by centre and radius.

use mirror_core::camera::{Camera, Distortion};
use mirror_core::geometry::{Plane, Reflection};
use mirror_core::mirror::{Curvature, GlassPane, MirrorOptics};
use nalgebra::{Matrix2, Matrix3, Point3, Rotation3, Unit, Vector2, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Refraction of a unit direction at a unit normal on the incoming side (vector form of Snell's law).
fn refract(direction: Vector3<f64>, toward: Vector3<f64>, ratio: f64) -> Vector3<f64> {
    let cos_in = direction.dot(&toward);
    let cos_out = (1.0 - ratio * ratio * (1.0 - cos_in * cos_in)).sqrt();
    direction * ratio + toward * (cos_out - ratio * cos_in)
}

fn mirrored(direction: Vector3<f64>, normal: Vector3<f64>) -> Vector3<f64> {
    direction - normal * (2.0 * direction.dot(&normal))
}

/// A ray from the camera through front face, silver and out again: (a point on it, direction).
pub fn trace_pane(
    r: Vector3<f64>,
    n: Vector3<f64>,
    front: f64,
    t: f64,
    index: f64,
) -> (Vector3<f64>, Vector3<f64>) {
    let r = r.normalize();
    let entry = r * (front / n.dot(&r));
    let inside = refract(r, n, 1.0 / index);
    let silver = entry + inside * (t / n.dot(&inside));
    let back = mirrored(inside, n);
    let exit = silver + back * (t / -n.dot(&back));
    (exit, refract(back, -n, index))
}

/// A ray from the camera mirrored at a sphere of given centre and signed radius (positive: concave).
fn trace_sphere(r: Vector3<f64>, center: Vector3<f64>, radius: f64) -> (Vector3<f64>, Vector3<f64>) {
    let r = r.normalize();
    let b = r.dot(&center);
    let root = (b * b - center.norm_squared() + radius * radius).sqrt();
    // Concave: the far side of the sphere, seen from inside; convex: its near side, seen from outside.
    let hit = r * if radius > 0.0 { b + root } else { b - root };
    (hit, mirrored(r, (hit - center).normalize()))
}

/// The camera direction whose traced ray passes through a point, by shooting with differences.
pub fn shoot(
    point: Vector3<f64>,
    start: Vector3<f64>,
    trace: impl Fn(Vector3<f64>) -> (Vector3<f64>, Vector3<f64>),
) -> Vector3<f64> {
    let miss = |xy: Vector2<f64>| {
        let (on, along) = trace(Vector3::new(xy.x, xy.y, 1.0));
        let away = point - on;
        let e1 = along.cross(&Vector3::x()).normalize();
        let e2 = along.cross(&e1).normalize();
        Vector2::new(away.dot(&e1), away.dot(&e2))
    };
    let mut xy = Vector2::new(start.x / start.z, start.y / start.z);
    for _ in 0..40 {
        let h = 1e-5;
        let du = (miss(xy + Vector2::new(h, 0.0)) - miss(xy - Vector2::new(h, 0.0))) / (2.0 * h);
        let dv = (miss(xy + Vector2::new(0.0, h)) - miss(xy - Vector2::new(0.0, h))) / (2.0 * h);
        xy -= Matrix2::from_columns(&[du, dv]).try_inverse().unwrap() * miss(xy);
    }
    assert!(miss(xy).norm() < 1e-12, "the reference did not converge: {:e} m", miss(xy).norm());
    Vector3::new(xy.x, xy.y, 1.0).normalize()
}

fn scene(rng: &mut ChaCha8Rng) -> (Plane, Point3<f64>) {
    let normal = Rotation3::from_euler_angles(rng.random_range(-0.5..0.5), rng.random_range(-0.5..0.5), 0.0)
        * Vector3::z();
    let plane = Plane::new(normal, rng.random_range(0.1..0.5)).unwrap();
    loop {
        let point = Point3::new(
            rng.random_range(-0.3..0.3),
            rng.random_range(-0.3..0.3),
            rng.random_range(-0.2..0.4),
        );
        // Points that the pinhole can see in the mirror, with room for the rays to bend.
        let seen = Reflection::across(plane).point(&point);
        if plane.signed_distance_m(&point) < -0.01 && seen.z > 0.1 && seen.coords.xy().norm() < 2.0 * seen.z {
            return (plane, point);
        }
    }
}

#[test]
fn the_pane_bends_rays_as_traced_ones_do() {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    for _ in 0..300 {
        let (plane, point) = scene(&mut rng);
        let (thickness, index) = (rng.random_range(0.0..0.012), rng.random_range(1.0..1.9));
        let optics = MirrorOptics::of_glass(GlassPane::new(thickness, index).unwrap());
        let n = plane.normal().into_inner();
        let seen = optics.apparent_point(&plane, &point).unwrap();
        let traced = shoot(point.coords, Reflection::across(plane).point(&point).coords, |r| {
            trace_pane(r, n, plane.offset_m(), thickness, index)
        });
        assert!((seen.coords.normalize() - traced).norm() < 1e-11, "{plane:?} {point:?} {thickness} {index}");
        // The inverse: the virtual ray of the traced direction passes through the point.
        let ray = optics.virtual_ray(&plane, &Unit::new_normalize(traced)).unwrap();
        assert!(ray.distance_m(&point) < 1e-11, "{:e}", ray.distance_m(&point));
    }
}

#[test]
fn the_curved_mirror_reflects_as_a_traced_sphere_does() {
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    for _ in 0..300 {
        let (plane, point) = scene(&mut rng);
        let curvature: f64 = rng.random_range(0.02..0.4) * if rng.random_bool(0.5) { 1.0 } else { -1.0 };
        let optics =
            MirrorOptics { curvature: Curvature::new(curvature).unwrap(), ..MirrorOptics::default() };
        let center = plane.foot_point() - plane.normal().into_inner() / curvature;
        let seen = optics.apparent_point(&plane, &point).unwrap();
        let traced = shoot(point.coords, Reflection::across(plane).point(&point).coords, |r| {
            trace_sphere(r, center, 1.0 / curvature)
        });
        assert!((seen.coords.normalize() - traced).norm() < 1e-10, "{plane:?} {point:?} {curvature}");
        let ray = optics.virtual_ray(&plane, &Unit::new_normalize(traced)).unwrap();
        assert!(ray.distance_m(&point) < 1e-10, "{:e}", ray.distance_m(&point));
    }
}

#[test]
fn at_exactly_zero_it_is_the_ideal_mirror() {
    let mut rng = ChaCha8Rng::seed_from_u64(13);
    for _ in 0..100 {
        let (plane, point) = scene(&mut rng);
        let mirror = Reflection::across(plane);
        let zero = MirrorOptics {
            pane: GlassPane::new(0.0, 1.52).unwrap(),
            curvature: Curvature::new(0.0).unwrap(),
        };
        let seen = zero.apparent_point_with_jacobians(&plane, &point).unwrap();
        assert!((seen.point - mirror.point(&point)).norm() < 1e-15);
        assert!((seen.by_point - mirror.linear()).norm() < 1e-14);
        assert!((zero.apparent_point(&plane, &point).unwrap() - seen.point).norm() < 1e-15);
        let direction = Unit::new_normalize(seen.point.coords);
        let ray = zero.virtual_ray(&plane, &direction).unwrap();
        assert!((ray.origin.coords - mirror.translation()).norm() < 1e-15);
        assert!((ray.direction.into_inner() - mirror.vector(&direction)).norm() < 1e-14);
        // No jump between 0 and next to it.
        let near = MirrorOptics {
            pane: GlassPane::new(1e-13, 1.52).unwrap(),
            curvature: Curvature::new(1e-13).unwrap(),
        };
        let nudged = near.apparent_point_with_jacobians(&plane, &point).unwrap();
        assert!((nudged.point - seen.point).norm() < 1e-12);
        assert!((nudged.by_thickness - seen.by_thickness).norm() < 1e-9);
        assert!((nudged.by_curvature - seen.by_curvature).norm() < 1e-9);
    }
    // A point on the mirror's axis: the lateral direction is not defined, the result is.
    let plane = Plane::new(Vector3::z(), 0.2).unwrap();
    let on_axis =
        MirrorOptics { pane: GlassPane::new(0.003, 1.5).unwrap(), curvature: Curvature::new(0.1).unwrap() }
            .apparent_point_with_jacobians(&plane, &Point3::new(0.0, 0.0, -0.05))
            .unwrap();
    assert!(on_axis.by_point.iter().chain(on_axis.by_foot_point.iter()).all(|x| x.is_finite()));
}

#[test]
fn jacobians_are_the_slopes_also_at_zero() {
    let camera = Camera::new(
        (800, 600),
        Vector2::new(693.0, 690.0),
        Vector2::new(400.0, 300.0),
        Distortion::PlumbBob([-0.05, 0.01, 1e-3, -5e-4, 0.0]),
    )
    .unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(14);
    for case in 0..120 {
        let (plane, point) = scene(&mut rng);
        // Thickness and curvature at exactly 0, one alone, and both.
        let thickness = if case % 2 == 0 { 0.0 } else { rng.random_range(0.001..0.01) };
        let curvature = if case % 3 == 0 { 0.0 } else { rng.random_range(-0.3..0.3) };
        let at = |f: Vector3<f64>, p: Vector3<f64>, t: f64, k: f64| {
            let optics = |t: f64| MirrorOptics {
                pane: GlassPane::new(t, 1.52).unwrap(),
                curvature: Curvature::new(k).unwrap(),
            };
            optics(t).project(&camera, &Plane::from_foot_point(&f).unwrap(), &Point3::from(p))
        };
        let optics = MirrorOptics {
            pane: GlassPane::new(thickness, 1.52).unwrap(),
            curvature: Curvature::new(curvature).unwrap(),
        };
        let Ok(j) = optics.project_with_jacobians(&camera, &plane, &point) else { continue };
        let f = plane.foot_point();
        let h = 1e-6;
        for axis in 0..3 {
            let e = Matrix3::identity().column(axis) * h;
            let by_point = (at(f, point.coords + e, thickness, curvature).unwrap()
                - at(f, point.coords - e, thickness, curvature).unwrap())
                / (2.0 * h);
            assert!((by_point - j.by_point.column(axis)).norm() < 1e-6 * (1.0 + j.by_point.norm()));
            let by_foot = (at(f + e, point.coords, thickness, curvature).unwrap()
                - at(f - e, point.coords, thickness, curvature).unwrap())
                / (2.0 * h);
            assert!((by_foot - j.by_foot_point.column(axis)).norm() < 1e-6 * (1.0 + j.by_foot_point.norm()));
        }
        // One-sided of second order where a thickness below 0 is not a pane.
        let by_thickness = (at(f, point.coords, thickness + h, curvature).unwrap() * 4.0
            - at(f, point.coords, thickness + 2.0 * h, curvature).unwrap()
            - at(f, point.coords, thickness, curvature).unwrap() * 3.0)
            / (2.0 * h);
        assert!((by_thickness - j.by_thickness).norm() < 1e-5 * (1.0 + j.by_thickness.norm()));
        let k = 1e-5;
        let by_curvature = (at(f, point.coords, thickness, curvature + k).unwrap()
            - at(f, point.coords, thickness, curvature - k).unwrap())
            / (2.0 * k);
        assert!((by_curvature - j.by_curvature).norm() < 1e-5 * (1.0 + j.by_curvature.norm()), "{case}");
    }
}

#[test]
fn three_millimetres_of_float_glass_look_like_a_mirror_two_millimetres_behind_its_face() {
    let pane = GlassPane::new(0.003, 1.52).unwrap();
    assert!((pane.paraxial_depth_m() - 0.00197).abs() < 5e-6);
    let plane = Plane::new(Vector3::z(), 0.15).unwrap();
    let seen = MirrorOptics::of_glass(pane).apparent_point(&plane, &Point3::new(1e-6, 0.0, 0.0)).unwrap();
    assert!((seen.z - 2.0 * (0.15 + pane.paraxial_depth_m())).abs() < 1e-9);
}

#[test]
fn what_makes_no_sense_is_refused() {
    assert!(GlassPane::new(3.0, 1.52).unwrap_err().to_string().contains("millimetres"));
    assert!(GlassPane::new(-0.001, 1.52).is_err());
    assert!(GlassPane::new(0.003, 0.9).is_err());
    assert!(GlassPane::new(f64::NAN, 1.5).is_err());
    assert!(Curvature::new(f64::INFINITY).is_err());
    let plane = Plane::new(Vector3::z(), 0.2).unwrap();
    let ideal = MirrorOptics::IDEAL;
    assert!(ideal.apparent_point(&plane, &Point3::new(0.0, 0.0, 0.21)).is_err());
    assert!(ideal.apparent_point(&plane.flipped(), &Point3::origin()).is_err());
    assert!(ideal.apparent_point(&plane, &Point3::new(0.0, 0.0, f64::NAN)).is_err());
    assert!(ideal.virtual_ray(&plane, &-Vector3::z_axis()).is_err());
    // A concave mirror that focuses the camera on the point shows it everywhere.
    let focusing = MirrorOptics { curvature: Curvature::new(5.0).unwrap(), ..ideal };
    assert!(focusing.apparent_point(&plane, &Point3::new(0.01, 0.0, 0.0)).is_err());
}
