//! Feed-forward: the law of the joints, put in from the other side, gives back the posture that was wanted.

use mirror_core::correct::{FeedForward, JointError};
use mirror_core::robot::{JointTerm, Robot};
use nalgebra::Vector3;
use proptest::prelude::*;
use std::sync::Arc;

/// An arm of two links in a vertical plane: 1 kg at 0.2 m from the elbow, 2 kg at 0.1 m from the shoulder, upper arm 0.3 m.
const ARM: &str = r#"<robot name="arm">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.1 0 0"/><mass value="2"/></inertial></link>
  <link name="fore"><inertial><origin xyz="0.2 0 0"/><mass value="1"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="9" velocity="9"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="9" velocity="9"/></joint>
</robot>"#;
const G: f64 = 9.81;

fn ahead(errors: &[JointError]) -> mirror_core::Result<FeedForward> {
    let robot = Arc::new(Robot::from_urdf_str(ARM).unwrap());
    FeedForward::new(robot, 0, Vector3::new(0.0, 0.0, -G), errors)
}

fn term(position: usize, term: JointTerm, value: f64) -> JointError {
    JointError { position, term, value, driver: (term == JointTerm::Coupling).then(|| 1 - position) }
}

/// By hand: turning up about +y lowers a mass that lies along +x, so gravity pushes towards larger angles.
fn torques(q: [f64; 2]) -> [f64; 2] {
    let elbow = G * 0.2 * (q[0] + q[1]).cos();
    [G * (2.0 * 0.1 + 0.3) * q[0].cos() + elbow, elbow]
}

proptest! {
    #[test]
    fn the_wanted_posture_comes_out(
        shoulder in -1.2..1.2f64, elbow in -1.2..1.2f64,
        offset in -0.1..0.1f64, share in -0.2..0.2f64, sine in -0.1..0.1f64, cosine in -0.1..0.1f64,
        compliance in 0.0..0.02f64, coupling in -0.2..0.2f64,
    ) {
        let errors = [
            term(0, JointTerm::Offset, offset), term(0, JointTerm::Share, share), term(1, JointTerm::Sine, sine),
            term(1, JointTerm::CosineLessOne, cosine), term(0, JointTerm::Compliance, compliance), term(1, JointTerm::Coupling, coupling),
        ];
        let (mut way_point, mut q) = ([0.0; 2], [0.0; 2]);
        ahead(&errors).unwrap().commands(&[shoulder, elbow], &mut way_point, &mut q).unwrap();
        let reached = [
            q[0] * (1.0 + share) + offset + compliance * torques([shoulder, elbow])[0],
            q[1] + sine * q[1].sin() + cosine * (q[1].cos() - 1.0) + coupling * q[0],
        ];
        prop_assert!((reached[0] - shoulder).abs() < 1e-9 && (reached[1] - elbow).abs() < 1e-9, "{reached:?}");
        prop_assert_eq!(way_point, q);
    }

    /// A servo stops as soon as its error is within the dead band: half of its width away, on the side of its load.
    #[test]
    fn a_dead_band_leaves_the_joint_half_its_width_away(q in -1.2..1.2f64, half in 0.001..0.1f64) {
        let (mut way_point, mut command) = ([0.0; 2], [0.0; 2]);
        let ahead = ahead(&[term(1, JointTerm::DeadBand, half)]).unwrap();
        ahead.commands(&[0.0, q], &mut way_point, &mut command).unwrap();
        prop_assert!((command[1] + torques([0.0, q])[1].signum() * half - q).abs() < 1e-12);
    }

    #[test]
    fn a_play_is_approached_from_the_side_of_its_load(q in -1.2..1.2f64, width in 0.001..0.1f64) {
        let (mut way_point, mut command) = ([0.0; 2], [0.0; 2]);
        let ahead = ahead(&[term(1, JointTerm::Play, width)]).unwrap();
        ahead.commands(&[0.0, q], &mut way_point, &mut command).unwrap();
        let side = torques([0.0, q])[1].signum();
        prop_assert!((command[1] + side * width / 2.0 - q).abs() < 1e-12);
        prop_assert!((way_point[1] - command[1]) * side >= 2.0 * width - 1e-12);
        prop_assert_eq!(way_point[0], command[0]);
    }
}

#[test]
fn what_no_command_mends_is_refused() {
    for (error, words) in [
        (term(0, JointTerm::Rate, 1e-4), "grows with time"),
        (term(0, JointTerm::Share, 0.5), "no small error"),
        (term(2, JointTerm::Offset, 0.1), "below 2"),
        (term(0, JointTerm::Offset, f64::NAN), "finite"),
        (term(0, JointTerm::Play, -0.2), "0 or above"),
        (term(1, JointTerm::DeadBand, -0.01), "0 or above"),
        (JointError { driver: None, ..term(0, JointTerm::Coupling, 0.1) }, "driver"),
    ] {
        let message = ahead(&[error]).unwrap_err().to_string();
        assert!(message.contains(words), "{message}");
    }
    // Each is small; together they turn a joint as far as its limit.
    let message = ahead(&[term(0, JointTerm::Share, 0.49); 3]).unwrap_err().to_string();
    assert!(message.contains("together") && message.contains("1.47"), "{message}");
    let limited = ahead(&[term(0, JointTerm::Offset, -0.5)]).unwrap();
    let (mut way_point, mut command) = ([0.0; 2], [0.0; 2]);
    limited.commands(&[2.9, 0.0], &mut way_point, &mut command).unwrap();
    assert_eq!(command[0], 3.0, "within the limit");
}

/// Errors that are together nearly as large as the motion: the command is still the one that the law takes to the goal.
#[test]
fn large_errors_of_one_joint_are_solved_too() {
    for (share, sine, cosine) in
        [(0.49, 0.45, 0.0), (0.35, 0.35, 0.29), (-0.49, -0.49, 0.0), (-0.49, 0.0, 0.49), (0.2, -0.3, -0.4)]
    {
        let errors = [
            term(1, JointTerm::Share, share),
            term(1, JointTerm::Sine, sine),
            term(1, JointTerm::CosineLessOne, cosine),
        ];
        let ahead = ahead(&errors).unwrap();
        for goal in [-0.6, -0.02, 0.0, 0.4, 0.6] {
            let (mut way_point, mut q) = ([0.0; 2], [0.0; 2]);
            ahead.commands(&[0.1, goal], &mut way_point, &mut q).unwrap();
            let reached = q[1] * (1.0 + share) + sine * q[1].sin() + cosine * (q[1].cos() - 1.0);
            let within = q[1].abs() < 3.0;
            assert!(!within || (reached - goal).abs() < 1e-10, "{share} {sine} {cosine}: {q:?} for {goal}");
            assert!(within || (reached - goal) * q[1] <= 0.0, "the nearer end: {q:?} for {goal}");
        }
    }
}

/// Two joints that drive each other by nearly all that their own errors leave: the error names one, and what to do.
#[test]
fn couplings_that_do_not_settle_are_told_with_their_joint() {
    let errors = [0, 1].map(|joint| {
        [
            term(joint, JointTerm::Share, -0.3),
            term(joint, JointTerm::Sine, -0.2099),
            term(joint, JointTerm::Coupling, 0.49),
            term(joint, JointTerm::Offset, 0.01),
        ]
    });
    let (mut way_point, mut q) = ([0.0; 2], [0.0; 2]);
    let told = ahead(&errors.concat()).unwrap().commands(&[0.001, 0.001], &mut way_point, &mut q);
    let message = told.unwrap_err().to_string();
    for words in ["shoulder", "0.9999", "couplings", "correct the model"] {
        assert!(message.contains(words), "{message}");
    }
}

/// A finger that follows the shoulder at twice its angle meets its own limit first.
#[test]
fn commands_keep_followers_within_their_limits() {
    let finger = r#"<link name="finger"/><joint name="finger" type="revolute"><parent link="fore"/><child link="finger"/><axis xyz="0 1 0"/>
      <mimic joint="shoulder" multiplier="-2" offset="0.2"/><limit lower="-1" upper="1.4" effort="1" velocity="1"/></joint></robot>"#;
    let robot = Arc::new(Robot::from_urdf_str(&ARM.replace("</robot>", finger)).unwrap());
    let errors = [term(0, JointTerm::Offset, -0.2), term(0, JointTerm::Play, 0.02)];
    let ahead = FeedForward::new(robot, 0, Vector3::new(0.0, 0.0, -G), &errors).unwrap();
    // -2 q + 0.2 within -1 and 1.4: q between -0.6 and 0.6.
    for (goal, command, way_point) in [(0.55, 0.6, 0.6), (-0.9, -0.6, -0.56), (0.2, 0.39, 0.43)] {
        let (mut over, mut q) = ([0.0; 2], [0.0; 2]);
        ahead.commands(&[goal, 0.0], &mut over, &mut q).unwrap();
        assert!(
            (q[0] - command).abs() < 1e-12 && (over[0] - way_point).abs() < 1e-12,
            "{goal}: {q:?} {over:?}"
        );
    }
}

#[test]
fn a_robot_without_joints_has_no_commands() {
    let robot = Arc::new(Robot::from_urdf_str(r#"<robot name="stone"><link name="base"/></robot>"#).unwrap());
    let ahead = FeedForward::new(robot, 0, Vector3::new(0.0, 0.0, -G), &[]).unwrap();
    ahead.commands(&[], &mut [], &mut []).unwrap();
}
