//! Recordings of a small humanoid before a mirror, made without any formula of the diagnosis.
//!
//! The chain is multiplied out of `Isometry3`s with the errors put in where they sit, gravity's torques are sums over
//! point masses, play is followed in small steps of time, light bounces by the laws of reflection and refraction
//! (a pane by the angle of incidence, a hollow mirror by the shortest path), and a pinhole makes the picture.

use mirror_core::camera::{Camera, Distortion};
use mirror_core::gap::{
    BoardSpec, Frame, MarkerSpec, MeasuredPoint, PointsFrame, Recording, SightSpec, Sighting, Target, Via,
};
use nalgebra::{Isometry3, Matrix2, Point3, Translation3, Unit, UnitQuaternion, Vector2, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::fmt::Write;

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
    Bending(usize, f64),
    Length(Option<usize>, [f64; 3]),
    Tilt(usize, f64, f64),
    /// The first follows the second.
    Coupling(usize, usize, f64),
    Drift(usize, f64),
    Mount(usize, [f64; 3]),
    CameraMount([f64; 6]),
    Focal(f64),
    Center(f64, f64),
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
        Self { bones, markers, neck }
    }

    pub fn bone(&self, name: &str) -> usize {
        self.bones.iter().position(|b| b.name == name).unwrap()
    }

    pub fn urdf(&self) -> String {
        let mut out = String::from(
            "<robot name=\"w\"><link name=\"base\"><inertial><mass value=\"3\"/></inertial></link>",
        );
        for bone in &self.bones {
            let parent =
                bone.parent.map_or_else(|| "base".into(), |p| format!("{}_link", self.bones[p].name));
            let _ = write!(
                out,
                "<link name=\"{n}_link\"><inertial><origin xyz=\"{c}\"/><mass value=\"{m}\"/></inertial></link>\
                 <joint name=\"{n}\" type=\"revolute\"><origin xyz=\"{a}\"/><parent link=\"{parent}\"/>\
                 <child link=\"{n}_link\"/><axis xyz=\"{x}\"/>\
                 <limit lower=\"-2\" upper=\"2\" effort=\"1\" velocity=\"1\"/></joint>",
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

    fn below(&self, bone: usize, ancestor: usize) -> bool {
        let mut at = Some(bone);
        while let Some(b) = at {
            if b == ancestor {
                return true;
            }
            at = self.bones[b].parent;
        }
        false
    }

    /// What a bone carries next: the next joint's origin, or its farthest marker.
    fn tip(&self, bone: usize) -> Vector3<f64> {
        let child = self.bones.iter().find(|b| b.parent == Some(bone)).map(|b| b.at);
        let far = self.markers.iter().filter(|m| m.1 == bone).map(|m| m.2);
        child.or(far.max_by(|a, b| a.norm().total_cmp(&b.norm()))).unwrap_or_else(Vector3::zeros)
    }

    /// Poses of the bones' frames in the base at actual joint positions.
    fn chain(&self, theta: &[f64], wrong: &[Wrong], bends: &[Vector3<f64>]) -> Vec<Isometry3<f64>> {
        let mut out: Vec<Isometry3<f64>> = Vec::new();
        for (b, bone) in self.bones.iter().enumerate() {
            let (mut at, mut axis) = (bone.at, bone.axis);
            for w in wrong {
                match w {
                    Wrong::Length(link, d) if *link == bone.parent => at += Vector3::from(*d),
                    Wrong::Tilt(joint, t1, t2) if *joint == b => {
                        let e = if axis.x.abs() >= 0.8 { Vector3::y() } else { Vector3::x() };
                        let u = axis.cross(&e).normalize();
                        let v = axis.cross(&u);
                        axis = (axis + u * t1.tan() + v * t2.tan()).normalize();
                    }
                    _ => {}
                }
            }
            let turn = UnitQuaternion::from_axis_angle(&Unit::new_normalize(axis), theta[b]);
            let mut pose = bone.parent.map_or_else(Isometry3::identity, |p| out[p])
                * Isometry3::from_parts(Translation3::from(at), turn);
            if bends[b] != Vector3::zeros() {
                let middle = Translation3::from(self.tip(b) / 2.0);
                pose = pose * middle * UnitQuaternion::from_scaled_axis(bends[b]) * middle.inverse();
            }
            out.push(pose);
        }
        out
    }

    /// Torque of gravity about a point of all that a bone carries, itself included.
    fn load_about(&self, bone: usize, poses: &[Isometry3<f64>], at: &Point3<f64>) -> Vector3<f64> {
        (0..self.bones.len())
            .filter(|&b| self.below(b, bone))
            .map(|b| {
                let lever = poses[b] * Point3::from(self.bones[b].com) - at;
                lever.cross(&(GRAVITY * self.bones[b].mass))
            })
            .sum()
    }

    fn joint_torque(&self, bone: usize, poses: &[Isometry3<f64>]) -> f64 {
        let pose = &poses[bone];
        let origin = Point3::from(pose.translation.vector);
        (pose.rotation * self.bones[bone].axis).dot(&self.load_about(bone, poses, &origin))
    }

    /// Random postures, each as often as there are views.
    fn commanded(&self, plan: &Plan, rng: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
        let mut out = Vec::new();
        for _ in 0..plan.postures {
            let q: Vec<f64> = (0..self.bones.len())
                .map(|b| {
                    let widest = if self.neck && b == 0 { 0.12 } else { 0.45 };
                    (rng.random_range(-widest..widest) * 1e4_f64).round() / 1e4
                })
                .collect();
            out.extend(std::iter::repeat_n(q, plan.views));
        }
        out
    }

    /// Where the output of a joint with play lies from its commanded position, row by row.
    fn play(&self, commanded: &[Vec<f64>], joint: usize, width: f64, friction: f64) -> Vec<f64> {
        let straight = vec![Vector3::zeros(); self.bones.len()];
        let mut last = vec![0.0; self.bones.len()];
        let mut output = 0.0;
        commanded
            .iter()
            .map(|row| {
                for step in 1..=PLAY_STEPS {
                    let share = step as f64 / PLAY_STEPS as f64;
                    let q: Vec<f64> = last.iter().zip(row).map(|(a, b)| a + (b - a) * share).collect();
                    let torque = self.joint_torque(joint, &self.chain(&q, &[], &straight));
                    let (low, high) = (q[joint] - width / 2.0, q[joint] + width / 2.0);
                    output = if torque > friction {
                        high
                    } else if torque < -friction {
                        low
                    } else {
                        f64::clamp(output, low, high)
                    };
                }
                last.clone_from(row);
                output - row[joint]
            })
            .collect()
    }

    /// The real positions of all joints in all rows, before anything gives way.
    fn actual(&self, plan: &Plan, commanded: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let mut out = commanded.to_vec();
        for w in &plan.wrong {
            let slack = match w {
                Wrong::Backlash(j, width, friction) => self.play(commanded, *j, *width, *friction),
                _ => Vec::new(),
            };
            let (mut last, mut sign) = (0.0, 0.0);
            for (f, theta) in out.iter_mut().enumerate() {
                let q = &commanded[f];
                match *w {
                    Wrong::Offset(j, a) => theta[j] += a,
                    Wrong::Ratio(j, e) => theta[j] += e * q[j],
                    Wrong::Eccentric(j, s, c) => theta[j] += s * q[j].sin() + c * q[j].cos() - c,
                    Wrong::Backlash(j, ..) => theta[j] += slack[f],
                    Wrong::Stiction(j, d) => {
                        if q[j] != last {
                            sign = if q[j] > last { 1.0 } else { -1.0 };
                        }
                        last = q[j];
                        theta[j] -= d * sign;
                    }
                    Wrong::Coupling(j, k, c) => theta[j] += c * q[k],
                    Wrong::Drift(j, rate) => theta[j] += rate * f as f64,
                    _ => {}
                }
            }
        }
        out
    }

    /// Poses of the bones with all that gives way under load in balance with the load.
    fn settled(&self, plan: &Plan, theta: &[f64]) -> Vec<Isometry3<f64>> {
        let mut bends = vec![Vector3::zeros(); self.bones.len()];
        let mut poses = self.chain(theta, &plan.wrong, &bends);
        for _ in 0..6 {
            let mut theta = theta.to_vec();
            for w in &plan.wrong {
                match *w {
                    Wrong::Compliance(j, c) => theta[j] += c * self.joint_torque(j, &poses),
                    Wrong::Bending(b, c) => {
                        let middle = poses[b] * Point3::from(self.tip(b) / 2.0);
                        let load = poses[b].rotation.inverse() * self.load_about(b, &poses, &middle);
                        let along = self.tip(b).normalize();
                        bends[b] = (load - along * along.dot(&load)) * c;
                    }
                    _ => {}
                }
            }
            poses = self.chain(&theta, &plan.wrong, &bends);
        }
        poses
    }

    /// The whole recording.
    pub fn record(&self, plan: &Plan) -> Recording {
        let mut rng = ChaCha8Rng::seed_from_u64(plan.seed);
        let commanded = self.commanded(plan, &mut rng);
        let theta = self.actual(plan, &commanded);
        let light = Light::of(plan);
        let order = self.robots_order();
        let mut frames = Vec::new();
        for (f, q) in commanded.iter().enumerate() {
            let poses = self.settled(plan, &theta[f]);
            let (carrier, at) = self.camera_mount();
            let quarter = core::f64::consts::FRAC_PI_2;
            let head = carrier.map_or_else(Isometry3::identity, |b| poses[b])
                * isometry(at, [0.0, CAMERA_DOWN_RAD, 0.0])
                * isometry(Vector3::zeros(), [-quarter, 0.0, -quarter]);
            let camera_from_base = (head * light.mount).inverse();
            let view = f % plan.views;
            let yaw = [-0.12, 0.12, 0.0][view % 3] + rng.random_range(-0.03..0.03);
            let pitch = [0.08, -0.08, 0.16][view % 3] + rng.random_range(-0.03..0.03);
            let glass = (
                Vector3::new(f64::sin(yaw), f64::sin(pitch), 1.0).normalize(),
                0.55 + rng.random_range(-0.05..0.05),
            );
            let mut sightings = Vec::new();
            let mut see = |target: Target, point: Point3<f64>, rng: &mut ChaCha8Rng| {
                let mut pixel = light.pixel(&(camera_from_base * point).coords, &glass);
                let mut normal = || -> f64 { StandardNormal.sample(rng) };
                pixel += Vector2::new(normal(), normal()) * plan.noise_px;
                if pixel.x > 0.0 && pixel.y > 0.0 && pixel.x < 799.0 && pixel.y < 599.0 {
                    sightings.push(Sighting { target, via: Via::Mirror, pixel });
                }
            };
            let board = isometry(Vector3::from(BOARD_AT), [quarter, 0.0, quarter]);
            for i in 0..CORNERS.0 * CORNERS.1 {
                let x = (i % CORNERS.0) as f64 - (CORNERS.0 as f64 - 1.0) / 2.0;
                let y = (i / CORNERS.0) as f64 - (CORNERS.1 as f64 - 1.0) / 2.0;
                let at = Point3::new(x, y, 0.0) * (SQUARE_M * light.board_scale);
                see(Target::Corner(i), board * at, &mut rng);
            }
            for (m, at) in self.marker_points(plan, &poses).into_iter().enumerate() {
                see(Target::Marker(m), at, &mut rng);
            }
            frames.push(Frame {
                number: f as i64,
                posture: (f / plan.views) as i64,
                time_s: f as f64,
                commanded: order.iter().map(|&b| q[b]).collect(),
                sightings,
                points: Vec::new(),
            });
        }
        self.recording(plan, frames)
    }

    /// Positions of the markers in the base.
    fn marker_points(&self, plan: &Plan, poses: &[Isometry3<f64>]) -> Vec<Point3<f64>> {
        self.markers
            .iter()
            .enumerate()
            .map(|(m, (_, bone, at))| {
                let mut at = *at;
                for w in &plan.wrong {
                    match w {
                        Wrong::Mount(marker, d) if *marker == m => at += Vector3::from(*d),
                        _ => {}
                    }
                }
                poses[*bone] * Point3::from(at)
            })
            .collect()
    }

    /// The same robot measured point by point in a fixed frame that nobody knows; no camera, no mirror.
    pub fn record_points(&self, plan: &Plan, noise_m: f64) -> Recording {
        let mut recording = self.record(plan);
        let mut rng = ChaCha8Rng::seed_from_u64(plan.seed ^ 0x9e37);
        let commanded: Vec<Vec<f64>> = {
            let mut again = ChaCha8Rng::seed_from_u64(plan.seed);
            self.commanded(plan, &mut again)
        };
        let theta = self.actual(plan, &commanded);
        let world_from_base = isometry(Vector3::new(1.2, -0.4, 0.7), [0.3, -0.5, 2.0]);
        for (f, frame) in recording.frames.iter_mut().enumerate() {
            frame.sightings.clear();
            let poses = self.settled(plan, &theta[f]);
            for (marker, at) in self.marker_points(plan, &poses).into_iter().enumerate() {
                let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
                let noise = Vector3::new(normal(), normal(), normal()) * noise_m;
                frame.points.push(MeasuredPoint { marker, position_m: world_from_base * at + noise });
            }
        }
        recording.sight = None;
        recording.points_frame = Some(PointsFrame::Unknown);
        recording.point_std_m = Some(noise_m);
        recording
    }

    /// For each of the robot's independent joints the bone that it moves.
    fn robots_order(&self) -> Vec<usize> {
        let robot = mirror_core::robot::Robot::from_urdf_str(&self.urdf()).unwrap();
        robot.position_names().map(|n| self.bone(n)).collect()
    }

    fn recording(&self, plan: &Plan, frames: Vec<Frame>) -> Recording {
        Recording {
            root_link: "base".into(),
            gravity: GRAVITY,
            sight: Some(SightSpec {
                camera: Camera::new(
                    (800, 600),
                    Vector2::new(FOCAL_PX, FOCAL_PX),
                    Vector2::from(CENTER_PX),
                    Distortion::None,
                )
                .unwrap(),
                camera_link: "camera".into(),
                board: Some(BoardSpec { link: "board".into(), corners: CORNERS, square_m: SQUARE_M }),
                glass_thickness_m: 0.0,
                refractive_index: GLASS_INDEX,
            }),
            markers: self
                .markers
                .iter()
                .map(|(name, ..)| MarkerSpec {
                    name: name.clone(),
                    link: name.clone(),
                    diameter_m: 0.0,
                    mount_known: true,
                })
                .collect(),
            points_frame: None,
            ordered: true,
            timed: true,
            pixel_std_px: Some(plan.noise_px.max(0.01)),
            point_std_m: None,
            frames,
        }
    }
}

/// The way of the light and the real camera.
struct Light {
    mount: Isometry3<f64>,
    focal_px: f64,
    center_px: Vector2<f64>,
    k1: f64,
    board_scale: f64,
    glass_m: f64,
    curvature: f64,
}

impl Light {
    fn of(plan: &Plan) -> Self {
        let mut out = Self {
            mount: Isometry3::identity(),
            focal_px: FOCAL_PX,
            center_px: Vector2::from(CENTER_PX),
            k1: 0.0,
            board_scale: 1.0,
            glass_m: 0.0,
            curvature: 0.0,
        };
        for w in &plan.wrong {
            match *w {
                Wrong::CameraMount([a, b, c, x, y, z]) => {
                    out.mount = Isometry3::new(Vector3::new(x, y, z), Vector3::new(a, b, c));
                }
                Wrong::Focal(e) => out.focal_px *= 1.0 + e,
                Wrong::Center(u, v) => out.center_px += Vector2::new(u, v),
                Wrong::Radial(k) => out.k1 = k,
                Wrong::BoardScale(e) => out.board_scale = 1.0 + e,
                Wrong::Glass(t) => out.glass_m = t,
                Wrong::Curvature(k) => out.curvature = k,
                _ => {}
            }
        }
        out
    }

    /// The pixel at which a point in the camera's frame is seen in a mirror of normal and distance.
    fn pixel(&self, point: &Vector3<f64>, (normal, distance): &(Vector3<f64>, f64)) -> Vector2<f64> {
        let sight = if self.curvature == 0.0 {
            self.by_angle(point, normal, *distance)
        } else {
            self.by_least_way(point, normal, *distance)
        };
        let (x, y) = (sight.x / sight.z, sight.y / sight.z);
        let radial = 1.0 + self.k1 * (x * x + y * y);
        Vector2::new(x, y) * (radial * self.focal_px) + self.center_px
    }

    /// Flat mirror, silvered behind a pane: the angle of incidence whose way meets the point, by bisection.
    fn by_angle(&self, point: &Vector3<f64>, normal: &Vector3<f64>, distance: f64) -> Vector3<f64> {
        let height = distance - normal.dot(point);
        let across = point - normal * normal.dot(point);
        let needed = across.norm();
        if needed < 1e-12 {
            return *normal;
        }
        let reached = |angle: f64| {
            let inside = (angle.sin() / GLASS_INDEX).asin();
            (distance + height) * angle.tan() + 2.0 * self.glass_m * inside.tan()
        };
        let (mut low, mut high) = (0.0, 1.5);
        for _ in 0..80 {
            let middle = 0.5 * (low + high);
            if reached(middle) < needed { low = middle } else { high = middle }
        }
        normal * low.cos() + across / needed * low.sin()
    }

    /// Hollow mirror: the place on the sphere over which the way is stationary, by Newton's method.
    fn by_least_way(&self, point: &Vector3<f64>, normal: &Vector3<f64>, distance: f64) -> Vector3<f64> {
        let e = normal.cross(&Vector3::y()).normalize();
        let g = normal.cross(&e);
        let radius = 1.0 / self.curvature;
        // Towards its edge a hollow mirror comes nearer to the camera.
        let surface = |s: &Vector2<f64>| -> (Vector3<f64>, [Vector3<f64>; 2]) {
            let root = (radius * radius - s.norm_squared()).sqrt();
            let sag = radius - radius.signum() * root;
            let slope = s / (radius.signum() * root);
            let at = normal * (distance - sag) + e * s.x + g * s.y;
            (at, [e - normal * slope.x, g - normal * slope.y])
        };
        let gradient = |s: &Vector2<f64>| {
            let (m, [a, b]) = surface(s);
            let unit = m.normalize() + (m - point).normalize();
            Vector2::new(a.dot(&unit), b.dot(&unit))
        };
        let mut s = Vector2::zeros();
        for _ in 0..12 {
            let h = 1e-6;
            let column = |d: Vector2<f64>| (gradient(&(s + d)) - gradient(&(s - d))) / (2.0 * h);
            let hessian =
                Matrix2::from_columns(&[column(Vector2::new(h, 0.0)), column(Vector2::new(0.0, h))]);
            s -= hessian.try_inverse().unwrap() * gradient(&s);
        }
        surface(&s).0
    }
}
