//! Recordings of a small humanoid before a mirror, made without any formula of the diagnosis.
//!
//! The chain is multiplied out of `Isometry3`s with the errors put in where they sit, gravity's torques are sums over
//! point masses, play is followed in small steps of time, light bounces by the laws of reflection and refraction
//! (a pane by the angle of incidence, a hollow mirror by the shortest path), and a pinhole makes the picture.

mod body;
mod light;
pub mod lingering;
mod record;
pub mod resting;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::fmt::Write;

/// Of several draws of one kind of session as many as are usual; all where `MIRROR_TEST_ALL` is set.
pub fn draws<T, const N: usize>(usual: usize, all: [T; N]) -> impl Iterator<Item = T> {
    let count = if std::env::var_os("MIRROR_TEST_ALL").is_some() { N } else { usual };
    all.into_iter().take(count)
}

pub const FOCAL_PX: f64 = 693.0;
pub const CENTER_PX: [f64; 2] = [399.5, 299.5];
const GRAVITY: Vector3<f64> = Vector3::new(0.0, 0.0, -9.81);
const CORNERS: (usize, usize) = (7, 5);
const SQUARE_M: f64 = 0.014;
const GLASS_INDEX: f64 = 1.52;
const CAMERA_AT: [f64; 3] = [0.08, 0.0, 0.35];
const CAMERA_DOWN_RAD: f64 = 0.35;
const BOARD_AT: [f64; 3] = [0.1, 0.0, 0.22];
/// Steps of time between two rows in which play is followed.
const PLAY_STEPS: usize = 40;

#[derive(Clone)]
pub struct Bone {
    pub name: String,
    pub parent: Option<usize>,
    pub at: Vector3<f64>,
    pub axis: Vector3<f64>,
    pub mass: f64,
    pub com: Vector3<f64>,
}

/// One error of the real robot, in the words and by the conventions of the public vocabulary; bones are places.
#[derive(Clone, Debug)]
pub enum Wrong {
    Offset(usize, f64),
    Ratio(usize, f64),
    Eccentric(usize, f64, f64),
    /// Play and the friction torque, N m.
    Backlash(usize, f64, f64),
    Stiction(usize, f64),
    Compliance(usize, f64),
    /// A spring that stiffens: compliance when unloaded, share s and reference r, rad: `δ (1 + s (δ/r)²) = c τ`.
    Stiffening(usize, f64, f64, f64),
    Bending(usize, f64),
    /// The same of a beam: compliance and own mass are spread all along it.
    Beam(usize, f64),
    Length(Option<usize>, [f64; 3]),
    Tilt(usize, f64, f64),
    /// The first follows the second.
    Coupling(usize, usize, f64),
    Drift(usize, f64),
    /// The joint stays where it was commanded to be in the first of these rows, up to the last.
    Held(usize, usize, usize),
    Mount(usize, [f64; 3]),
    CameraMount([f64; 6]),
    /// What warms up: a joint's zero, a link's length, the camera's mount. Such an error approaches its end as `1 − exp(−3 t/T)`.
    ZeroWarms(usize, f64),
    LinkWarms(usize, [f64; 3]),
    CameraWarms([f64; 6]),
    /// The board alone: rotation vector and shift in its own frame.
    BoardMount([f64; 6]),
    Focal(f64),
    Center(f64, f64),
    /// All markers are detected so many pixels to the right and below.
    MarkersDetected(f64, f64),
    /// Relative error of the focal length in the markers' colour alone.
    MarkersFocal(f64),
    Radial(f64),
    BoardScale(f64),
    Glass(f64),
    Curvature(f64),
}

pub struct World {
    pub bones: Vec<Bone>,
    /// Name, bone, place on it.
    pub markers: Vec<(String, usize, Vector3<f64>)>,
    pub neck: bool,
    /// Bones that gears drive from another one's joint: follower, leader, factor.
    pub geared: Vec<(usize, usize, f64)>,
}

#[derive(Clone)]
pub struct Plan {
    pub postures: usize,
    pub views: usize,
    pub noise_px: f64,
    pub seed: u64,
    pub wrong: Vec<Wrong>,
}

impl Default for Plan {
    fn default() -> Self {
        Self { postures: 60, views: 2, noise_px: 0.15, seed: 1, wrong: Vec::new() }
    }
}

impl Plan {
    /// How far everything has warmed up in a row: 0 to 1.
    fn warmth(&self, row: usize) -> f64 {
        1.0 - (-3.0 * row as f64 / (self.postures * self.views) as f64).exp()
    }

    /// The same with links and the camera's mount as warm as they are in a row.
    fn at_row(&self, row: usize) -> Self {
        let share = self.warmth(row);
        let now = |wrong: &Wrong| match wrong {
            Wrong::LinkWarms(bone, end) => Wrong::Length(Some(*bone), end.map(|x| share * x)),
            Wrong::CameraWarms(end) => Wrong::CameraMount(end.map(|x| share * x)),
            other => other.clone(),
        };
        Self { wrong: self.wrong.iter().map(now).collect(), ..self.clone() }
    }
}

fn xyz(v: &Vector3<f64>) -> String {
    format!("{} {} {}", v.x, v.y, v.z)
}

fn isometry(at: Vector3<f64>, rpy: [f64; 3]) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::from(at), UnitQuaternion::from_euler_angles(rpy[0], rpy[1], rpy[2]))
}

impl World {
    /// Two arms of so many joints each (4 or more), three markers an arm; with `neck`, the head turns against the board.
    pub fn new(an_arm: usize, neck: bool) -> Self {
        let mut bones = Vec::new();
        if neck {
            bones.push(Bone {
                name: "neck_yaw".into(),
                parent: None,
                at: Vector3::new(0.0, 0.0, 0.3),
                axis: Vector3::z(),
                mass: 0.5,
                com: Vector3::new(0.02, 0.0, 0.05),
            });
        }
        let mut markers = Vec::new();
        for (side, s) in [("l", 1.0), ("r", -1.0)] {
            let first = bones.len();
            let names = ["shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow"];
            for k in 0..an_arm {
                let reach = 0.2 / (an_arm as f64 - 3.0);
                let at = match k {
                    0 => Vector3::new(0.0, s * 0.16, 0.24),
                    1 => Vector3::new(0.0, s * 0.03, 0.0),
                    2 => Vector3::new(0.0, 0.0, -0.03),
                    3 => Vector3::new(0.01, 0.0, -0.19),
                    _ => Vector3::new(reach, 0.0, 0.0),
                };
                let axis = match k % 7 {
                    0 | 3 | 5 => Vector3::y(),
                    1 | 6 => Vector3::x(),
                    _ => Vector3::z(),
                };
                let name = names.get(k).map_or_else(|| format!("wrist_{}", k - 3), |n| (*n).to_owned());
                bones.push(Bone {
                    name: format!("{side}_{name}"),
                    parent: (k > 0).then(|| bones.len() - 1),
                    at,
                    axis,
                    mass: if k < 4 { 0.5 + 0.1 * k as f64 } else { 0.2 },
                    com: match k {
                        2 => Vector3::new(0.0, 0.0, -0.1),
                        k if k >= 3 => Vector3::new(reach / 2.0, 0.0, 0.005),
                        _ => Vector3::new(0.0, s * 0.01, -0.01),
                    },
                });
            }
            let reach = 0.2 / (an_arm as f64 - 3.0);
            markers.push((format!("{side}_upper"), first + 2, Vector3::new(0.04, s * 0.02, -0.12)));
            markers.push((format!("{side}_fore"), first + 3, Vector3::new(reach * 0.5, s * 0.03, 0.03)));
            markers.push((
                format!("{side}_hand"),
                first + an_arm - 1,
                Vector3::new(reach, 0.0, if an_arm > 4 { 0.04 } else { 0.02 }),
            ));
        }
        Self { bones, markers, neck, geared: Vec::new() }
    }

    pub fn bone(&self, name: &str) -> usize {
        self.bones.iter().position(|b| b.name == name).unwrap()
    }

    pub fn urdf(&self) -> String {
        let mut out = String::from(
            "<robot name=\"w\"><link name=\"base\"><inertial><mass value=\"3\"/></inertial></link>",
        );
        for (b, bone) in self.bones.iter().enumerate() {
            let mimic = self.geared.iter().find(|(follower, ..)| *follower == b).map_or_else(
                String::new,
                |(_, leader, factor)| {
                    format!("<mimic joint=\"{}\" multiplier=\"{factor}\"/>", self.bones[*leader].name)
                },
            );
            let parent =
                bone.parent.map_or_else(|| "base".into(), |p| format!("{}_link", self.bones[p].name));
            let _ = write!(
                out,
                "<link name=\"{n}_link\"><inertial><origin xyz=\"{c}\"/><mass value=\"{m}\"/></inertial></link>\
                 <joint name=\"{n}\" type=\"revolute\"><origin xyz=\"{a}\"/><parent link=\"{parent}\"/>\
                 <child link=\"{n}_link\"/><axis xyz=\"{x}\"/>\
                 <limit lower=\"-2\" upper=\"2\" effort=\"1\" velocity=\"1\"/>{mimic}</joint>",
                n = bone.name,
                c = xyz(&bone.com),
                m = bone.mass,
                a = xyz(&bone.at),
                x = xyz(&bone.axis)
            );
        }
        let mut fixed = |name: &str, parent: &str, at: Vector3<f64>, rpy: [f64; 3]| {
            let _ = write!(
                out,
                "<link name=\"{name}\"/><joint name=\"{name}_fixed\" type=\"fixed\">\
                 <origin xyz=\"{}\" rpy=\"{} {} {}\"/><parent link=\"{parent}\"/><child link=\"{name}\"/></joint>",
                xyz(&at),
                rpy[0],
                rpy[1],
                rpy[2]
            );
        };
        let (mount, at) = self.camera_mount();
        fixed("head", mount.map_or("base", |_| "neck_yaw_link"), at, [0.0, CAMERA_DOWN_RAD, 0.0]);
        let quarter = core::f64::consts::FRAC_PI_2;
        fixed("camera", "head", Vector3::zeros(), [-quarter, 0.0, -quarter]);
        fixed("board", "base", Vector3::from(BOARD_AT), [quarter, 0.0, quarter]);
        for (name, bone, at) in &self.markers {
            fixed(name, &format!("{}_link", self.bones[*bone].name), *at, [0.0; 3]);
        }
        out.push_str("</robot>");
        out
    }

    /// The bone that carries the head, and the head's place on it.
    fn camera_mount(&self) -> (Option<usize>, Vector3<f64>) {
        let at = Vector3::from(CAMERA_AT);
        if self.neck { (Some(0), at - self.bones[0].at) } else { (None, at) }
    }
}
