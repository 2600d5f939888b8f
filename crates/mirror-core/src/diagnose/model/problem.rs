//! The recording arranged for estimation: sites, observations frame by frame, noise, and each frame's board.

use crate::camera::{Camera, Distortion};
use crate::diagnose::data::recording::{PointsFrame, Recording, Target, Via};
use crate::diagnose::model::body::Site;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::frame::{FrameWork, Task};
use crate::diagnose::model::free_optics::FreeValues;
use crate::diagnose::model::kinematics::NodePoses;
use crate::diagnose::model::pose::Pose;
use crate::diagnose::model::scene::Scene;
use crate::error::Result;
use crate::geometry::Plane;
use crate::mirror::{Curvature, GlassPane, MirrorOptics, Sphere};
use crate::robot::Robot;
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3, Vector6};
use rayon::prelude::*;

/// Frames that are worked on together: a fixed number, so that sums do not depend on the number of cores.
pub(crate) const FRAMES_A_CHUNK: usize = 32;

/// Standard deviations of one axis of an observation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Noise {
    pub corner_px: f64,
    pub marker_px: f64,
    pub point_m: f64,
}

/// What an observation sees.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Seen {
    Marker(usize),
    Corner(usize),
}

/// An observation other than a board corner in the mirror.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Observation {
    Pixel { seen: Seen, via: Via, pixel: Vector2<f64> },
    Point { marker: usize, position: Vector3<f64> },
}

/// One frame's observations.
#[derive(Debug, Clone)]
pub(crate) struct FrameData {
    /// Board corners in the mirror: index and pixel.
    pub corners: Vec<(usize, Vector2<f64>)>,
    pub others: Vec<Observation>,
}

/// The mirror's plane as the board alone shows it, condensed: `χ²(f) ≈ χ² + (f − f̂)ᵀ Λ (f − f̂)` in units of px².
#[derive(Debug, Clone, Copy)]
pub(crate) struct BoardFit {
    pub foot: Vector3<f64>,
    pub information: Matrix3<f64>,
    pub chi2_px2: f64,
    pub corners: usize,
}

/// All that the forward model needs.
#[derive(Debug, Clone)]
pub(crate) struct Problem {
    pub scene: Scene,
    pub frames: Vec<FrameData>,
    pub posture: Vec<i64>,
    pub frame_numbers: Vec<i64>,
    pub marker_sites: Vec<Site>,
    pub marker_mounts: Vec<Site>,
    pub balls: Vec<Sphere>,
    /// Whether image points of balls are centroids of their outlines rather than pictures of their centres.
    pub outlines: bool,
    pub board: Option<Site>,
    /// Corners in the board's frame, nominal, m.
    pub corners: Vec<Vector3<f64>>,
    pub camera_site: Option<Site>,
    pub camera: Option<Camera>,
    pub refractive_index: f64,
    /// The link (or the root, for an unknown frame) against which measured points are told.
    pub points_site: Option<Site>,
    /// Start of the pose of the root in the unknown frame.
    pub unknown_frame: Option<Pose>,
    pub noise: Noise,
    /// Each frame's mirror as the board shows it with nominal optics; none where too few corners were seen.
    pub boards: Vec<Option<BoardFit>>,
    /// Nodes that carry exactly one of camera and board.
    pub between_camera_and_board: Vec<usize>,
}

/// The camera and the mirror of a deformation.
#[derive(Debug, Clone)]
pub(crate) struct Eye {
    pub camera: Camera,
    pub mirror: MirrorOptics,
    pub camera_from_mount: Pose,
    /// `Exp(ω)ᵀ`-related pieces of the mount's derivative.
    pub mount_jacobian: Matrix3<f64>,
    pub nominal_focal: Vector2<f64>,
    /// Free-form errors of lens, board and mirror, where there are any.
    pub free: Option<FreeValues>,
}

impl Problem {
    /// Arranges a validated recording.
    ///
    /// # Errors
    /// Unknown links; a mirror that no frame's board shows.
    pub fn new(robot: &Robot, recording: &Recording) -> Result<Self> {
        let mut scene = Scene::new(robot, recording)?;
        let site = |link: &str| -> Result<(usize, Site)> {
            let index = robot.link_index(link)?;
            Ok((index, scene.body.site(index)))
        };
        let mut marker_sites = Vec::new();
        let mut marker_mounts = Vec::new();
        let mut balls = Vec::new();
        for marker in &recording.markers {
            let (index, at) = site(&marker.link)?;
            marker_sites.push(at);
            marker_mounts.push(scene.body.mount_of(index));
            balls.push(Sphere::of_diameter_m(marker.diameter_m)?);
        }
        let sight = recording.sight.as_ref();
        let camera_site = sight.map(|s| site(&s.camera_link)).transpose()?.map(|s| s.1);
        let board_spec = sight.and_then(|s| s.board.as_ref());
        let board = board_spec.map(|b| site(&b.link)).transpose()?.map(|s| s.1);
        let corners = board_spec.map_or_else(Vec::new, |b| {
            let (nx, ny) = b.corners;
            let at = |i: usize, n: usize| (i as f64 - (n as f64 - 1.0) / 2.0) * b.square_m;
            (0..nx * ny).map(|i| Vector3::new(at(i % nx, nx), at(i / nx, ny), 0.0)).collect()
        });
        let (points_site, unknown) = match &recording.points_frame {
            None => (None, false),
            Some(PointsFrame::Link(link)) => (Some(site(link)?.1), false),
            Some(PointsFrame::Unknown) => (Some(scene.body.root), true),
        };
        let observers: Vec<Option<usize>> =
            [camera_site, points_site].iter().flatten().map(|s| s.node).collect();
        let targets: Vec<Option<usize>> =
            marker_sites.iter().map(|s| s.node).chain(board.iter().map(|s| s.node)).collect();
        scene.find_relevant(&observers, &targets, &marker_sites);
        scene.tabulate_down(&marker_mounts);
        let between_camera_and_board = match (camera_site, board) {
            (Some(camera), Some(board)) => (0..scene.nodes())
                .filter(|&n| scene.body.carries(n, camera.node) != scene.body.carries(n, board.node))
                .collect(),
            _ => Vec::new(),
        };
        let frames = recording
            .frames
            .iter()
            .map(|frame| {
                let mut data = FrameData { corners: Vec::new(), others: Vec::new() };
                for s in &frame.sightings {
                    match (s.target, s.via) {
                        (Target::Corner(i), Via::Mirror) => data.corners.push((i, s.pixel)),
                        (Target::Corner(i), Via::Direct) => data.others.push(Observation::Pixel {
                            seen: Seen::Corner(i),
                            via: Via::Direct,
                            pixel: s.pixel,
                        }),
                        (Target::Marker(m), via) => {
                            data.others.push(Observation::Pixel {
                                seen: Seen::Marker(m),
                                via,
                                pixel: s.pixel,
                            });
                        }
                    }
                }
                for p in &frame.points {
                    data.others.push(Observation::Point { marker: p.marker, position: p.position_m.coords });
                }
                data
            })
            .collect();
        let pixel_std = recording.pixel_std_px.unwrap_or(0.25);
        let mut problem = Self {
            frames,
            posture: recording.frames.iter().map(|f| f.posture).collect(),
            frame_numbers: recording.frames.iter().map(|f| f.number).collect(),
            marker_sites,
            marker_mounts,
            balls,
            outlines: true,
            board,
            corners,
            camera_site,
            camera: sight.map(|s| s.camera.clone()),
            refractive_index: sight.map_or(1.52, |s| s.refractive_index),
            points_site,
            unknown_frame: None,
            noise: Noise {
                corner_px: pixel_std,
                marker_px: pixel_std,
                point_m: recording.point_std_m.unwrap_or(5e-4),
            },
            boards: Vec::new(),
            between_camera_and_board,
            scene,
        };
        if unknown {
            problem.unknown_frame = Some(problem.start_of_unknown_frame());
        }
        problem.fit_boards()?;
        Ok(problem)
    }

    /// The nominal deformation of this recording.
    pub fn nominal(&self) -> Deformation {
        Deformation::nominal(self.scene.frames, self.scene.nodes(), self.marker_sites.len())
    }

    /// Fits each frame's mirror to its board with nominal optics.
    fn fit_boards(&mut self) -> Result<()> {
        let nominal = self.nominal();
        let eye = self.eye(&nominal)?;
        let fits: Vec<Option<BoardFit>> = (0..self.frames.len())
            .into_par_iter()
            .with_min_len(FRAMES_A_CHUNK)
            .map_init(
                || FrameWork::new(self),
                |work, frame| work.fit_board(self, &nominal, eye.as_ref(), frame, None),
            )
            .collect();
        self.boards = fits;
        Ok(())
    }

    /// Camera and mirror of a deformation; none where the session has no camera.
    ///
    /// # Errors
    /// A camera or a mirror that cannot be (a focal length below zero, say).
    pub fn eye(&self, deformation: &Deformation) -> Result<Option<Eye>> {
        self.eye_as(deformation, deformation.camera_mount, deformation.focal_scale_error)
    }

    /// Camera and mirror in one frame, where they vary.
    ///
    /// # Errors
    /// As [`Problem::eye`].
    pub fn eye_in(&self, deformation: &Deformation, frame: usize) -> Result<Option<Eye>> {
        self.eye_as(deformation, deformation.camera_mount_in(frame), deformation.focal_scale_error_in(frame))
    }

    fn eye_as(
        &self,
        deformation: &Deformation,
        mount: Vector6<f64>,
        focal_scale_error: f64,
    ) -> Result<Option<Eye>> {
        let Some(nominal) = &self.camera else { return Ok(None) };
        let camera = if deformation.optics_differ() {
            let mut k = nominal.distortion().coefficients();
            k[0] += deformation.dk1;
            let lens = match nominal.distortion() {
                Distortion::RationalPolynomial(_) => Distortion::RationalPolynomial(k),
                _ => Distortion::PlumbBob([k[0], k[1], k[2], k[3], k[4]]),
            };
            Camera::new(
                nominal.size_px(),
                nominal.focal_px() * (1.0 + focal_scale_error),
                nominal.center_px() + deformation.center_px,
                lens,
            )?
        } else {
            nominal.clone()
        };
        let thickness = (self.scene.glass_thickness_m + deformation.glass_thickness_m).max(0.0);
        let mirror = MirrorOptics {
            pane: GlassPane::new(thickness, self.refractive_index)?,
            curvature: Curvature::new(deformation.curvature_per_m)?,
        };
        let omega = mount.fixed_rows::<3>(0).into_owned();
        let shift = mount.fixed_rows::<3>(3).into_owned();
        // real camera = nominal ∘ (Exp ω, v): p_real = Exp(ω)ᵀ (p_nominal − v).
        let mount = Pose { r: crate::diagnose::model::pose::exp(&omega), t: shift };
        Ok(Some(Eye {
            camera,
            mirror,
            camera_from_mount: mount.inverse(),
            mount_jacobian: crate::geometry::rotation::right_jacobian(&omega),
            nominal_focal: nominal.focal_px(),
            free: (deformation.free_optics != FreeValues::zeros()).then_some(deformation.free_optics),
        }))
    }

    /// Pose of the root in the unknown frame that fits the nominal model best (Umeyama 1991, without scale).
    fn start_of_unknown_frame(&self) -> Pose {
        let nominal = self.nominal();
        let nodes = self.scene.nodes();
        let mut poses = NodePoses::new(nodes);
        let (mut pairs, mut mean_a, mut mean_b) = (Vec::new(), Vector3::zeros(), Vector3::zeros());
        for (f, data) in self.frames.iter().enumerate() {
            poses.update(&self.scene.body, &self.scene.commanded[f * nodes..(f + 1) * nodes], &nominal, f);
            let root = poses.site(&self.scene.body.root);
            for observation in &data.others {
                if let Observation::Point { marker, position } = observation {
                    let in_root = root.inverse_point(&poses.site(&self.marker_sites[*marker]).t);
                    mean_a += position;
                    mean_b += in_root;
                    pairs.push((*position, in_root));
                }
            }
        }
        let count = pairs.len().max(1) as f64;
        mean_a /= count;
        mean_b /= count;
        let covariance: Matrix3<f64> =
            pairs.iter().map(|(a, b)| (a - mean_a) * (b - mean_b).transpose()).sum();
        let svd = covariance.svd(true, true);
        let rotation = match (svd.u, svd.v_t) {
            (Some(u), Some(v_t)) => {
                let sign = (u * v_t).determinant().signum();
                u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t
            }
            _ => Matrix3::identity(),
        };
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
        let translation = Translation3::from(mean_a - rotation * mean_b);
        Pose::from(&Isometry3::from_parts(translation, rotation))
    }

    /// Whether a deformation changes how the board's corners are seen: its optics, or a joint between camera and board.
    pub fn needs_fresh_board(&self, deformation: &Deformation) -> bool {
        deformation.optics_differ()
            || deformation.moves_any(&self.between_camera_and_board)
            || self.shifts_between(deformation)
    }

    /// [`Problem::needs_fresh_board`] for one frame, without looking at the others.
    pub fn needs_fresh_board_in(&self, deformation: &Deformation, frame: usize) -> bool {
        deformation.optics_differ()
            || self.shifts_between(deformation)
            || self.between_camera_and_board.iter().any(|&n| deformation.moves_in(frame, n))
    }

    /// Whether the origin of a joint between camera and board is shifted, by what carries it.
    fn shifts_between(&self, deformation: &Deformation) -> bool {
        let nodes = self.scene.nodes();
        self.between_camera_and_board.iter().any(|&n| {
            let carrier = self.scene.body.nodes[n].parent.unwrap_or(nodes);
            deformation.link_shift[carrier] != Vector3::zeros()
        })
    }

    /// Leaves a run of frames out: nothing that was seen in them counts.
    pub fn leave_out(&mut self, frames: core::ops::RangeInclusive<usize>) {
        for frame in frames {
            self.frames[frame] = FrameData { corners: Vec::new(), others: Vec::new() };
            if let Some(board) = self.boards.get_mut(frame) {
                *board = None;
            }
        }
    }

    /// This problem without the observations that a model shows to be false: farther off than `deviations` of the noise.
    ///
    /// # Errors
    /// A camera or mirror that cannot be.
    pub fn without_false(&self, deformation: &Deformation, noise: Noise, deviations: f64) -> Result<Self> {
        let eye = self.eye(deformation)?;
        let task = Task { gaussian: false, ..Task::of_residuals(self, deformation, eye.as_ref(), noise) };
        let mut out = self.clone();
        let mut work = FrameWork::new(self);
        for (f, data) in out.frames.iter_mut().enumerate() {
            if !work.evaluate(self, &task, f) {
                continue;
            }
            let mut residuals = Vec::new();
            work.raw_residuals(|marker, measured, r| residuals.push((marker, measured, r.norm())));
            let mut at = 0;
            data.others.retain(|observation| {
                let (marker, std) = match observation {
                    Observation::Pixel { seen: Seen::Marker(m), .. } => (*m, noise.marker_px),
                    Observation::Point { marker, .. } => (*marker, noise.point_m),
                    Observation::Pixel { .. } => return true,
                };
                match residuals.get(at) {
                    Some((Some(m), _, size)) if *m == marker => {
                        at += 1;
                        *size <= deviations * std
                    }
                    // Not predicted at all: as false as can be.
                    _ => false,
                }
            });
        }
        Ok(out)
    }

    /// Whether an atom's node or marker exists here.
    pub fn has_atom(&self, atom: crate::diagnose::model::elementary::Atom) -> bool {
        use crate::diagnose::model::elementary::Atom;
        match atom {
            Atom::Joint(n)
            | Atom::Tilt(n, _)
            | Atom::Bend(n)
            | Atom::Turn(n, _)
            | Atom::OriginShift(n, _)
            | Atom::LinkShift(Some(n), _) => n < self.scene.nodes(),
            Atom::MarkerShift(m, _) => m < self.marker_sites.len(),
            _ => true,
        }
    }

    /// The plane of a foot point, or none where it runs through the camera.
    pub fn plane(foot: &Vector3<f64>) -> Option<Plane> {
        Plane::from_foot_point(foot).ok()
    }
}
