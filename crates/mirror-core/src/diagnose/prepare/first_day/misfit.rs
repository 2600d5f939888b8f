//! A robust loss: how far the markers are from where a set of positions puts them.
//!
//! Each observation's distance r (an image point's residual at the depth of what it shows, m; a measured point's as
//! it is) counts `ln(1 + (r/s)²)`, with s the size of the errors of mounts by hand and of small causes. So each part
//! of the session that a transformation corrects counts, however wrong the rest is. Mirrors are taken from the
//! boards.

use super::kept_poses::{Kept, KeptPoses};
use super::placed::{Placed, PointSeen};
use super::variant::Variant;
use crate::diagnose::data::recording::Via;
use crate::diagnose::effects::hypothesis::UNKNOWN_STD;
use crate::diagnose::model::body::Site;
use crate::diagnose::model::camera_and_mirror::Eye;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::frame::FrameWork;
use crate::diagnose::model::pose::Pose;
use crate::diagnose::model::problem::{BoardFit, Observation, Problem, Seen};
use crate::diagnose::model::work_budget::Effort;
use crate::diagnose::principles::{FAR_DEVIATIONS, FEWEST_OBSERVATIONS, Prior, Size, Threshold};
use crate::error::Result;
use nalgebra::{Point3, Vector3};
use std::sync::Mutex;

/// Size of the errors of mounts by hand and of small causes, as a share of the reach; and its bounds, m.
const USUAL_SHARE: Prior = 0.03;
const USUAL_BOUNDS_M: (f64, f64) = (0.006, 0.03);
/// Factor by which the mean loss must fall with each mistake. If little is left and the verification decides, a
/// quarter of it.
pub(super) const LEAST_FALL: Threshold = 0.03;
/// A mean loss below this is that of small errors: nothing is gross.
pub(super) const GROSS: Threshold = 0.12;
/// Number of mirrors that are cached for a frame: chains of mistakes need the same positions between camera and
/// board repeatedly.
const MOST_REMEMBERED: Size = 64;

/// Positions between camera and board and the squares' size, each less the nominal one, and what the board then shows.
type Remembered = Vec<(Vec<f64>, Option<SeenBoard>)>;

/// The mirror that a board shows, and how far its corners are from it, m.
#[derive(Debug, Clone, Copy)]
pub(super) struct SeenBoard {
    pub foot: Vector3<f64>,
    pub size_m: f64,
}

impl SeenBoard {
    fn of(fit: &BoardFit, focal_px: f64) -> Self {
        let rms_px = (fit.chi2_px2 / fit.corners.max(1) as f64).sqrt();
        // The board appears as far behind the mirror as it is in front of it.
        Self { foot: fit.foot, size_m: rms_px * 2.0 * fit.foot.norm() / focal_px }
    }
}

/// The distance of one observation, m.
#[derive(Debug, Clone, Copy)]
pub(super) struct Distance {
    pub frame: usize,
    pub marker: usize,
    pub size_m: f64,
}

/// Predicts markers at given positions.
pub(super) struct Misfit<'a> {
    problem: &'a Problem,
    eye: Option<Eye>,
    /// The known deformation of the nominal model.
    known: Deformation,
    /// What the boards show at the recorded positions.
    boards: Vec<Option<SeenBoard>>,
    /// Whether a board counts as an observation: where no mirror explains some, a joint between it and the camera may be
    /// elsewhere.
    with_boards: bool,
    /// Of each frame, the mirrors at other positions.
    at_others: Vec<Mutex<Remembered>>,
    /// Of each frame, the poses computed last.
    kept: KeptPoses,
    /// Size of usual errors, m.
    pub usual_m: f64,
}

impl<'a> Misfit<'a> {
    /// Of a problem whose boards are fitted, at the nominal model.
    ///
    /// # Errors
    /// Invalid parameters of camera or mirror.
    pub fn new(problem: &'a Problem) -> Result<Self> {
        let (reach, known) = (problem.scene.reach_m, problem.nominal());
        let eye = problem.eye(&known)?;
        let focal_px = eye.as_ref().map_or(1.0, |eye| eye.nominal_focal.x);
        Ok(Self {
            eye,
            known,
            boards: problem.boards.iter().map(|b| b.as_ref().map(|b| SeenBoard::of(b, focal_px))).collect(),
            with_boards: false,
            at_others: problem.boards.iter().map(|_| Mutex::default()).collect(),
            kept: KeptPoses::none(problem),
            usual_m: (USUAL_SHARE * reach).clamp(USUAL_BOUNDS_M.0, USUAL_BOUNDS_M.1),
            problem,
        })
    }

    /// The same beside a known deformation.
    ///
    /// # Errors
    /// Invalid parameters of camera or mirror.
    pub fn given(problem: &'a Problem, known: &Deformation) -> Result<Self> {
        let mut out = Self { eye: problem.eye(known)?, known: known.clone(), ..Self::new(problem)? };
        if problem.needs_fresh_board(known) {
            let mut work = FrameWork::rough(problem);
            let focal_px = out.focal_px();
            for (frame, board) in out.boards.iter_mut().enumerate() {
                *board = board.and_then(|nominal| {
                    let fit = work.fit_board(problem, known, out.eye.as_ref(), frame, Some(nominal.foot))?;
                    Some(SeenBoard::of(&fit, focal_px))
                });
            }
        }
        Ok(out)
    }

    /// The same if causes are known already: most observations are then within usual errors.
    ///
    /// # Errors
    /// Invalid parameters of camera or mirror.
    pub fn beside(problem: &'a Problem, known: &Deformation, variant: &Variant) -> Result<Self> {
        let mut out = Self::given(problem, known)?;
        let all: Vec<usize> = (0..problem.frames.len()).collect();
        let mut sizes: Vec<f64> = out.distances(variant, &all).iter().map(|d| d.size_m).collect();
        sizes.sort_by(f64::total_cmp);
        if let Some(median) = sizes.get(sizes.len() / 2) {
            out.usual_m = out.usual_m.min(FAR_DEVIATIONS * median);
        }
        Ok(out)
    }

    /// The same with each board as one further observation.
    pub fn with_boards(self) -> Self {
        Self { with_boards: true, ..self }
    }

    /// Memory for this.
    pub fn work(&self) -> Work {
        let nodes = self.problem.scene.nodes();
        // A rough fit of a board does not show whether a mirror explains it.
        let frame = if self.with_boards { FrameWork::new } else { FrameWork::rough }(self.problem);
        Work { positions: vec![0.0; nodes], frame, moved: None, placed: None }
    }

    fn focal_px(&self) -> f64 {
        self.eye.as_ref().map_or(1.0, |eye| eye.nominal_focal.x)
    }

    /// The loss of a distance.
    pub fn loss(&self, size_m: f64) -> f64 {
        (size_m / self.usual_m).powi(2).ln_1p()
    }

    /// Mean loss over some frames; infinite where they show nothing.
    pub fn mean_loss(&self, variant: &Variant, frames: &[usize]) -> f64 {
        self.mean_losses(variant, frames).0
    }

    /// The mean loss over some frames, and that of the marker which has the largest: one of several may be wrong alone.
    pub fn mean_losses(&self, variant: &Variant, frames: &[usize]) -> (f64, f64) {
        self.mean_losses_below(variant, frames, f64::INFINITY)
    }

    /// The same if the mean loss is below a limit. Else infinite, mostly known after a few frames: losses are never
    /// negative, and no more observations follow than there are.
    pub fn mean_losses_below(&self, variant: &Variant, frames: &[usize], limit: f64) -> (f64, f64) {
        if self.problem.cancel.is_cancelled() {
            return (f64::INFINITY, f64::INFINITY);
        }
        // The last one is the board's.
        let mut sums = vec![(0.0, 0.0); self.problem.marker_sites.len() + 1];
        let mut add = |marker: usize, size_m: f64| {
            let loss = self.loss(size_m);
            sums[marker].0 += loss;
            sums[marker].1 += 1.0;
            loss
        };
        if self.problem.unknown_frame.is_some() {
            for d in self.distances_in_unknown_frame(variant, frames) {
                add(d.marker, d.size_m);
            }
        } else {
            let boards = if self.with_boards { frames.len() } else { 0 };
            let most = boards + frames.iter().map(|&f| self.problem.frames[f].others.len()).sum::<usize>();
            let (mut total, mut work) = (0.0, self.work());
            for &frame in frames {
                self.of_frame(&mut work, variant, frame, |marker, size_m| total += add(marker, size_m));
                if total > limit * most as f64 {
                    return (f64::INFINITY, f64::INFINITY);
                }
            }
        }
        let count: f64 = sums.iter().map(|s| s.1).sum();
        if count == 0.0 {
            return (f64::INFINITY, f64::INFINITY);
        }
        let often_seen = sums.iter().filter(|s| s.1 >= FEWEST_OBSERVATIONS as f64);
        let worst = often_seen.map(|s| s.0 / s.1).fold(0.0, f64::max);
        (sums.iter().map(|s| s.0).sum::<f64>() / count, worst)
    }

    /// Distances of all observations of markers in some frames.
    pub fn distances(&self, variant: &Variant, frames: &[usize]) -> Vec<Distance> {
        if self.problem.unknown_frame.is_some() {
            return self.distances_in_unknown_frame(variant, frames);
        }
        let mut out = Vec::new();
        let mut work = self.work();
        for &frame in frames {
            self.of_frame(&mut work, variant, frame, |marker, size_m| {
                if marker < self.problem.marker_sites.len() {
                    out.push(Distance { frame, marker, size_m });
                }
            });
        }
        out
    }

    /// Sum of the losses of each frame, and the number of its observations.
    pub fn frame_losses(&self, variant: &Variant) -> Vec<(f64, usize)> {
        let all: Vec<usize> = (0..self.problem.frames.len()).collect();
        let mut out = vec![(0.0, 0); all.len()];
        let mut add = |frame: usize, size_m: f64| {
            out[frame].0 += self.loss(size_m);
            out[frame].1 += 1;
        };
        if self.problem.unknown_frame.is_some() {
            self.distances_in_unknown_frame(variant, &all).iter().for_each(|d| add(d.frame, d.size_m));
        } else {
            let mut work = self.work();
            for frame in all {
                self.of_frame(&mut work, variant, frame, |_, size_m| add(frame, size_m));
            }
        }
        out
    }

    /// Passes each observation's marker and distance of one frame on; of the board the number of markers.
    pub fn of_frame(
        &self,
        work: &mut Work,
        variant: &Variant,
        frame: usize,
        mut with: impl FnMut(usize, f64),
    ) {
        let problem = self.problem;
        let (camera_from_world, board, kept) = self.pose_sites(work, variant, frame);
        let foot = board.map(|board| board.foot);
        if self.with_boards && !problem.frames[frame].corners.is_empty() {
            with(problem.marker_sites.len(), board.map_or(UNKNOWN_STD, |board| board.size_m));
        }
        for observation in &problem.frames[frame].others {
            match observation {
                Observation::Pixel { seen: Seen::Marker(m), via, pixel } => {
                    let (Some(eye), Some(camera_from_world)) = (&self.eye, &camera_from_world) else {
                        continue;
                    };
                    if *via == Via::Mirror && foot.is_none() {
                        continue;
                    }
                    let m = variant.labels[frame][*m];
                    let point = camera_from_world.point(&self.marker(&work.frame, variant, frame, m));
                    let by = foot.filter(|_| *via == Via::Mirror);
                    with(m, image_distance(eye, by.as_ref(), &point, pixel).unwrap_or(UNKNOWN_STD));
                }
                Observation::Pixel { .. } => {}
                Observation::Point { marker, position } => {
                    if let Some(placed) = &work.placed {
                        let point = self.point(&work.frame, variant, frame, *marker, *position);
                        with(point.marker, placed.distance(&point));
                        continue;
                    }
                    let Some(site) = problem.points_site else { continue };
                    let marker = variant.labels[frame][*marker];
                    let point = self.marker(&work.frame, variant, frame, marker);
                    let observer = work.frame.world_from_site(&site);
                    with(marker, (variant.measured(*position) - observer.inverse_point(&point)).norm());
                }
            }
        }
        self.kept.keep(&mut work.frame, frame, kept);
    }

    /// Poses a frame: afterwards all nodes' poses are in `work`; returns the world in the camera's frame, and the mirror as the board shows it.
    pub fn pose(
        &self,
        work: &mut Work,
        variant: &Variant,
        frame: usize,
    ) -> (Option<Pose>, Option<SeenBoard>) {
        let board = self.board(work, variant, frame);
        variant.nodes(&self.problem.scene.body, frame, &mut work.positions);
        work.frame.pose_as(self.problem, &self.known, frame, &work.positions);
        (self.camera_from_world(work), board)
    }

    /// As [`Misfit::pose`], only the nodes that the variant's markers and the session's other sites ride on, until what it returns last
    /// is kept.
    fn pose_sites(
        &self,
        work: &mut Work,
        variant: &Variant,
        frame: usize,
    ) -> (Option<Pose>, Option<SeenBoard>, Option<Kept>) {
        let in_place = |(site, own): (&Site, &Site)| site.node == own.node;
        // The session's own nodes are not those of a marker that is tried on another link.
        let elsewhere = !variant.sites.iter().zip(&self.problem.marker_sites).all(in_place);
        // A mirror that is fitted again poses the frame itself.
        let board = self.board(work, variant, frame);
        variant.nodes(&self.problem.scene.body, frame, &mut work.positions);
        let observations = self.problem.frames[frame].others.len();
        self.problem.budget.spend(Effort::Compared { observations });
        let at = (&self.known, frame);
        let kept = self.kept.pose(&mut work.frame, self.problem, at, &work.positions, elsewhere);
        (self.camera_from_world(work), board, kept)
    }

    /// The world in the camera's frame, as the frame was posed last.
    fn camera_from_world(&self, work: &Work) -> Option<Pose> {
        self.eye.as_ref().map(|eye| work.frame.camera_from_world(self.problem, eye))
    }

    /// Where a marker is, in the world, in the frame that was posed last.
    fn marker(&self, posed: &FrameWork, variant: &Variant, frame: usize, marker: usize) -> Vector3<f64> {
        let shift = self.known.marker_shift_in(frame, marker);
        let mount = posed.world_from_site(&self.problem.marker_mounts[marker]);
        posed.world_from_site(&variant.sites[marker]).t + mount.r * shift
    }

    /// The line of a pixel's points, camera frame: origin and unit direction.
    pub fn ray(
        &self,
        foot: Option<&Vector3<f64>>,
        pixel: &nalgebra::Vector2<f64>,
    ) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let eye = self.eye.as_ref()?;
        let direction = eye.camera.unproject(pixel).ok()?;
        match foot {
            Some(foot) => {
                let ray = eye.mirror.virtual_ray(&Problem::plane(foot)?, &direction).ok()?;
                Some((ray.origin.coords, ray.direction.into_inner()))
            }
            None => Some((Vector3::zeros(), direction.into_inner())),
        }
    }

    /// What the board of a frame shows. It depends on the size of its squares, and on the joints between camera and board.
    fn board(&self, work: &mut Work, variant: &Variant, frame: usize) -> Option<SeenBoard> {
        let known = self.boards[frame]?;
        let scene = &self.problem.scene;
        let between = &self.problem.between_camera_and_board;
        let larger = variant.squares - 1.0;
        let moved = between.iter().map(|&n| variant.node(&scene.body, frame, n) - scene.q(frame, n));
        let changes: Vec<f64> = moved.chain([larger]).collect();
        if changes.iter().all(|change| change.abs() <= 1e-9) {
            return Some(known);
        }
        if let Ok(remembered) = self.at_others[frame].lock()
            && let Some((_, board)) = remembered.iter().find(|(at, _)| *at == changes)
        {
            return *board;
        }
        let deformation = work.moved.get_or_insert_with(|| self.known.clone());
        for (&n, change) in between.iter().zip(&changes) {
            // A mimic joint follows the change of the one that leads it.
            let led = scene.body.nodes[n].follows.map_or(0.0, |(leader, factor)| {
                between.iter().zip(&changes).find(|(k, _)| **k == leader).map_or(0.0, |(_, by)| factor * by)
            });
            let wanted = self.known.joint_delta(frame, n) + change - led;
            deformation.add_joint_delta(frame, n, wanted - deformation.joint_delta(frame, n));
        }
        deformation.board_scale_error = self.known.board_scale_error + larger;
        let fit = work.frame.fit_board(self.problem, deformation, self.eye.as_ref(), frame, None);
        let board = fit.map(|fit| SeenBoard::of(&fit, self.focal_px()));
        if let Ok(mut remembered) = self.at_others[frame].lock()
            && remembered.len() < MOST_REMEMBERED
        {
            remembered.push((changes, board));
        }
        board
    }

    /// As [`Misfit::distances`], with robust estimates of the frame of the measured points and of unknown mounts.
    fn distances_in_unknown_frame(&self, variant: &Variant, frames: &[usize]) -> Vec<Distance> {
        let points = self.points(variant, frames);
        let placed = self.placed_by(&points);
        points
            .iter()
            .map(|p| Distance { frame: p.frame, marker: p.marker, size_m: placed.distance(p) })
            .collect()
    }

    /// The frame of measured points and unknown mounts, estimated from some frames; none where the session states
    /// them.
    pub fn placed(&self, variant: &Variant, frames: &[usize]) -> Option<Placed> {
        self.problem.unknown_frame.map(|_| self.placed_by(&self.points(variant, frames)))
    }

    /// The measured points of some frames.
    pub fn points(&self, variant: &Variant, frames: &[usize]) -> Vec<PointSeen> {
        let mut work = self.work();
        let mut out = Vec::new();
        for &frame in frames {
            let kept = self.pose_sites(&mut work, variant, frame).2;
            for observation in &self.problem.frames[frame].others {
                if let Observation::Point { marker, position } = observation {
                    out.push(self.point(&work.frame, variant, frame, *marker, *position));
                }
            }
            self.kept.keep(&mut work.frame, frame, kept);
        }
        out
    }

    fn point(
        &self,
        posed: &FrameWork,
        variant: &Variant,
        frame: usize,
        name: usize,
        position: Vector3<f64>,
    ) -> PointSeen {
        let marker = variant.labels[frame][name];
        let root = posed.world_from_site(&self.problem.scene.body.root).inverse();
        let mount = root.then(&posed.world_from_site(&self.problem.marker_mounts[marker]));
        let at = root.point(&self.marker(posed, variant, frame, marker));
        let position = variant.measured(position);
        PointSeen { frame, marker, position, local: mount.inverse_point(&at), mount }
    }

    /// The same from points.
    pub fn placed_by(&self, points: &[PointSeen]) -> Placed {
        self.problem.budget.spend(Effort::Compared { observations: points.len() });
        Placed::by(points, &self.problem.scene.mount_known, self.usual_m)
    }
}

/// Reusable memory.
pub(super) struct Work {
    positions: Vec<f64>,
    pub frame: FrameWork,
    moved: Option<Deformation>,
    /// The unknown frame of measured points, if it is taken as known.
    pub placed: Option<Placed>,
}

/// Distance of an image point from its prediction, at the depth of what it shows, m.
fn image_distance(
    eye: &Eye,
    foot: Option<&Vector3<f64>>,
    point: &Vector3<f64>,
    pixel: &nalgebra::Vector2<f64>,
) -> Option<f64> {
    let seen = match foot {
        Some(foot) => {
            let plane = Problem::plane(foot)?;
            eye.mirror.apparent_point(&plane, &Point3::from(*point)).ok()?
        }
        None => Point3::from(*point),
    };
    let at = eye.camera.project(&seen).ok()?;
    Some((pixel - at).norm() * seen.z / eye.nominal_focal.x)
}
