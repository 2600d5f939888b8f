//! What is recorded of a plan: sightings in the mirror, or points.

use super::light::Light;
use super::{
    BOARD_AT, CAMERA_DOWN_RAD, CENTER_PX, CORNERS, FOCAL_PX, GLASS_INDEX, GRAVITY, Plan, SQUARE_M, World,
    isometry,
};
use mirror_core::camera::{Camera, Distortion};
use mirror_core::diagnose::{
    BoardSpec, Frame, MarkerSpec, MeasuredPoint, PointsFrame, Recording, SightSpec, Sighting, Target,
    Tolerances, Via,
};
use nalgebra::{Isometry3, Point3, Vector2, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

impl World {
    /// The whole recording.
    pub fn record(&self, plan: &Plan) -> Recording {
        let mut rng = ChaCha8Rng::seed_from_u64(plan.seed);
        let commanded = self.commanded(plan, &mut rng);
        let theta = self.actual(plan, &commanded);
        let order = self.robots_order();
        let mut frames = Vec::new();
        for (f, q) in commanded.iter().enumerate() {
            let plan = &plan.at_row(f);
            let light = Light::of(plan);
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
                if matches!(target, Target::Marker(_)) {
                    pixel += light.detected_px + (pixel - light.center_px) * light.color_focal;
                }
                if pixel.x > 0.0 && pixel.y > 0.0 && pixel.x < 799.0 && pixel.y < 599.0 {
                    sightings.push(Sighting { target, via: Via::Mirror, pixel });
                }
            };
            let board = isometry(Vector3::from(BOARD_AT), [quarter, 0.0, quarter]) * light.board;
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
    /// The same robot measured point by point in a fixed frame that nobody knows; no camera, no mirror.
    pub fn record_points(&self, plan: &Plan, noise_m: f64) -> Recording {
        self.record_points_of_base(plan, noise_m, |_, _| Isometry3::identity())
    }

    /// The same of a base that moves: by the frame's number and by the moment of gravity of the whole robot about the base's
    /// origin, N m.
    pub fn record_points_of_base(
        &self,
        plan: &Plan,
        noise_m: f64,
        base: impl Fn(usize, Vector3<f64>) -> Isometry3<f64>,
    ) -> Recording {
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
            let plan = &plan.at_row(f);
            let poses = self.settled(plan, &theta[f]);
            let world_from_base = world_from_base * base(f, self.moment_about_base(&poses));
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
    pub fn robots_order(&self) -> Vec<usize> {
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
            tolerances: Tolerances::default(),
            points_frame: None,
            columns: Vec::new(),
            ordered: true,
            timed: true,
            pixel_std_px: Some(plan.noise_px.max(0.01)),
            point_std_m: None,
            frames,
        }
    }
}
