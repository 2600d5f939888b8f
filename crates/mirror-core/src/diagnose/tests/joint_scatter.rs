//! Which joint alone scatters, to first order.

use super::gap_world::{Plan, World};
use crate::diagnose::likelihood::joint_scatter::{JointScatter, scattering_joints};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::robot::Robot;

const NOISE: Noise = Noise { corner_px: 0.15, marker_px: 0.15, point_m: 1.0 };

#[test]
fn the_joint_that_alone_rests_elsewhere_is_the_likeliest() {
    let world = World::new(4, false);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    for name in ["l_elbow", "r_shoulder_roll"] {
        let plan = Plan { postures: 24, noise_px: 0.15, seed: 5, ..Plan::default() };
        let mut recording = world.record(&plan);
        let column = robot.position_index(name).unwrap();
        for frame in &mut recording.frames {
            // Any numbers without a law: of each posture one.
            frame.commanded[column] += 0.02 * (12.9898 * frame.posture as f64).sin();
        }
        let problem = Problem::new(&robot, &recording).unwrap();
        let joints = scattering_joints(&problem);
        let order =
            JointScatter::likeliest_alone(&problem, &problem.nominal(), &joints, NOISE, None).unwrap();
        assert_eq!(order.len(), joints.len());
        assert_eq!(problem.scene.body.nodes[order[0]].joint, name);
    }
}
