//! Any text is a robot that moves, or an error that says why not.

#![no_main]

use libfuzzer_sys::fuzz_target;
use mirror_core::robot::Robot;
use nalgebra::Vector3;

fuzz_target!(|text: &str| {
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
});
