//! What must hold for any input at the core's borders: a thing that works, or an error that says why not.
//!
//! Each function is the body of a fuzz target (`fuzz_targets/`), and is run on the corpus and on a few mutations of it by the core's
//! own tests. They panic where something else happens.

mod bytes;
mod recording;

pub use recording::{diagnosis, recording};

use bytes::Bytes;
use mirror_core::camera::{Camera, Distortion};
use mirror_core::picture::{Dress, Shape};
use mirror_core::robot::Robot;
use nalgebra::{Point3, Vector2, Vector3};

/// Any text is a robot that moves, or an error that says why not.
pub fn urdf(text: &str) {
    let robot = match Robot::from_urdf_str(text) {
        Ok(robot) => robot,
        Err(refusal) => {
            assert!(!refusal.to_string().is_empty());
            return;
        }
    };
    assert_eq!(robot.links().len(), robot.joints().len() + 1);
    let q = vec![0.7; robot.position_count()];
    let poses = robot.poses(&q).expect("finite positions of the right number");
    let mut loads = robot.new_gravity_loads();
    let last = robot.links().len() - 1;
    robot
        .gravity_loads(&poses, &Vector3::new(0.0, 0.0, -9.81), last, &mut loads)
        .expect("loads of this robot");
    let mut batch = vec![0.0; robot.links().len() * 16];
    robot.forward_kinematics_batch(&q, &mut batch).expect("room for one posture");
    for link in 0..robot.links().len() {
        let single = poses.root_from_link_rotation(link);
        for (i, j) in (0..3).flat_map(|i| (0..3).map(move |j| (i, j))) {
            let in_batch = batch[16 * link + 4 * i + j];
            assert!(in_batch.is_finite() && (in_batch - single[(i, j)]).abs() < 1e-9);
        }
    }
}

/// Any text dresses a robot in solids of positive, finite size, or is an error that says why not.
pub fn dress(text: &str) {
    let dress = match Dress::from_urdf(text) {
        Ok(dress) => dress,
        Err(refusal) => {
            assert!(!refusal.to_string().is_empty());
            return;
        }
    };
    for visual in &dress.visuals {
        let sizes = match visual.shape {
            Shape::Ball { radius_m } => vec![radius_m],
            Shape::Cylinder { radius_m, half_length_m } => vec![radius_m, half_length_m],
            Shape::Block { half_m } => half_m.iter().copied().collect(),
            _ => Vec::new(),
        };
        assert!(sizes.iter().all(|x| x.is_finite() && *x > 0.0), "{sizes:?}");
        assert!(visual.link_from_body.to_homogeneous().iter().all(|x| x.is_finite()));
    }
}

/// Numbers that the border of a session lets through are at most this large.
const LARGEST_NUMBER: f64 = 1e12;

/// Any numbers are a camera whose projections are finite and come back, or an error that says why not.
pub fn camera(data: &[u8]) {
    let mut bytes = Bytes::new(data);
    let lens = match bytes.below(3) {
        0 => Distortion::None,
        1 => Distortion::PlumbBob(bytes.numbers()),
        _ => Distortion::RationalPolynomial(bytes.numbers()),
    };
    let size = (u32::from(bytes.byte()) * 16, u32::from(bytes.byte()) * 16);
    let (focal, center) = (Vector2::from(bytes.numbers::<2>()), Vector2::from(bytes.numbers::<2>()));
    if focal.iter().chain(center.iter()).chain(&lens.coefficients()).any(|x| x.abs() > LARGEST_NUMBER) {
        return;
    }
    let camera = match Camera::new(size, focal, center, lens) {
        Ok(camera) => camera,
        Err(refusal) => {
            assert!(!refusal.to_string().is_empty());
            return;
        }
    };
    for _ in 0..4 {
        let point = Point3::from(bytes.numbers::<3>());
        if let Ok(seen) = camera.project_with_jacobians(&point) {
            let plain = camera.project(&point).expect("as with its Jacobians");
            assert!((plain - seen.pixel).norm() <= 1e-9 * plain.norm().max(1.0) || !plain.norm().is_finite());
        }
        let pixel = Vector2::from(bytes.numbers::<2>());
        if let Ok(ray) = camera.unproject(&pixel) {
            assert!((ray.norm() - 1.0).abs() < 1e-9, "{ray:?}");
            if let Ok((again, by_point)) = camera.project_with_point_jacobian(&Point3::from(ray.into_inner()))
            {
                // A lens with coefficients of 1e12 makes 0.2 % of the last digit of a ray.
                let rounding = 16.0 * f64::EPSILON * by_point.norm();
                let allowed = 1e-3 * (1.0 + focal.norm() + pixel.norm()) + rounding;
                assert!((again - pixel).norm() <= allowed, "{pixel:?} {again:?} {allowed}");
            }
        }
    }
}
