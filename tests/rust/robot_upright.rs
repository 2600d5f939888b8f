//! Which way is up on a link: an error of a joint is a posture that the robot was not sent to.

use crate::robot_kinematics::{random_positions, random_urdf};
use approx::assert_relative_eq;
use mirror_core::geometry::directions::{rms_angle, rms_angle_turned};
use mirror_core::geometry::rotation::{exp, nearest};
use mirror_core::robot::{JointErrors, JointKind, Robot};
use nalgebra::{Matrix3, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const GRAVITY: Vector3<f64> = Vector3::new(1.0, -3.0, -9.0);

/// Joints that turn by a coordinate of their own alone, with their position and its multiplier.
fn turning(robot: &Robot) -> Vec<(usize, usize, f64)> {
    let joints = robot.joints().iter().enumerate();
    joints
        .filter(|(_, j)| matches!(j.kind, JointKind::Revolute | JointKind::Continuous))
        .filter_map(|(k, j)| j.drive.map(|d| (k, d.position, d.multiplier)))
        .filter(|(_, position, _)| {
            robot.joints().iter().filter(|j| j.drive.is_some_and(|d| d.position == *position)).count() == 1
        })
        .collect()
}

#[test]
fn errors_of_joints_are_another_posture() {
    for seed in 0..20 {
        let robot = Robot::from_urdf_str(&random_urdf(seed, 12)).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(100 + seed);
        let (one, other) = (random_positions(&mut rng, &robot), random_positions(&mut rng, &robot));
        let sent = [one, other].concat();
        let (mut real, width) = (sent.clone(), robot.position_count());
        let mut errors = Vec::new();
        for (joint, position, multiplier) in turning(&robot) {
            let axis = robot.joints()[joint].axis.into_inner();
            // A part as an error of the position, a part as bending about the axis.
            let error: [[f64; 2]; 2] =
                core::array::from_fn(|_| core::array::from_fn(|_| rng.random_range(-0.5..0.5)));
            for (row, [turn, bend]) in error.iter().enumerate() {
                real[row * width + position] += (turn + bend) / multiplier;
            }
            errors.push(JointErrors {
                joint,
                turn_rad: error.iter().map(|e| e[0]).collect(),
                bend_rad: error.iter().map(|e| axis * e[1]).collect(),
            });
        }
        for (held, link) in [(0, 12), (5, 9), (12, 3)] {
            let told = robot.up_in_link(&sent, 2, held, link, &GRAVITY, &errors).unwrap();
            let asked = robot.up_in_link(&real, 2, held, link, &GRAVITY, &[]).unwrap();
            for row in 0..2 {
                assert_relative_eq!(told[row], asked[row], epsilon = 1e-12);
                let poses = robot.poses(&real[row * width..(row + 1) * width]).unwrap();
                let up = poses.a_from_b(link, held) * -GRAVITY.normalize();
                assert_relative_eq!(asked[row], up, epsilon = 1e-12);
            }
        }
    }
}

#[test]
fn bending_is_in_the_links_frame_after_the_turn() {
    let text = "<robot name=\"r\"><link name=\"a\"/><link name=\"b\"/><joint name=\"j\" type=\"revolute\"><parent link=\"a\"/>\
                <child link=\"b\"/><axis xyz=\"0 0 1\"/><limit lower=\"-2\" upper=\"2\" effort=\"1\" velocity=\"1\"/></joint></robot>";
    let robot = Robot::from_urdf_str(text).unwrap();
    let (turn, bend) = (0.3, Vector3::new(0.2, -0.1, 0.0));
    let errors = [JointErrors { joint: 0, turn_rad: vec![turn], bend_rad: vec![bend] }];
    let told = robot.up_in_link(&[0.4], 1, 0, 1, &GRAVITY, &errors).unwrap();
    let rotation = exp(&(Vector3::z() * (0.4 + turn))) * exp(&bend);
    assert_relative_eq!(told[0], rotation.inverse() * -GRAVITY.normalize(), epsilon = 1e-14);
    assert!(robot.up_in_link(&[0.4], 1, 0, 1, &Vector3::zeros(), &[]).is_err());
    assert!(robot.up_in_link(&[0.4, 0.5], 2, 0, 1, &GRAVITY, &errors).is_err());
    assert!(robot.up_in_link(&[0.4], 1, 0, 2, &GRAVITY, &[]).is_err());
}

#[test]
fn a_mounting_is_taken_out_and_nothing_else() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let mut any = || Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0_f64)).normalize();
    let a: Vec<_> = (0..9).map(|_| any()).collect();
    let mounting = exp(&Vector3::new(0.5, -0.2, 0.1));
    let turned: Vec<_> = a.iter().map(|v| mounting * v).collect();
    assert!(rms_angle(&a, &turned).unwrap() > 0.2 && rms_angle_turned(&a, &turned).unwrap() < 1e-7);
    // What is turned over is a reflection, which no mounting is.
    let over: Vec<_> = a.iter().map(|v| -v).collect();
    assert!(rms_angle_turned(&a, &over).unwrap() > 0.5);
    let (x, y) = (vec![Vector3::x(); 2], vec![Vector3::x(), Vector3::y()]);
    assert_relative_eq!(
        rms_angle(&x, &y).unwrap(),
        core::f64::consts::FRAC_PI_2 / 2.0_f64.sqrt(),
        epsilon = 1e-15
    );
    let mirrored = nearest(&Matrix3::from_diagonal(&Vector3::new(3.0, 2.0, -1.0))).unwrap();
    assert_relative_eq!(mirrored, Matrix3::identity(), epsilon = 1e-14);
}

/// A lift that errs by 0.3 m turns nothing; two errors of one joint add up; numbers that are none are refused.
#[test]
fn a_sliding_joint_turns_nothing_and_errors_of_one_joint_add_up() {
    let urdf = r#"<robot name="lift"><link name="base"/><link name="top"/><link name="arm"/>
      <joint name="up" type="prismatic"><parent link="base"/><child link="top"/><axis xyz="1 0 0"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>
      <joint name="turn" type="continuous"><parent link="top"/><child link="arm"/><axis xyz="0 1 0"/></joint></robot>"#;
    let robot = Robot::from_urdf_str(urdf).unwrap();
    let error = |name: &str, by: f64| JointErrors {
        joint: robot.joint_index(name).unwrap(),
        turn_rad: vec![by],
        bend_rad: vec![Vector3::zeros()],
    };
    let link = robot.link_index("arm").unwrap();
    let up = |errors: &[JointErrors]| robot.up_in_link(&[0.2, 0.1], 1, 0, link, &GRAVITY, errors);
    assert_eq!(up(&[error("up", 0.3)]).unwrap(), up(&[]).unwrap());
    let (twice, once) =
        (up(&[error("turn", 0.1), error("turn", 0.2)]).unwrap(), up(&[error("turn", 0.3)]).unwrap());
    assert_relative_eq!(twice[0], once[0], epsilon = 1e-12);
    assert!(up(&[error("turn", f64::NAN)]).is_err());
}

#[test]
fn vectors_without_a_partner_are_refused_and_none_have_no_angle() {
    let a = [Vector3::x(), Vector3::y()];
    for told in
        [rms_angle(&a, &a[..1]), rms_angle_turned(&a, &a[..1]), rms_angle(&a, &[]), rms_angle(&[], &a)]
    {
        assert!(told.unwrap_err().to_string().contains("one for each of the first"));
    }
    for none in [rms_angle(&[], &[]), rms_angle_turned(&[], &[])] {
        assert!(none.is_ok_and(|angle| angle == 0.0 && angle.is_sign_positive()));
    }
}

/// A robot without joints has one direction whatever the number of postures; a row that is cut short is an error.
#[test]
fn postures_are_counted_by_the_caller() {
    let urdf = r#"<robot name="stone"><link name="base"/><link name="top"/>
      <joint name="glue" type="fixed"><parent link="base"/><child link="top"/><origin rpy="0.4 0 0"/></joint></robot>"#;
    let stone = Robot::from_urdf_str(urdf).unwrap();
    let up = stone.up_in_link(&[], 3, 0, 1, &GRAVITY, &[]).unwrap();
    let expected = exp(&(Vector3::x() * 0.4)).inverse() * -GRAVITY.normalize();
    assert_eq!(up.len(), 3);
    up.iter().for_each(|u| assert_relative_eq!(*u, expected, epsilon = 1e-14));
    assert!(stone.up_in_link(&[], 0, 0, 1, &GRAVITY, &[]).unwrap().is_empty());
    let arm = Robot::from_urdf_str(&random_urdf(1, 4)).unwrap();
    let cut = vec![0.0; 2 * arm.position_count() - 1];
    let told = arm.up_in_link(&cut, 2, 0, 1, &GRAVITY, &[]).unwrap_err().to_string();
    assert!(told.contains(&format!("got {}, needed {}", cut.len(), cut.len() + 1)), "{told}");
}
