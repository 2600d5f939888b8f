//! Gravity loads: differences of the potential, and batches against single postures.

use crate::robot_kinematics::{random_positions, random_urdf};
use approx::assert_relative_eq;
use mirror_core::geometry::rotation::moved;
use mirror_core::robot::{Direction, JointTwist, Poses, Robot};
use nalgebra::{Isometry3, Matrix3xX, Point3, Vector3, Vector6};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const GRAVITY: Vector3<f64> = Vector3::new(1.0, -2.0, -9.0);

/// Potential energy while a link is held: from the places of the masses alone.
fn potential(robot: &Robot, poses: &Poses, held: usize) -> f64 {
    let energy = |(i, link): (usize, &mirror_core::robot::Link)| {
        -link.mass_kg * GRAVITY.dot(&(poses.a_from_b(held, i) * link.com_in_link_m).coords)
    };
    robot.links().iter().enumerate().map(energy).sum()
}

#[test]
fn torques_are_the_slope_of_the_potential_whichever_link_is_held() {
    const STEP: f64 = 1e-5;
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for seed in 0..30 {
        let robot = Robot::from_urdf_str(&random_urdf(seed, 20)).unwrap();
        let (q, held) = (random_positions(&mut rng, &robot), rng.random_range(0..21));
        let mut loads = robot.new_gravity_loads();
        robot.gravity_loads(&robot.poses(&q).unwrap(), &GRAVITY, held, &mut loads).unwrap();
        for k in 0..q.len() {
            let at = |sign: f64| {
                let mut moved = q.clone();
                moved[k] += sign * STEP;
                potential(&robot, &robot.poses(&moved).unwrap(), held)
            };
            assert_relative_eq!(loads.torques()[k], -(at(1.0) - at(-1.0)) / (2.0 * STEP), epsilon = 1e-6);
        }
    }
}

/// `held_from_link` with a tangent inserted after one joint.
fn bent(
    robot: &Robot,
    poses: &Poses,
    held: usize,
    link: usize,
    joint: usize,
    tangent: &Vector6<f64>,
) -> Isometry3<f64> {
    let mut held_from_link = Isometry3::identity();
    for step in robot.chain(held, link).unwrap().steps {
        let j = &robot.joints()[step.joint];
        let mut motion = poses.a_from_b(j.parent_link, j.child_link);
        if step.joint == joint {
            motion = moved(&motion, tangent);
        }
        held_from_link *= if step.direction == Direction::Down { motion } else { motion.inverse() };
    }
    held_from_link
}

#[test]
fn moments_and_forces_are_the_slope_by_a_tangent_after_the_joint() {
    const STEP: f64 = 1e-5;
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for seed in 0..20 {
        let robot = Robot::from_urdf_str(&random_urdf(seed, 14)).unwrap();
        let (q, held) = (random_positions(&mut rng, &robot), rng.random_range(0..15));
        let poses = robot.poses(&q).unwrap();
        let mut loads = robot.new_gravity_loads();
        robot.gravity_loads(&poses, &GRAVITY, held, &mut loads).unwrap();
        let joint = rng.random_range(0..14);
        for k in 0..6 {
            let at = |sign: f64| -> f64 {
                let mut tangent = Vector6::zeros();
                tangent[k] = sign * STEP;
                let place = |i: usize| {
                    bent(&robot, &poses, held, i, joint, &tangent) * robot.links()[i].com_in_link_m
                };
                (0..15).map(|i| -robot.links()[i].mass_kg * GRAVITY.dot(&place(i).coords)).sum()
            };
            let slope = -(at(1.0) - at(-1.0)) / (2.0 * STEP);
            let load = &loads.joints()[joint];
            let got = if k < 3 { load.moment_in_link_nm[k] } else { load.force_in_link_n[k - 3] };
            assert_relative_eq!(got, slope, epsilon = 1e-6);
        }
    }
}

#[test]
fn a_batch_is_its_postures_one_by_one() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for (seed, count) in [(0, 1), (1, 7), (2, 8), (3, 9), (4, 300)] {
        let robot = Robot::from_urdf_str(&random_urdf(seed, 25)).unwrap();
        let (links, joints, width) = (26, 25, robot.position_count());
        let q: Vec<f64> = (0..count).flat_map(|_| random_positions(&mut rng, &robot)).collect();
        let (a, b) = (rng.random_range(0..links), rng.random_range(0..links));
        let point = Point3::new(0.1, 0.2, -0.3);
        let [mut fk, mut twists, mut points, mut jacobians, mut torques, mut moments] =
            [links * 16, joints * 6, 3, 3 * width, width, joints * 3]
                .map(|each| vec![f64::NAN; count * each]);
        robot.forward_kinematics_batch(&q, &mut fk).unwrap();
        robot.joint_twists_batch(&q, &mut twists).unwrap();
        robot.points_batch(&q, a, b, &point, &mut points).unwrap();
        robot.point_jacobians_batch(&q, a, b, &point, &mut jacobians).unwrap();
        robot.gravity_torques_batch(&q, &GRAVITY, a, &mut torques).unwrap();
        robot.gravity_moments_batch(&q, &GRAVITY, a, &mut moments).unwrap();
        let mut poses = robot.new_poses();
        let mut loads = robot.new_gravity_loads();
        let mut single = vec![JointTwist::default(); joints];
        let mut jacobian = Matrix3xX::zeros(width);
        for n in 0..count {
            robot.forward_kinematics(&q[n * width..(n + 1) * width], &mut poses).unwrap();
            for i in 0..links {
                let matrix = poses.root_from_link(i).to_homogeneous();
                let got = nalgebra::Matrix4::from_row_slice(&fk[(n * links + i) * 16..][..16]);
                assert_relative_eq!(got, matrix, epsilon = 1e-12);
            }
            robot.joint_twists(&poses, &mut single).unwrap();
            for j in 0..joints {
                let got = &twists[(n * joints + j) * 6..][..6];
                assert_relative_eq!(
                    Vector3::from_column_slice(&got[..3]),
                    single[j].angular,
                    epsilon = 1e-12
                );
                assert_relative_eq!(
                    Vector3::from_column_slice(&got[3..]),
                    single[j].linear_at_root,
                    epsilon = 1e-12
                );
            }
            let got = Point3::from_slice(&points[n * 3..][..3]);
            assert_relative_eq!(got, poses.point_in_a(a, b, &point), epsilon = 1e-12);
            robot.point_jacobian(&poses, a, b, &point, &mut jacobian).unwrap();
            let got = Matrix3xX::from_row_slice(&jacobians[n * 3 * width..][..3 * width]);
            assert_relative_eq!(got, jacobian, epsilon = 1e-12);
            robot.gravity_loads(&poses, &GRAVITY, a, &mut loads).unwrap();
            for k in 0..width {
                assert_relative_eq!(torques[n * width + k], loads.torques()[k], epsilon = 1e-10);
            }
            for j in 0..joints {
                let got = Vector3::from_column_slice(&moments[(n * joints + j) * 3..][..3]);
                assert_relative_eq!(got, loads.joints()[j].moment_in_link_nm, epsilon = 1e-10);
            }
        }
    }
}

#[test]
fn a_bad_row_is_named() {
    let robot = Robot::from_urdf_str(&random_urdf(1, 12)).unwrap();
    let width = robot.position_count();
    let mut q = vec![0.0; 5 * width];
    q[3 * width + 1] = f64::NAN;
    let error = robot.points_batch(&q, 0, 1, &Point3::origin(), &mut [0.0; 15]).unwrap_err().to_string();
    let name = robot.position_names().nth(1).unwrap();
    assert!(error.contains("row) 3") && error.contains(name), "{error}");
    assert!(robot.points_batch(&q[..width + 1], 0, 1, &Point3::origin(), &mut [0.0; 3]).is_err());
    assert!(robot.chain(0, 99).is_err());
    assert!(robot.poses(&q[..width - 1]).is_err());
}
