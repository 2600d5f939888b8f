//! A diagnosis: which joint of an arm stands off its command, from measured positions of three markers.
//!
//! `cargo run -p mirror-core --example diagnosis`

use mirror_core::diagnose::{
    DiagnoseOptions, Frame, MarkerSpec, MeasuredPoint, PointsFrame, Recording, Tolerances, diagnose,
};
use mirror_core::robot::Robot;
use nalgebra::{Point3, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

const URDF: &str = r#"<robot name="arm">
  <link name="base"/>
  <link name="a"><inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="b"><inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="c"><inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="upper"/><link name="lower"/><link name="hand"/>
  <joint name="pitch" type="revolute"><parent link="base"/><child link="a"/><origin xyz="0 -0.05 0.06"/><axis xyz="0 1 0"/><limit lower="-2" upper="1" effort="1" velocity="1"/></joint>
  <joint name="roll" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 -0.02 0"/><axis xyz="-1 0 0"/><limit lower="-0.2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="elbow" type="revolute"><parent link="b"/><child link="c"/><origin xyz="0 0 -0.12"/><axis xyz="0 -1 0"/><limit lower="-0.3" upper="2" effort="1" velocity="1"/></joint>
  <joint name="upper_mount" type="fixed"><parent link="b"/><child link="upper"/><origin xyz="0.02 0 -0.05"/></joint>
  <joint name="lower_mount" type="fixed"><parent link="c"/><child link="lower"/><origin xyz="0.02 0.01 -0.05"/></joint>
  <joint name="hand_mount" type="fixed"><parent link="c"/><child link="hand"/><origin xyz="-0.01 -0.02 -0.11"/></joint>
</robot>"#;
const MARKERS: [&str; 3] = ["upper", "lower", "hand"];
const ELBOW_OFF_RAD: f64 = 0.03;
const NOISE_M: f64 = 2e-4;

/// Simulates a session with a wrong zero of the elbow and asks what is wrong.
pub fn main() -> Result<(), Box<dyn std::error::Error>> {
    let robot = Robot::from_urdf_str(URDF)?;
    let elbow = robot.position_index("elbow")?;
    let links = MARKERS.iter().map(|name| robot.link_index(name)).collect::<Result<Vec<_>, _>>()?;
    let (mut rng, noise) = (ChaCha8Rng::seed_from_u64(1), Normal::new(0.0, NOISE_M)?);
    let mut frames = Vec::new();
    for number in 0..60 {
        let range = [(-1.5, 0.5), (0.0, 1.6), (0.0, 1.6)];
        let commanded: Vec<f64> = range.iter().map(|(low, high)| rng.random_range(*low..*high)).collect();
        let mut stands = commanded.clone();
        stands[elbow] += ELBOW_OFF_RAD;
        let poses = robot.poses(&stands)?;
        let mut points = Vec::new();
        for (marker, &link) in links.iter().enumerate() {
            let scatter = Vector3::from_fn(|_, _| noise.sample(&mut rng));
            points.push(MeasuredPoint {
                marker,
                position_m: poses.point_in_a(0, link, &Point3::origin()) + scatter,
            });
        }
        let time_s = f64::from(number);
        frames.push(Frame {
            number: i64::from(number),
            posture: i64::from(number),
            time_s,
            commanded,
            sightings: Vec::new(),
            points,
        });
    }
    let recording = Recording {
        root_link: "base".into(),
        gravity: Vector3::new(0.0, 0.0, -9.81),
        sight: None,
        markers: MARKERS
            .iter()
            .map(|name| MarkerSpec {
                name: (*name).into(),
                link: (*name).into(),
                diameter_m: 0.0,
                mount_known: true,
            })
            .collect(),
        tolerances: Tolerances::default(),
        points_frame: Some(PointsFrame::Link("base".into())),
        columns: Vec::new(),
        ordered: true,
        timed: false,
        pixel_std_px: None,
        point_std_m: Some(NOISE_M),
        frames,
    }
    .validated(robot.position_count())?;

    let diagnosis = diagnose(&robot, &recording, &DiagnoseOptions::default(), &[])?;
    println!("{}: {}", diagnosis.verdict, diagnosis.sentence);
    for cause in &diagnosis.causes {
        println!("{} at {}, probability {:.2}", cause.effect, cause.at, cause.probability);
        for (name, estimate) in &cause.parameters {
            println!("    {name} = {:.5} ± {:.5}", estimate.value, estimate.std);
        }
    }
    let [cause] = &diagnosis.causes[..] else { return Err("not one cause".into()) };
    assert_eq!((cause.effect.as_str(), cause.at.as_str()), ("joint_offset", "joint:elbow"));
    Ok(())
}
