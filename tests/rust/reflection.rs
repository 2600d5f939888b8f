//! Axioms of reflections, as properties.

use approx::assert_relative_eq;
use mirror_core::geometry::{ImproperIsometry, Plane, Ray, Reflection, rotation};
use nalgebra::{Isometry3, Matrix3, Point3, Translation3, UnitQuaternion, Vector3, Vector6};
use proptest::prelude::*;

fn direction() -> impl Strategy<Value = Vector3<f64>> {
    (-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64)
        .prop_map(|(x, y, z)| Vector3::new(x, y, z))
        .prop_filter("has a direction", |v| v.norm() > 0.05)
}

fn point() -> impl Strategy<Value = Point3<f64>> {
    (-2.0..2.0f64, -2.0..2.0f64, -2.0..2.0f64).prop_map(|(x, y, z)| Point3::new(x, y, z))
}

fn plane() -> impl Strategy<Value = Plane> {
    (direction(), -1.5..1.5f64).prop_map(|(n, d)| Plane::new(n, d).unwrap())
}

fn pose() -> impl Strategy<Value = Isometry3<f64>> {
    (direction(), -3.0..3.0f64, point()).prop_map(|(axis, angle, t)| {
        let rotation = UnitQuaternion::from_scaled_axis(axis.normalize() * angle);
        Isometry3::from_parts(Translation3::from(t.coords), rotation)
    })
}

proptest! {
    #[test]
    fn a_reflection_is_its_own_inverse(plane in plane(), x in point()) {
        let r = Reflection::across(plane);
        assert_relative_eq!(r.point(&r.point(&x)), x, epsilon = 1e-12);
        assert_relative_eq!(r.then(&r), Isometry3::identity(), epsilon = 1e-12);
    }

    #[test]
    fn it_keeps_distances_and_turns_handedness(plane in plane(), x in point(), y in point()) {
        let r = Reflection::across(plane);
        assert_relative_eq!((r.point(&x) - r.point(&y)).norm(), (x - y).norm(), epsilon = 1e-12);
        assert_relative_eq!(r.linear().determinant(), -1.0, epsilon = 1e-12);
        assert_relative_eq!(r.linear() * r.linear().transpose(), Matrix3::identity(), epsilon = 1e-12);
    }

    #[test]
    fn it_fixes_exactly_the_planes_points(plane in plane(), x in point()) {
        let r = Reflection::across(plane);
        let foot = x - plane.normal().into_inner() * plane.signed_distance_m(&x);
        assert_relative_eq!(r.point(&foot), foot, epsilon = 1e-12);
        assert_relative_eq!((r.point(&x) - x).norm(), 2.0 * plane.signed_distance_m(&x).abs(), epsilon = 1e-12);
    }

    #[test]
    fn two_reflections_make_a_rigid_motion(a in plane(), b in plane(), x in point()) {
        let (a, b) = (Reflection::across(a), Reflection::across(b));
        let motion = a.then(&b);
        assert_relative_eq!(motion * x, b.point(&a.point(&x)), epsilon = 1e-11);
        assert_relative_eq!(motion.rotation.to_rotation_matrix().into_inner().determinant(), 1.0, epsilon = 1e-12);
    }

    #[test]
    fn it_is_equivariant_under_rigid_motions(plane in plane(), a_from_b in pose(), x in point()) {
        let in_b = Reflection::across(plane);
        let in_a = in_b.transformed(&a_from_b);
        assert_relative_eq!(in_a.point(&(a_from_b * x)), a_from_b * in_b.point(&x), epsilon = 1e-11);
    }

    /// The paper's A2′T A1′ = A2T A1: between reflected frames the transform is that between the frames.
    #[test]
    fn reflected_frames_relate_as_the_frames_do(plane in plane(), world_from_1 in pose(), world_from_2 in pose()) {
        let r = Reflection::across(plane).to_improper();
        let world_from_1r = r.after_isometry(&world_from_1);
        let world_from_2r = r.after_isometry(&world_from_2);
        let reflected = world_from_2r.inverse().after(&world_from_1r);
        assert_relative_eq!(reflected, world_from_2.inverse() * world_from_1, epsilon = 1e-11);
    }

    #[test]
    fn both_signs_of_the_normal_are_one_reflection(plane in plane(), x in point()) {
        let (r, f) = (Reflection::across(plane), Reflection::across(plane.flipped()));
        assert_relative_eq!(r.point(&x), f.point(&x), epsilon = 1e-12);
        assert_relative_eq!(plane.foot_point(), plane.flipped().foot_point(), epsilon = 1e-15);
        prop_assert!(plane.facing_away_from_origin().offset_m() >= 0.0);
    }

    #[test]
    fn the_plane_between_a_point_and_its_reflection_is_the_mirror(plane in plane(), x in point()) {
        prop_assume!(plane.signed_distance_m(&x).abs() > 0.01);
        let r = Reflection::across(plane);
        let found = Plane::between(&x, &r.point(&x)).unwrap().facing_away_from_origin();
        assert_relative_eq!(found.foot_point(), plane.foot_point(), epsilon = 1e-9);
    }

    #[test]
    fn a_reflection_is_its_own_nearest_reflection(plane in plane()) {
        let r = Reflection::across(plane).to_improper();
        let nearest = r.nearest_reflection().unwrap();
        assert_relative_eq!(nearest.linear(), *r.linear(), epsilon = 1e-9);
        assert_relative_eq!(nearest.translation(), *r.translation(), epsilon = 1e-9);
    }

    #[test]
    fn the_foot_point_gives_the_plane_and_its_derivative(n in direction(), d in 0.05..1.5f64) {
        let plane = Plane::new(n, d).unwrap();
        let back = Plane::from_foot_point(&plane.foot_point()).unwrap();
        assert_relative_eq!(back.normal().into_inner(), plane.normal().into_inner(), epsilon = 1e-12);
        assert_relative_eq!(back.offset_m(), d, epsilon = 1e-12);
        let by_foot = plane.normal_by_foot_point().unwrap();
        for axis in 0..3 {
            let mut h = Vector3::zeros();
            h[axis] = 1e-6;
            let ahead = Plane::from_foot_point(&(plane.foot_point() + h)).unwrap().normal();
            let behind = Plane::from_foot_point(&(plane.foot_point() - h)).unwrap().normal();
            let difference = (ahead.into_inner() - behind.into_inner()) / 2e-6;
            assert_relative_eq!(difference, by_foot.column(axis).into_owned(), epsilon = 1e-6);
        }
    }

    #[test]
    fn a_ray_that_leaves_the_plane_hits_nothing(plane in plane(), origin in point(), towards in direction()) {
        let ray = Ray::new(origin, towards).unwrap();
        let away = Ray { origin, direction: -ray.direction };
        let side = plane.signed_distance_m(&origin);
        prop_assume!(side.abs() > 1e-3 && plane.normal().dot(&ray.direction).abs() > 1e-3);
        prop_assert!(ray.hit(&plane).is_some() != away.hit(&plane).is_some());
        if let Some(hit) = ray.hit(&plane) {
            assert_relative_eq!(plane.signed_distance_m(&hit.point), 0.0, epsilon = 1e-9);
        }
    }

    #[test]
    fn the_tangent_of_poses_is_a_chart(a in pose(), w in (direction(), direction())) {
        let tangent = Vector6::new(w.0.x, w.0.y, w.0.z, w.1.x, w.1.y, w.1.z);
        assert_relative_eq!(rotation::difference(&rotation::moved(&a, &tangent), &a), tangent, epsilon = 1e-9);
        let omega = w.0;
        let jacobian = rotation::right_jacobian(&omega);
        assert_relative_eq!(jacobian * rotation::right_jacobian_inverse(&omega), Matrix3::identity(), epsilon = 1e-9);
        for axis in 0..3 {
            let mut h = Vector3::zeros();
            h[axis] = 1e-6;
            let step = |s: f64| rotation::log(&(rotation::exp(&omega).inverse() * rotation::exp(&(omega + h * s))));
            assert_relative_eq!((step(1.0) - step(-1.0)) / 2e-6, jacobian.column(axis).into_owned(), epsilon = 1e-7);
        }
    }
}

#[test]
fn rotation_series_are_right_at_zero() {
    assert_eq!(rotation::right_jacobian(&Vector3::zeros()), Matrix3::identity());
    assert_eq!(rotation::right_jacobian_inverse(&Vector3::zeros()), Matrix3::identity());
    // The series and the closed form meet where one replaces the other.
    let (below, above) = (Vector3::new(0.99e-4, 0.0, 0.0), Vector3::new(1.01e-4, 0.0, 0.0));
    let gap = rotation::right_jacobian(&below) - rotation::right_jacobian(&above);
    assert!(gap.norm() < 3e-6);
    let gap = rotation::right_jacobian_inverse(&below) - rotation::right_jacobian_inverse(&above);
    assert!(gap.norm() < 3e-6);
}

#[test]
fn degenerate_input_is_refused() {
    let zero = Vector3::zeros();
    assert!(Plane::new(zero, 1.0).is_err());
    assert!(Plane::new(Vector3::new(f64::NAN, 0.0, 1.0), 1.0).is_err());
    assert!(Plane::new(Vector3::z(), f64::INFINITY).is_err());
    assert!(Plane::from_foot_point(&zero).is_err());
    assert!(Plane::between(&Point3::origin(), &Point3::origin()).is_err());
    assert!(Ray::new(Point3::origin(), zero).is_err());
    assert!(ImproperIsometry::new(Matrix3::identity(), zero).is_err());
    assert!(ImproperIsometry::new(-2.0 * Matrix3::<f64>::identity(), zero).is_err());
    assert!(ImproperIsometry::new(-Matrix3::<f64>::identity(), zero).unwrap().nearest_reflection().is_err());
}
