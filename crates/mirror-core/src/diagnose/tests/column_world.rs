//! An arm on a column of two tubes that slide out of a third, its marker measured in an unknown frame.

use crate::diagnose::data::recording::{
    Frame, MarkerSpec, MeasuredPoint, PointsFrame, Recording, Tolerances,
};
use crate::diagnose::effects::{Place, vocabulary};
use crate::diagnose::model::elementary::{Column, Weight};
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
    problem_with(urdf, joints, |_| {})
}

/// The same with a recording that is changed.
fn problem_with(urdf: &str, joints: usize, change: impl Fn(&mut Recording)) -> Problem {
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
    let mut recording = Recording {
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
    change(&mut recording);
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

/// The weights of one of the vocabulary's effects at a link, a list each column.
fn weights(problem: &Problem, effect: &str, link: &str) -> Vec<Vec<f64>> {
    let scene = &problem.scene;
    let node = scene.body.nodes.iter().position(|n| n.link == link).unwrap();
    let all = vocabulary();
    let law = all.iter().find(|e| e.name() == effect).unwrap();
    let columns = law.columns(scene, Place::Link(Some(node)), 0.0, &[0.0; 4]);
    let list = |c: &Column| match &c.weight {
        Weight::Frames(list) => list.clone(),
        _ => Vec::new(),
    };
    columns.iter().map(list).collect()
}

#[test]
fn a_column_slides_out_to_the_side_that_its_limits_allow() {
    let sides = [
        (
            "<axis xyz=\"0 0 1\"/>\n  <limit lower=\"0\" upper=\"0.8\"",
            "<axis xyz=\"0 0 -1\"/>\n  <limit lower=\"-0.8\" upper=\"0\"",
        ),
        (
            "<axis xyz=\"0 1 0\"/>\n  <limit lower=\"0\" upper=\"0.7\"",
            "<axis xyz=\"0 -1 0\"/>\n  <limit lower=\"-0.7\" upper=\"0\"",
        ),
    ];
    let down = sides.iter().fold(URDF.to_owned(), |text, (up, down)| {
        assert!(text.contains(up));
        text.replace(up, down)
    });
    // In some rows nothing is out.
    let moved = |recording: &mut Recording, side: f64| {
        for (f, frame) in recording.frames.iter_mut().enumerate() {
            frame.commanded.iter_mut().take(2).for_each(|q| *q *= if f < 2 { 0.0 } else { side });
        }
    };
    let up = problem_with(URDF, 3, |recording| moved(recording, 1.0));
    let down = problem_with(&down, 3, |recording| moved(recording, -1.0));
    let (of_up, of_down) = (weights(&up, "column_bending", "top"), weights(&down, "column_bending", "top"));
    assert!(of_up.len() == 4 && of_up.iter().flatten().any(|w| *w != 0.0));
    // Directions across the axis turn round with it: by size, as the law has both of them.
    for (k, f) in (0..2).flat_map(|k| (0..10).map(move |f| (k, f))) {
        let size = |of: &[Vec<f64>]| of[2 * k][f].hypot(of[2 * k + 1][f]);
        assert!((size(&of_up) - size(&of_down)).abs() < 1e-9, "{k} {f}: {} {}", size(&of_up), size(&of_down));
    }
}

#[test]
fn an_axis_that_is_vertical_but_for_rounding_bears_no_load() {
    let upright = |recording: &mut Recording| recording.gravity = Vector3::new(0.0, 0.0, -9.8);
    let torque = |turn: &str| {
        let problem = problem_with(&URDF.replace("-1.5707963267948966", turn), 3, upright);
        problem.scene.largest_torque(2)
    };
    // Of 12 kg at 0.4 m: askew by 0.2 mrad it would be 0.01 N m.
    assert_eq!(torque("-1.571"), 0.0);
    assert!((torque("-1.6") - 12.0 * 9.8 * 0.4 * (1.6 - core::f64::consts::FRAC_PI_2)).abs() < 0.05);
    // A slide bears its weight, or none where it lies.
    let problem = problem_with(URDF, 3, upright);
    assert!((problem.scene.largest_torque(0) - 30.0 * 9.8).abs() < 1e-9);
    let lying = |recording: &mut Recording| recording.gravity = Vector3::new(-9.8, 0.0, 0.005);
    assert_eq!(problem_with(URDF, 3, lying).scene.largest_torque(0), 0.0);
}

#[test]
fn slides_with_the_marker_at_their_origin_reach_as_far_as_they_go() {
    let table = r#"<robot name="table"><link name="base"/><link name="x"/><link name="y"/>
<joint name="jx" type="prismatic"><parent link="base"/><child link="x"/><axis xyz="1 0 0"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>
<joint name="jy" type="prismatic"><parent link="x"/><child link="y"/><axis xyz="0 1 0"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint></robot>"#;
    let problem = problem_with(table, 2, |recording| {
        recording.markers[0].link = "y".into();
        recording.frames.iter_mut().enumerate().for_each(|(f, frame)| {
            frame.commanded = vec![0.05 * f as f64, 0.02 * f as f64];
        });
    });
    assert!((problem.scene.reach_m - 0.45).abs() < 1e-12, "{}", problem.scene.reach_m);
}

/// What play or a dead band of a width moves the arm's joint by, frame by frame, rad, and the derivative by the width.
fn moved_by(problem: &Problem, effect: &str, variant: f64, parameters: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let (scene, turn) = (&problem.scene, 2);
    let all = vocabulary();
    let law = all.iter().find(|e| e.name() == effect).unwrap();
    let mut deformation = problem.nominal();
    law.deform(scene, Place::Joint(turn), variant, parameters, &mut deformation);
    let columns = law.columns(scene, Place::Joint(turn), variant, parameters);
    let Weight::Frames(slope) = &columns[0].weight else { return Default::default() };
    ((0..scene.frames).map(|f| deformation.joint_delta(f, turn)).collect(), slope.clone())
}

#[test]
fn a_play_and_a_dead_band_are_as_wide_as_they_are_however_small() {
    // Up and down, so that each side comes.
    let to_and_fro = |recording: &mut Recording| {
        recording.frames.iter_mut().enumerate().for_each(|(f, frame)| {
            frame.commanded[2] = 0.3 * (f as f64 * 1.7).sin();
        });
    };
    let problem = problem_with(URDF, 3, to_and_fro);
    // The number of parameters behind the width, and by which share of it the joint is off.
    let laws = [("backlash", f64::INFINITY, 0, 0.5), ("stiction", 1.0, 1, 1.0)];
    for (effect, variant, others, share) in laws {
        let of = |width: f64| [vec![width], vec![0.0; others]].concat();
        for width in [2e-6, 3e-5, 2e-4] {
            let (by, slope) = moved_by(&problem, effect, variant, &of(width));
            assert!(slope.iter().any(|s| *s > 0.0) && slope.iter().any(|s| *s < 0.0), "{effect}");
            for (by, slope) in by.iter().zip(&slope).skip(1) {
                assert!((by.abs() - share * width).abs() < 1e-12 && (by - slope * width).abs() < 1e-12);
            }
        }
        let (nothing, slope) = moved_by(&problem, effect, variant, &of(0.0));
        assert!(nothing.iter().all(|by| *by == 0.0) && slope.iter().any(|s| *s != 0.0), "{effect}");
    }
}

#[test]
fn a_position_that_is_held_stays_on_its_side_though_it_is_written_with_rounding() {
    let held = |jitter: f64| {
        problem_with(URDF, 3, |recording| {
            recording.frames.iter_mut().enumerate().for_each(|(f, frame)| {
                let by = if f % 2 == 0 { jitter } else { -jitter };
                frame.commanded[2] = 0.3 * ((f / 2) as f64 * 1.7).sin() + 0.1 + by;
            });
        })
    };
    let (exact, rounded) = (held(0.0), held(2e-10));
    // Without a load that decides, and from afar.
    for (effect, variant, parameters) in
        [("backlash", f64::NEG_INFINITY, vec![0.04]), ("stiction", 1.0, vec![0.02, 0.0])]
    {
        let sides = |problem: &Problem| moved_by(problem, effect, variant, &parameters).1;
        assert_eq!(sides(&exact), sides(&rounded), "{effect}");
    }
}
