//! A correction loop: an arm whose joints stand off their commands, corrected by what is measured of its hand.
//!
//! `cargo run -p mirror-core --example correction_loop`

use mirror_core::correct::{CorrectOptions, Corrector, Decision, Reading, Stop, Target};
use mirror_core::robot::Robot;
use nalgebra::{Matrix3, Point3};
use std::sync::Arc;

const URDF: &str = r#"<robot name="arm">
  <link name="base"/><link name="camera"/><link name="board"/><link name="a"/><link name="b"/><link name="c"/><link name="hand"/>
  <joint name="camera_mount" type="fixed"><parent link="base"/><child link="camera"/><origin xyz="0 0 0.1"/></joint>
  <joint name="board_mount" type="fixed"><parent link="base"/><child link="board"/></joint>
  <joint name="pitch" type="revolute"><parent link="base"/><child link="a"/><origin xyz="0 -0.05 0.06"/><axis xyz="0 1 0"/><limit lower="-2.6" upper="1" effort="1" velocity="1"/></joint>
  <joint name="roll" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 -0.02 0"/><axis xyz="-1 0 0"/><limit lower="-0.2" upper="2.6" effort="1" velocity="1"/></joint>
  <joint name="elbow" type="revolute"><parent link="b"/><child link="c"/><origin xyz="0 0 -0.044"/><axis xyz="0 -1 0"/><limit lower="-0.35" upper="2.1" effort="1" velocity="1"/></joint>
  <joint name="hand_mount" type="fixed"><parent link="c"/><child link="hand"/><origin xyz="0 0 -0.0635"/></joint>
</robot>"#;

/// Where the joints of the made-up robot really stand, less their commands, rad. The corrector is not told.
const HIDDEN_RAD: [f64; 3] = [0.04, -0.05, 0.03];
const NOISE_M: f64 = 2e-4;

/// Runs the loop to its stop; what it says of its own accuracy must hold.
pub fn main() -> Result<(), Box<dyn std::error::Error>> {
    let robot = Arc::new(Robot::from_urdf_str(URDF)?);
    let link = |name: &str| robot.link_index(name);
    let (board, hand) = (link("board")?, link("hand")?);
    let markers = [("hand".to_owned(), hand)];
    let target = Target::new(robot.clone(), link("camera")?, board, &markers, &[-0.5, 0.9, 0.9], &[])?;
    let wanted = target.point_in_frame_m()[0];
    let mut corrector = Corrector::new(target, CorrectOptions::default(), None)?;

    // Stands for moving the robot and measuring its hand in the mirror.
    let measure = |command: &[f64]| -> Result<_, mirror_core::Error> {
        let stands: Vec<f64> = command.iter().zip(HIDDEN_RAD).map(|(q, error)| q + error).collect();
        Ok(robot.poses(&stands)?.point_in_a(board, hand, &Point3::origin()).coords)
    };
    let stop = loop {
        let reading = Reading {
            point_in_frame_m: measure(corrector.command())?,
            covariance_m2: Matrix3::identity() * NOISE_M * NOISE_M,
            chi_squared: 0.5,
            degrees_of_freedom: 1,
        };
        let off_mm = 1e3 * (reading.point_in_frame_m - wanted).norm();
        println!("look {}: hand off by {off_mm:.2} mm", corrector.records().len() + 1);
        if let Decision::Stop { stop } = corrector.observe(&[Some(reading)])? {
            break stop;
        }
    };
    let Stop::Converged(converged) = stop else { return Err(format!("not converged: {stop:?}").into()) };
    let off_m = (measure(corrector.command())? - wanted).norm();
    println!("converged: within {:.2} mm, really {:.2} mm", 1e3 * converged.below_m[0], 1e3 * off_m);
    assert!(off_m < converged.below_m[0]);
    Ok(())
}
