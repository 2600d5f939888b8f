//! Which joint alone scatters, and whether all do, to first order.

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

/// To first order a scatter of all joints gains what its fit gains, and nothing where there is none.
#[test]
fn the_gain_of_a_scatter_is_that_of_its_fit() {
    let world = World::new(4, false);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    for scatter_rad in [0.0, 0.002] {
        let plan = Plan { postures: 24, noise_px: 0.15, seed: 7, ..Plan::default() };
        let mut recording = world.record(&plan);
        for frame in &mut recording.frames {
            for (k, position) in frame.commanded.iter_mut().enumerate() {
                let any = (12.9898 * frame.posture as f64 + 78.233 * k as f64).sin() * 43758.5453;
                *position += scatter_rad * (any - any.floor() - 0.5) * 12.0_f64.sqrt();
            }
        }
        let problem = Problem::new(&robot, &recording).unwrap();
        let (joints, model) = (scattering_joints(&problem), problem.nominal());
        let (gain, _) = JointScatter::gain(&problem, &model, &joints, NOISE, None).unwrap();
        let none = JointScatter::none(&problem, &model, &joints, NOISE, None).unwrap();
        let fitted = JointScatter::fitted(&problem, &model, &joints, none.noise, None).unwrap();
        let of_fit = 0.5 * (none.cost - fitted.cost);
        if scatter_rad > 0.0 {
            assert!(gain > 10.0 && of_fit > 10.0 && gain > of_fit / 3.0, "{gain} {of_fit}");
        } else {
            assert!(gain < 3.0 && of_fit < 3.0, "{gain} {of_fit}");
        }
    }
}
