//! The recording arranged for estimation: sites, observations frame by frame, noise, and each frame's board.

use crate::camera::Camera;
use crate::cancel::Cancel;
use crate::diagnose::data::progress::Progress;
use crate::diagnose::data::recording::{PointsFrame, Recording, Target, Tolerances, Via};
use crate::diagnose::model::body::Site;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::elementary::{Atom, Column, moves_against};
use crate::diagnose::model::mistake_parameters::MistakeParameter;
use crate::diagnose::model::pose::Pose;
use crate::diagnose::model::scene::Scene;
use crate::diagnose::model::slips::Slip;
use crate::diagnose::model::work_budget::WorkBudget;
use crate::diagnose::principles::Size;
use crate::error::Result;
use crate::geometry::Plane;
use crate::mirror::Sphere;
use crate::robot::Robot;
use nalgebra::{Matrix3, Vector2, Vector3};

/// Frames that form a unit of work: a fixed number, so that sums do not depend on the number of cores.
pub(crate) const FRAMES_A_CHUNK: Size = 32;

/// Standard deviations of one axis of an observation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Noise {
    pub corner_px: f64,
    pub marker_px: f64,
    pub point_m: f64,
}

/// What an observation sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Seen {
    Marker(usize),
    Corner(usize),
}

/// An observation other than a board corner in the mirror.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Observation {
    Pixel { seen: Seen, via: Via, pixel: Vector2<f64> },
    Point { marker: usize, position: Vector3<f64> },
}

impl Observation {
    /// The marker that it is of; none of a corner.
    pub fn marker(&self) -> Option<usize> {
        match self {
            Self::Pixel { seen: Seen::Marker(m), .. } | Self::Point { marker: m, .. } => Some(*m),
            Self::Pixel { .. } => None,
        }
    }

    /// Standard deviation of each of its numbers where it is a marker's, px or m.
    pub fn marker_std(&self, noise: Noise) -> f64 {
        match self {
            Self::Pixel { .. } => noise.marker_px,
            Self::Point { .. } => noise.point_m,
        }
    }
}

/// One frame's observations.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FrameData {
    /// Board corners in the mirror: index and pixel.
    pub corners: Vec<(usize, Vector2<f64>)>,
    pub others: Vec<Observation>,
}

/// A corner that is left out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FalseCorner {
    pub frame: usize,
    pub index: usize,
    /// How far off it was, in deviations of the noise.
    pub deviations: f64,
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
    /// What slipped in the middle of the session.
    pub slips: Vec<Slip>,
    /// Free parameters of gross mistakes.
    pub mistake_parameters: Vec<MistakeParameter>,
    /// How the base yields on this session's ground, where that is fitted: parameters of every model, with their priors' deviations.
    pub ground: Vec<(Column, f64)>,
    pub camera: Option<Camera>,
    pub refractive_index: f64,
    /// The link (or the root, for an unknown frame) in whose frame measured points are given.
    pub points_site: Option<Site>,
    /// Start of the pose of the root in the unknown frame.
    pub unknown_frame: Option<Pose>,
    pub noise: Noise,
    /// Whether the session states the noise of its measured points.
    pub point_noise_stated: bool,
    /// What the session states of its mounts.
    pub tolerances: Tolerances,
    /// Each frame's mirror as the board shows it with nominal optics; none where too few corners were seen.
    pub boards: Vec<Option<BoardFit>>,
    /// Corners that are left out because they lie beside the grid of the others.
    pub false_corners: Vec<FalseCorner>,
    /// Nodes that move board and camera against each other, those whose followers (mimic) do included.
    pub between_camera_and_board: Vec<usize>,
    /// Looked at whenever an eye is made, and in every frame that is evaluated.
    pub cancel: Cancel,
    /// Counts the evaluations.
    pub budget: WorkBudget,
    /// Told how far the search has come.
    pub progress: Progress,
}

impl Problem {
    /// The noise of the observations: of a marker's pixel where there are pictures (px), else of a measured point (m).
    pub fn of_observations(&self, noise: Noise) -> f64 {
        if self.camera.is_some() { noise.marker_px } else { noise.point_m }
    }

    /// Whether what an atom changes is as small as it can be: no pane is thinner than none.
    pub fn is_least(&self, atom: Atom) -> bool {
        matches!(atom, Atom::Glass) && self.scene.glass_thickness_m <= 0.0
    }

    /// A validated recording arranged, before anything is estimated: no frame's mirror is known yet, and the
    /// unknown frame of measured points is at the root ([`Problem::new`] estimates both).
    ///
    /// # Errors
    /// Unknown links.
    pub(super) fn arranged(robot: &Robot, recording: &Recording) -> Result<Self> {
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
        find_relevant(&mut scene, [camera_site, points_site], board, (&marker_sites, &marker_mounts));
        scene.tabulate_down(&marker_mounts);
        let between_camera_and_board = match (camera_site, board) {
            (Some(camera), Some(board)) => (0..scene.nodes())
                .filter(|&n| moves_against(Atom::Joint(n), &scene, camera.node, board.node))
                .collect(),
            _ => Vec::new(),
        };
        let frames: Vec<FrameData> = recording
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
        Ok(Self {
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
            slips: Vec::new(),
            mistake_parameters: Vec::new(),
            ground: Vec::new(),
            camera: sight.map(|s| s.camera.clone()),
            refractive_index: sight.map_or(1.52, |s| s.refractive_index),
            points_site,
            unknown_frame: unknown.then(Pose::identity),
            noise: Noise {
                corner_px: pixel_std,
                marker_px: pixel_std,
                point_m: recording.point_std_m.unwrap_or(5e-4),
            },
            point_noise_stated: recording.point_std_m.is_some(),
            tolerances: recording.tolerances.clone(),
            boards: Vec::new(),
            false_corners: Vec::new(),
            between_camera_and_board,
            cancel: Cancel::default(),
            budget: WorkBudget::of(recording.frames.len()),
            progress: Progress::default(),
            scene,
        })
    }

    /// Determines again which joints move the observed sites relative to the observer, because a marker is on
    /// another link than the model says.
    pub fn markers_moved(&mut self) {
        let observers = [self.camera_site, self.points_site];
        find_relevant(&mut self.scene, observers, self.board, (&self.marker_sites, &self.marker_mounts));
    }

    /// The nominal deformation of this recording.
    pub fn nominal(&self) -> Deformation {
        Deformation::nominal(self.scene.frames, self.scene.nodes(), self.marker_sites.len())
    }

    /// Whether a deformation changes how the board's corners are seen: its optics, or a joint between camera and board.
    pub fn needs_fresh_board(&self, deformation: &Deformation) -> bool {
        deformation.optics_differ()
            || self.moves_board_alone(deformation)
            || deformation.board_slips()
            || deformation.moves_any(&self.between_camera_and_board)
            || self.shifts_between(deformation)
    }

    /// Whether the camera is on the board's own body, so that both move with the board's mount.
    pub fn camera_beside_board(&self) -> bool {
        matches!((self.camera_site, self.board), (Some(camera), Some(board)) if camera.node == board.node)
    }

    fn moves_board_alone(&self, deformation: &Deformation) -> bool {
        deformation.board_mount != nalgebra::Vector6::zeros() && !self.camera_beside_board()
    }

    /// [`Problem::needs_fresh_board`] for one frame, without looking at the others.
    pub fn needs_fresh_board_in(&self, deformation: &Deformation, frame: usize) -> bool {
        deformation.optics_differ()
            || self.moves_board_alone(deformation)
            || deformation.board_slip(frame).is_some()
            || self.shifts_between(deformation)
            || self.between_camera_and_board.iter().any(|&n| deformation.moves_in(frame, n))
    }

    /// Whether the origin of a joint between camera and board is shifted, by what carries it.
    fn shifts_between(&self, deformation: &Deformation) -> bool {
        let nodes = self.scene.nodes();
        self.between_camera_and_board.iter().any(|&n| {
            let carrier = self.scene.body.nodes[n].parent.unwrap_or(nodes);
            deformation.shifts_joints_of(carrier)
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

    /// Whether an atom's node or marker exists here.
    pub fn has_atom(&self, atom: Atom) -> bool {
        match atom {
            Atom::Joint(n)
            | Atom::Tilt(n, _)
            | Atom::Bend(n)
            | Atom::Beam(n)
            | Atom::Turn(n, _)
            | Atom::Across(n, _)
            | Atom::Rock(n, _)
            | Atom::Sag(n, _)
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

fn find_relevant(
    scene: &mut Scene,
    observers: [Option<Site>; 2],
    board: Option<Site>,
    (markers, mounts): (&[Site], &[Site]),
) {
    let observers: Vec<Option<usize>> = observers.iter().flatten().map(|s| s.node).collect();
    let targets: Vec<Option<usize>> = markers.iter().chain(&board).map(|s| s.node).collect();
    let others = mounts.iter().chain([&scene.body.root]).map(|s| s.node);
    let all: Vec<Option<usize>> = observers.iter().chain(&targets).copied().chain(others).collect();
    scene.posed = (0..scene.nodes()).map(|n| all.iter().any(|&site| scene.body.carries(n, site))).collect();
    scene.find_relevant(&observers, &targets, markers);
}
