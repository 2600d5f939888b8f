//! The input of the joint estimator, validated once.

use crate::cancel::Cancel;
use crate::error::{Error, Result, finite, is_symmetric, positive};
use crate::mirror::Via;
use crate::mirror::{BoardView, Loss, MirrorOptics, Sphere};
use nalgebra::{Isometry3, Matrix6, Vector2};

/// A marker seen in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MarkerSighting {
    /// Which marker, from 0.
    pub marker: usize,
    /// The centroid of its picture (u, v), px.
    pub pixel: Vector2<f64>,
    /// By the mirror or straight.
    pub via: Via,
}

/// One picture: the board's reflection and the markers in it.
#[derive(Debug, Clone, PartialEq)]
pub struct JointFrame {
    /// Frames with the same number show the same body posture, so the markers stand still between them in the camera frame.
    pub posture: i64,
    /// The model's camera–board transform in this frame (a head that turns between postures changes it).
    pub nominal_camera_from_board: Isometry3<f64>,
    /// The board's corners, as reflected, with their true labels.
    pub corners: BoardView,
    /// The markers.
    pub markers: Vec<MarkerSighting>,
}

/// Camera–board transforms of one posture's views that differ by more than this (matrix elements; m, or rad) belong to a head that moved.
const SAME_HEAD: f64 = 1e-6;

impl JointFrame {
    /// Refuses a view of the same posture in which the model has the head elsewhere: markers would not stand still in the camera frame.
    pub(crate) fn check_same_head(&self, other: &Self) -> Result<()> {
        let moved = other.nominal_camera_from_board.to_homogeneous()
            - self.nominal_camera_from_board.to_homogeneous();
        // Written so that NaN fails the test.
        if moved.amax() <= SAME_HEAD {
            return Ok(());
        }
        Err(Error::HeadMoved { posture: other.posture, by: moved.amax() })
    }
}

/// The prior knowledge of the camera–board transform.
// One for each session, so its size does not matter; it can be copied.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum BoardPrior {
    /// It is exactly the nominal one.
    Exact,
    /// The nominal one has this covariance, in the tangent (rotation rad, translation m) of
    /// [`crate::geometry::rotation::moved`], on the board's side, at the first frame.
    Covariance(Matrix6<f64>),
    /// Nothing: the views alone determine it (three or more that differ in yaw and pitch).
    Unknown,
}

/// What the joint estimator assumes, and when it stops.
#[derive(Debug, Clone, PartialEq)]
pub struct JointOptions {
    /// Glass and curvature of the mirror.
    pub optics: MirrorOptics,
    /// Standard deviation of a board corner, px, one axis.
    pub corner_std_px: f64,
    /// Standard deviation of a marker's centre, px, one axis.
    pub marker_std_px: f64,
    /// How residuals count.
    pub loss: Loss,
    /// The prior of the camera–board transform.
    pub prior: BoardPrior,
    /// Two rays must differ at least by this, rad, for their marker to be estimated.
    pub least_parallax_rad: f64,
    /// Most Gauss–Newton steps.
    pub most_steps: usize,
    /// It stops when a step is predicted to lower χ² by less than this (1e-6 of a degree of freedom is nothing).
    pub least_decrease: f64,
    /// Looked at in every frame of every step.
    pub cancel: Cancel,
}

impl Default for JointOptions {
    /// An ideal mirror, 0.2 px, a prior of 1° and 2 mm (one axis) on the camera–board transform, Huber's loss at 3 σ (of
    /// two-dimensional normal residuals it touches one in a hundred).
    fn default() -> Self {
        Self {
            optics: MirrorOptics::IDEAL,
            corner_std_px: 0.2,
            marker_std_px: 0.2,
            loss: Loss::Huber { threshold: 3.0 },
            prior: BoardPrior::isotropic(1.0_f64.to_radians(), 0.002),
            least_parallax_rad: 0.5_f64.to_radians(),
            most_steps: 100,
            least_decrease: 1e-9,
            cancel: Cancel::default(),
        }
    }
}

impl BoardPrior {
    /// Independent standard deviations, rad and m, the same about each axis.
    pub fn isotropic(rotation_std_rad: f64, translation_std_m: f64) -> Self {
        let mut covariance = Matrix6::zeros();
        for i in 0..3 {
            covariance[(i, i)] = rotation_std_rad * rotation_std_rad;
            covariance[(i + 3, i + 3)] = translation_std_m * translation_std_m;
        }
        Self::Covariance(covariance)
    }

    /// The information matrix of the prior; none where it is exact.
    pub(super) fn information(&self) -> Result<Option<Matrix6<f64>>> {
        match self {
            Self::Exact => Ok(None),
            Self::Unknown => Ok(Some(Matrix6::zeros())),
            Self::Covariance(covariance) => {
                let factor = covariance.cholesky().filter(|_| is_symmetric(covariance));
                factor.map(|f| Some(f.inverse())).ok_or_else(|| Error::OutOfRange {
                    what: "determinant of the prior covariance of the camera-board transform".into(),
                    got: covariance.determinant(),
                    needed: "a symmetric positive definite 6x6 matrix (rad and m, rotation first)".into(),
                })
            }
        }
    }
}

/// Why a marker of a posture has no position, or that it has.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PointStatus {
    /// It has.
    Measured,
    /// Fewer than two views.
    TooFewViews {
        /// How many there were.
        views: usize,
    },
    /// The rays are too close to parallel.
    TooLittleParallax {
        /// The widest angle between two of the rays, rad.
        got_rad: f64,
        /// The least that is accepted, rad.
        needed_rad: f64,
    },
    /// The rays meet where no marker can be: behind a mirror or behind the camera.
    WrongSide,
    /// A pixel has no ray: beyond where the lens model can be inverted, or its ray misses the mirror.
    NoRay {
        /// The frame of that pixel, from 0.
        frame: usize,
    },
}

/// One marker of one posture, and who sees it.
pub(super) struct PointViews {
    pub posture: usize,
    pub marker: usize,
    pub views: Vec<PointView>,
}

pub(super) struct PointView {
    pub frame: usize,
    pub pixel: Vector2<f64>,
    pub via: Via,
}

/// The frames and points sorted by posture.
pub(super) struct Layout {
    /// Posture number of each group, ascending.
    pub postures: Vec<i64>,
    /// Frames of each posture.
    pub frames_of: Vec<Vec<usize>>,
    /// All (posture, marker) that any frame sees, by posture, then marker.
    pub points: Vec<PointViews>,
}

impl Layout {
    pub fn new(frames: &[JointFrame], marker_count: usize) -> Result<Self> {
        if frames.is_empty() {
            return Err(Error::LengthMismatch { what: "frames (at least)".into(), got: 0, needed: 1 });
        }
        let mut postures: Vec<i64> = frames.iter().map(|f| f.posture).collect();
        postures.sort_unstable();
        postures.dedup();
        let mut frames_of: Vec<Vec<usize>> = vec![Vec::new(); postures.len()];
        let mut slots: Vec<Vec<PointView>> = Vec::new();
        slots.resize_with(postures.len() * marker_count, Vec::new);
        for (index, frame) in frames.iter().enumerate() {
            let group = postures.partition_point(|p| *p < frame.posture);
            if let Some(&first) = frames_of[group].first() {
                frames[first].check_same_head(frame)?;
            }
            frames_of[group].push(index);
            for sight in &frame.markers {
                if sight.marker >= marker_count {
                    return Err(Error::OutOfRange {
                        what: format!("marker of frame {index}"),
                        got: sight.marker as f64,
                        needed: format!("0 to {} ({marker_count} markers)", marker_count.saturating_sub(1)),
                    });
                }
                finite(&format!("u of marker {} in frame {index} (px)", sight.marker), sight.pixel.x)?;
                finite(&format!("v of marker {} in frame {index} (px)", sight.marker), sight.pixel.y)?;
                slots[group * marker_count + sight.marker].push(PointView {
                    frame: index,
                    pixel: sight.pixel,
                    via: sight.via,
                });
            }
        }
        let points = slots
            .into_iter()
            .enumerate()
            .filter(|(_, views)| !views.is_empty())
            .map(|(slot, views)| PointViews {
                posture: slot / marker_count,
                marker: slot % marker_count,
                views,
            })
            .collect();
        Ok(Self { postures, frames_of, points })
    }
}

impl JointOptions {
    pub(super) fn validated(&self) -> Result<()> {
        positive("standard deviation of a board corner (px)", self.corner_std_px)?;
        positive("standard deviation of a marker (px)", self.marker_std_px)?;
        positive("least parallax (rad)", self.least_parallax_rad)?;
        self.loss.validated()?;
        Ok(())
    }
}

/// Spheres of markers by diameter, m.
pub(super) fn spheres(diameters_m: &[f64]) -> Result<Vec<Sphere>> {
    diameters_m.iter().map(|d| Sphere::of_diameter_m(*d)).collect()
}
