//! An arm on a column of two tubes that slide out of a third, its marker measured in an unknown frame.

use crate::diagnose::data::recording::{
    Frame, MarkerSpec, MeasuredPoint, PointsFrame, Recording, Tolerances,
};
use crate::diagnose::model::problem::Problem;
use crate::robot::Robot;
use nalgebra::{Point3, Vector3};

/// The tubes' frames are turned against each other, so that nothing is right by accident.
const URDF: &str = r#"<robot name="lift">
<link name="base"/>
<link name="middle"><inertial><mass value="10"/><origin xyz="0.02 0 0"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="top"><inertial><mass value="8"/><origin xyz="0 0.03 0"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="arm"><inertial><mass value="12"/><origin xyz="0.4 0 0"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tool_marker"/>
<joint name="lift_1" type="prismatic"><parent link="base"/><child link="middle"/><origin xyz="0.1 0 0.2"/><axis xyz="0 0 1"/>
  <limit lower="0" upper="0.8" effort="1" velocity="1"/></joint>
<joint name="lift_2" type="prismatic"><parent link="middle"/><child link="top"/><origin xyz="0 0 0.1" rpy="1.5707963267948966 0 0"/><axis xyz="0 1 0"/>
  <limit lower="0" upper="0.7" effort="1" velocity="1"/></joint>
<joint name="turn" type="revolute"><parent link="top"/><child link="arm"/><origin xyz="0 1 0" rpy="-1.5707963267948966 0 0"/><axis xyz="0 0 1"/>
  <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="tool" type="fixed"><parent link="arm"/><child link="tool_marker"/><origin xyz="0.9 0 0.1"/></joint>
</robot>"#;

/// Some postures; what is measured is near where the marker is, and of no meaning.
pub(in crate::diagnose) fn problem() -> Problem {
    problem_of(URDF, 3)
}

/// Of a robot with so many joints, the column's first and the arm's last.
fn problem_of(urdf: &str, joints: usize) -> Problem {
    let robot = Robot::from_urdf_str(urdf).unwrap();
    let frame = |i: usize| {
        let t = i as f64;
        Frame {
            number: i as i64,
            posture: i as i64,
            time_s: t,
            commanded: [0.1 + 0.15 * (t % 4.0), 0.05 * (t % 5.0), -2.0 + 0.4 * t]
                .into_iter()
                .enumerate()
                .filter_map(|(j, q)| (joints == 3 || j != 1).then_some(q))
                .collect(),
            sightings: Vec::new(),
            points: vec![MeasuredPoint { marker: 0, position_m: Point3::new(0.3 + 0.01 * t, 0.2, 1.5) }],
        }
    };
    let recording = Recording {
        root_link: "base".into(),
        gravity: Vector3::new(0.3, -0.2, -9.8),
        sight: None,
        markers: vec![MarkerSpec {
            name: "tool".into(),
            link: "tool_marker".into(),
            diameter_m: 0.0,
            mount_known: true,
        }],
        tolerances: Tolerances::default(),
        points_frame: Some(PointsFrame::Unknown),
        columns: Vec::new(),
        ordered: true,
        timed: true,
        pixel_std_px: None,
        point_std_m: Some(0.001),
        frames: (0..10).map(frame).collect(),
    };
    Problem::new(&robot, &recording.validated(joints).unwrap()).unwrap()
}

#[test]
fn a_column_bends_in_the_middle_of_what_is_out() {
    let problem = problem();
    let nodes = &problem.scene.body.nodes;
    let top = nodes.iter().find(|n| n.joint == "lift_2").unwrap();
    // In the top tube's frame, whose y points up: the column's foot is the first joint's origin, its tip the arm's joint.
    let (first, second) = (0.3, 0.2);
    let foot = -(0.1 + first + second);
    let expected = Vector3::new(0.0, 0.5 * (foot + 1.0), 0.0);
    assert!((top.pivot(&[first, second, 0.0]) - expected).norm() < 1e-12);
    let telescope = top.telescope.as_ref().unwrap();
    assert_eq!(telescope.joints, [0, 1]);
    assert!((telescope.farthest_m - 1.5).abs() < 1e-12);
    assert!(nodes[2].telescope.is_none());
}

#[test]
fn moments_are_about_the_middle_of_what_bends() {
    let problem = problem();
    let scene = &problem.scene;
    let (frame, g) = (3, scene.gravity);
    let q: Vec<f64> = (0..3).map(|n| scene.q(frame, n)).collect();
    // By hand, in the base's frame: the top tube hangs at the first joint's x, its y axis up, its x as the base's, its z as minus y.
    let origin = Vector3::new(0.1, 0.0, 0.2 + 0.1 + q[0] + q[1]);
    let tube = origin + Vector3::new(0.0, 0.0, 0.03);
    let arm = origin + Vector3::new(0.4 * q[2].cos(), 0.4 * q[2].sin(), 1.0);
    let foot = Vector3::new(0.1, 0.0, 0.2);
    let middle = (foot + origin + Vector3::new(0.0, 0.0, 1.0)) / 2.0;
    let moment = ((tube - middle) * 8.0 + (arm - middle) * 12.0).cross(&g);
    let told = scene.moment(frame, 1);
    let expected = Vector3::new(moment.x, moment.z, -moment.y);
    assert!((told - expected).norm() < 1e-9, "{told} {expected}");
}

/// On which side a play rests depends on where the moment is taken: of an arm without a column too, and before any cause is found.
#[test]
fn moments_of_an_arm_are_about_the_middle_of_its_links() {
    let arm = URDF.replace("name=\"lift_2\" type=\"prismatic\"", "name=\"lift_2\" type=\"fixed\"");
    let problem = problem_of(&arm, 2);
    let (scene, frame) = (&problem.scene, 4);
    let lift = scene.body.nodes.iter().position(|n| n.joint == "lift_1").unwrap();
    let turn = scene.body.nodes.iter().position(|n| n.joint == "turn").unwrap();
    let q = [lift, turn].map(|n| scene.q(frame, n));
    // By hand, in the tubes' frame, which is turned as the base: masses, and the middle between the two joints.
    let masses = [
        (10.0, Vector3::new(0.02, 0.0, 0.0)),
        (8.0, Vector3::new(0.0, 0.0, 0.1 + 0.03)),
        (12.0, Vector3::new(0.4 * q[1].cos(), 0.4 * q[1].sin(), 1.1)),
    ];
    let middle = Vector3::new(0.0, 0.0, 0.55);
    let moment: Vector3<f64> = masses.iter().map(|(m, at)| ((at - middle) * *m).cross(&scene.gravity)).sum();
    let told = scene.moment(frame, lift);
    assert!((told - moment).norm() < 1e-9, "{told} {moment}");
}
