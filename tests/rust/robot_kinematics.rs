//! Kinematics of the robot: an independent chain of nalgebra poses, and central differences.

use approx::assert_relative_eq;
use mirror_core::robot::{Direction, JointKind, Robot};
use nalgebra::{Isometry3, Matrix3xX, Matrix6xX, Point3, Translation3, UnitQuaternion, Vector3, Vector6};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::fmt::Write;

/// A random tree of `joints` joints with all kinds of joints and axes, as URDF text.
pub fn random_urdf(seed: u64, joints: usize) -> String {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut out = String::from("<robot name=\"random\">");
    let mut number = |low: f64, high: f64| rng.random_range(low..high);
    let mut movable: Vec<usize> = Vec::new();
    for link in 0..=joints {
        if link % 5 == 3 {
            let _ = write!(out, "<link name=\"l{link}\"/>");
        } else {
            let _ = write!(
                out,
                "<link name=\"l{link}\"><inertial><origin xyz=\"{} {} {}\" rpy=\"1 2 3\"/><mass value=\"{}\"/></inertial></link>",
                number(-0.1, 0.1),
                number(-0.1, 0.1),
                number(-0.1, 0.1),
                number(0.1, 2.0)
            );
        }
    }
    for joint in 0..joints {
        let kind = ["revolute", "continuous", "prismatic", "fixed", "revolute"][number(0.0, 5.0) as usize];
        let parent = number((joint as f64 - 4.0).max(0.0), joint as f64 + 0.999) as usize;
        let axis = match number(0.0, 6.0) as usize {
            0 => "1 0 0".to_owned(),
            1 => "0 1 0".to_owned(),
            2 => "0 0 1".to_owned(),
            3 => "0 -1 0".to_owned(),
            4 => "0 0 -2.5".to_owned(),
            _ => format!("{} {} {}", number(-1.0, 1.0), number(-1.0, 1.0), number(0.2, 1.0)),
        };
        let rpy = if number(0.0, 1.0) < 0.5 {
            "0 0 0".to_owned()
        } else {
            format!("{} {} {}", number(-3.0, 3.0), number(-1.5, 1.5), number(-3.0, 3.0))
        };
        let _ = write!(
            out,
            "<joint name=\"j{joint}\" type=\"{kind}\"><origin xyz=\"{} {} {}\" rpy=\"{rpy}\"/><parent link=\"l{parent}\"/>\
             <child link=\"l{}\"/><axis xyz=\"{axis}\"/><limit lower=\"-1\" upper=\"1\" effort=\"1\" velocity=\"1\"/>",
            number(-0.3, 0.3),
            number(-0.3, 0.3),
            number(-0.3, 0.3),
            joint + 1
        );
        if kind != "fixed" {
            if !movable.is_empty() && number(0.0, 1.0) < 0.2 {
                let mimicked = movable[number(0.0, movable.len() as f64) as usize];
                let _ = write!(
                    out,
                    "<mimic joint=\"j{mimicked}\" multiplier=\"{}\" offset=\"{}\"/>",
                    number(-1.5, 1.5),
                    number(-0.5, 0.5)
                );
            }
            movable.push(joint);
        }
        out.push_str("</joint>");
    }
    out.push_str("</robot>");
    out
}

pub fn random_positions(rng: &mut ChaCha8Rng, robot: &Robot) -> Vec<f64> {
    (0..robot.position_count()).map(|_| rng.random_range(-2.5..2.5)).collect()
}

/// A joint's transform by nalgebra's own quaternions: nothing of the kernel's formulas.
fn parent_from_child(robot: &Robot, joint: usize, theta: f64) -> Isometry3<f64> {
    let joint = &robot.joints()[joint];
    let motion = match joint.kind {
        JointKind::Fixed => Isometry3::identity(),
        JointKind::Prismatic => Isometry3::from_parts(
            Translation3::from(joint.axis.into_inner() * theta),
            UnitQuaternion::identity(),
        ),
        _ => Isometry3::from_parts(
            Translation3::identity(),
            UnitQuaternion::from_axis_angle(&joint.axis, theta),
        ),
    };
    joint.parent_from_joint * motion
}

#[test]
fn links_agree_with_a_chain_of_nalgebra_poses() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for seed in 0..40 {
        let robot = Robot::from_urdf_str(&random_urdf(seed, 30)).unwrap();
        let q = random_positions(&mut rng, &robot);
        let poses = robot.poses(&q).unwrap();
        let (a, b) = (rng.random_range(0..31), rng.random_range(0..31));
        let chain = robot.chain(a, b).unwrap();
        let mut a_from_b = Isometry3::identity();
        for step in &chain.steps {
            let motion = parent_from_child(&robot, step.joint, robot.joint_position(step.joint, &q));
            a_from_b *= if step.direction == Direction::Down { motion } else { motion.inverse() };
        }
        assert_relative_eq!(poses.a_from_b(a, b), a_from_b, epsilon = 1e-12);
        let root = poses.root_from_link(a).inverse() * poses.root_from_link(b);
        assert_relative_eq!(root, a_from_b, epsilon = 1e-12);
        let point = Point3::new(0.1, -0.2, 0.3);
        assert_relative_eq!(poses.point_in_a(a, b, &point), a_from_b * point, epsilon = 1e-12);
    }
}

#[test]
fn jacobians_agree_with_central_differences() {
    const STEP: f64 = 1e-6;
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for seed in 0..25 {
        let robot = Robot::from_urdf_str(&random_urdf(seed, 24)).unwrap();
        let count = robot.position_count();
        let q = random_positions(&mut rng, &robot);
        let poses = robot.poses(&q).unwrap();
        let (a, b) = (rng.random_range(0..25), rng.random_range(0..25));
        let point = Point3::new(0.2, 0.1, -0.3);
        let mut jacobian = Matrix3xX::zeros(count);
        robot.point_jacobian(&poses, a, b, &point, &mut jacobian).unwrap();
        let mut geometric = Matrix6xX::zeros(count);
        let here = poses.point_in_a(a, b, &point);
        robot.geometric_jacobian(&poses, a, b, &here, &mut geometric).unwrap();
        for k in 0..count {
            let at = |sign: f64| {
                let mut moved = q.clone();
                moved[k] += sign * STEP;
                robot.poses(&moved).unwrap()
            };
            let (plus, minus) = (at(1.0), at(-1.0));
            let difference = (plus.point_in_a(a, b, &point) - minus.point_in_a(a, b, &point)) / (2.0 * STEP);
            assert_relative_eq!(jacobian.column(k).into_owned(), difference, epsilon = 1e-8);
            assert_relative_eq!(geometric.fixed_view::<3, 1>(3, k).into_owned(), difference, epsilon = 1e-8);
            let turned = plus.a_from_b(a, b).rotation * minus.a_from_b(a, b).rotation.inverse();
            let omega: Vector3<f64> = turned.scaled_axis() / (2.0 * STEP);
            assert_relative_eq!(geometric.fixed_view::<3, 1>(0, k).into_owned(), omega, epsilon = 1e-8);
        }
    }
}

#[test]
fn a_tangent_at_a_joint_moves_the_point_as_its_jacobian_says() {
    const STEP: f64 = 1e-6;
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for seed in 0..25 {
        let robot = Robot::from_urdf_str(&random_urdf(seed, 20)).unwrap();
        let q = random_positions(&mut rng, &robot);
        let poses = robot.poses(&q).unwrap();
        let (a, b, joint) = (rng.random_range(0..21), rng.random_range(0..21), rng.random_range(0..20));
        let point = Point3::new(0.2, 0.1, -0.3);
        let jacobian = robot.twist_jacobian(&poses, a, b, &point, joint).unwrap();
        let chain = robot.chain(a, b).unwrap();
        for k in 0..6 {
            let at = |sign: f64| {
                let mut tangent = Vector6::zeros();
                tangent[k] = sign * STEP;
                let mut a_from_b = Isometry3::identity();
                for step in &chain.steps {
                    let theta = robot.joint_position(step.joint, &q);
                    let mut motion = parent_from_child(&robot, step.joint, theta);
                    if step.joint == joint {
                        motion = mirror_core::geometry::rotation::moved(&motion, &tangent);
                    }
                    a_from_b *= if step.direction == Direction::Down { motion } else { motion.inverse() };
                }
                a_from_b * point
            };
            let difference = (at(1.0) - at(-1.0)) / (2.0 * STEP);
            let block = if k < 3 { jacobian.wrt_omega } else { jacobian.wrt_v };
            assert_relative_eq!(block.column(k % 3).into_owned(), difference, epsilon = 1e-8);
        }
    }
}

#[test]
fn links_asked_for_are_those_of_all_links() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let robot = Robot::from_urdf_str(&random_urdf(11, 30)).unwrap();
    for count in [1, 7, 8, 130] {
        let q: Vec<f64> = (0..count).flat_map(|_| random_positions(&mut rng, &robot)).collect();
        // Out of order, and one twice.
        let links = [30, 0, 17, 17, 4];
        let mut some = vec![f64::NAN; count * links.len() * 16];
        robot.link_poses_batch(&q, &links, &mut some).unwrap();
        for (row, q) in some.chunks(links.len() * 16).zip(q.chunks(robot.position_count())) {
            let poses = robot.poses(q).unwrap();
            for (matrix, link) in row.chunks(16).zip(links) {
                let expected = poses.root_from_link(link).to_homogeneous();
                assert_relative_eq!(nalgebra::Matrix4::from_row_slice(matrix), expected, epsilon = 1e-12);
            }
        }
    }
    assert!(robot.link_poses_batch(&[], &[31], &mut []).unwrap_err().to_string().contains("31"));
}

#[test]
fn a_large_angle_in_one_lane_leaves_the_others_right() {
    // Beyond 1e5 rad the kernel's own reduction hands over to the standard library.
    let robot = Robot::from_urdf_str(&random_urdf(12, 20)).unwrap();
    let width = robot.position_count();
    let mut q: Vec<f64> = (0..8 * width).map(|i| (i as f64 * 0.37).sin()).collect();
    q[3 * width + 1] = 4.0e6;
    let each = robot.links().len() * 16;
    let mut batch = vec![0.0; 8 * each];
    robot.forward_kinematics_batch(&q, &mut batch).unwrap();
    for (row, q) in batch.chunks(each).zip(q.chunks(width)) {
        for (link, matrix) in row.chunks(16).enumerate() {
            let mut chain = Isometry3::identity();
            for step in &robot.chain(0, link).unwrap().steps {
                chain *= parent_from_child(&robot, step.joint, robot.joint_position(step.joint, q));
            }
            // A mimic joint may slide by metres times the angle: relative, not absolute.
            assert_relative_eq!(
                nalgebra::Matrix4::from_row_slice(matrix),
                chain.to_homogeneous(),
                epsilon = 1e-9,
                max_relative = 1e-9
            );
        }
    }
}
