//! The recording, validated: the input of the diagnosis.

use crate::camera::Camera;
use crate::error::{Error, Result, finite, not_negative, positive};
pub use crate::mirror::Via;
use nalgebra::{Point3, Vector2, Vector3};

/// What was seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// Corner of the board, by its index `iy * nx + ix`.
    Corner(usize),
    /// A marker, by its index.
    Marker(usize),
}

/// One image point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// What.
    pub target: Target,
    /// How.
    pub via: Via,
    /// Where, px.
    pub pixel: Vector2<f64>,
}

/// One measured marker position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasuredPoint {
    /// Index of the marker.
    pub marker: usize,
    /// Position in the session's points frame, m.
    pub position_m: Point3<f64>,
}

/// One row of `frames.csv` with all that was seen in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// The frame's number in the session.
    pub number: i64,
    /// Frames that share it have the same commanded posture.
    pub posture: i64,
    /// Seconds since the session's start; the frame's number where no time is given.
    pub time_s: f64,
    /// Commanded position of each of the robot's independent joints, rad or m.
    pub commanded: Vec<f64>,
    /// Image points.
    pub sightings: Vec<Sighting>,
    /// Measured marker positions.
    pub points: Vec<MeasuredPoint>,
}

/// A marker of the session.
#[derive(Debug, Clone, PartialEq)]
pub struct MarkerSpec {
    /// Its name in the session.
    pub name: String,
    /// The URDF link whose origin is its centre.
    pub link: String,
    /// Diameter of the ball, m; 0 is an ideal point.
    pub diameter_m: f64,
    /// Whether its place on its link is given; otherwise it is estimated.
    pub mount_known: bool,
}

/// The chessboard on the robot.
#[derive(Debug, Clone, PartialEq)]
pub struct BoardSpec {
    /// The URDF link in whose origin its centre lies.
    pub link: String,
    /// Inner corners along x and y.
    pub corners: (usize, usize),
    /// Edge of a square, m.
    pub square_m: f64,
}

/// Camera, board and mirror of a session that was seen through a camera.
#[derive(Debug, Clone, PartialEq)]
pub struct SightSpec {
    /// Intrinsics and lens as the model has them.
    pub camera: Camera,
    /// The URDF link whose frame is the camera's optical frame.
    pub camera_link: String,
    /// The board, where the session has one.
    pub board: Option<BoardSpec>,
    /// Thickness of the pane that the model assumes, m; 0 is a front-surface mirror.
    pub glass_thickness_m: f64,
    /// Refractive index of the pane.
    pub refractive_index: f64,
}

/// The frame of the measured points.
#[derive(Debug, Clone, PartialEq)]
pub enum PointsFrame {
    /// A link of the robot.
    Link(String),
    /// A fixed frame whose pose is estimated.
    Unknown,
}

/// Tolerance of a mount: one standard deviation by which its real place may differ from the URDF's. None means that
/// it is estimated from the data; 0 is exact.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tolerance {
    /// Of its place along each axis, m.
    pub shift_m: Option<f64>,
    /// Of its rotation about each axis, rad; a marker has none.
    pub turn_rad: Option<f64>,
}

/// What a session states of its mounts.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Tolerances {
    /// Of the board on its link.
    pub board: Tolerance,
    /// Of the camera.
    pub camera: Tolerance,
    /// Of each marker on its link, in their order; missing ones are estimated.
    pub markers: Vec<Tolerance>,
}

/// A whole session, the input of the diagnosis.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// The link that stands still and in which gravity is constant.
    pub root_link: String,
    /// Gravity in that link's frame, m/s².
    pub gravity: Vector3<f64>,
    /// Camera, board and mirror.
    pub sight: Option<SightSpec>,
    /// The markers.
    pub markers: Vec<MarkerSpec>,
    /// How exactly board, camera and markers were mounted.
    pub tolerances: Tolerances,
    /// Frame of the measured points.
    pub points_frame: Option<PointsFrame>,
    /// The robot's independent joints that have a column in the log, as indices and in the log's order; empty if that
    /// is not known. Columns that are shifted by one place move from neighbour to neighbour in this order.
    pub columns: Vec<usize>,
    /// Whether the rows are in the order of execution; otherwise the direction of motion is unknown.
    pub ordered: bool,
    /// Whether `time_s` was recorded (otherwise it is the frame's number).
    pub timed: bool,
    /// The session's noise of image points, px (one axis).
    pub pixel_std_px: Option<f64>,
    /// The session's noise of measured points, m (one axis).
    pub point_std_m: Option<f64>,
    /// The frames, in the session's order.
    pub frames: Vec<Frame>,
}

impl Recording {
    /// Checks what the kernels rely on: finite numbers, positive noise and sizes, indices in range.
    ///
    /// # Errors
    /// Names the frame and what is wrong with it.
    pub fn validated(self, positions: usize) -> Result<Self> {
        if self.frames.is_empty() {
            return Err(Error::TooFew { what: "frames of the session".into(), got: 0, needed: 1 });
        }
        for (axis, value) in ["x", "y", "z"].iter().zip(self.gravity.iter()) {
            finite(&format!("gravity {axis} (m/s^2)"), *value)?;
        }
        if let Some(board) = self.sight.as_ref().and_then(|s| s.board.as_ref()) {
            positive("edge of the board's squares (m)", board.square_m)?;
        }
        let corners = self
            .sight
            .as_ref()
            .and_then(|s| s.board.as_ref())
            .map_or(0, |b| b.corners.0.saturating_mul(b.corners.1));
        self.check_sizes()?;
        for joint in &self.columns {
            check_index("joint of a column of the log", *joint, positions)?;
        }
        for frame in &self.frames {
            let of = |what: &str| format!("frame {}: {what}", frame.number);
            if frame.commanded.len() != positions {
                return Err(Error::LengthMismatch {
                    what: of("commanded positions"),
                    got: frame.commanded.len(),
                    needed: positions,
                });
            }
            for value in &frame.commanded {
                finite(&of("commanded position"), *value)?;
            }
            finite(&of("time_s"), frame.time_s)?;
            for sighting in &frame.sightings {
                finite(&of("u"), sighting.pixel.x)?;
                finite(&of("v"), sighting.pixel.y)?;
                let (what, got, count) = match sighting.target {
                    Target::Corner(i) => ("board corner index", i, corners),
                    Target::Marker(i) => ("marker index", i, self.markers.len()),
                };
                check_index(&of(what), got, count)?;
            }
            for point in &frame.points {
                check_index(&of("marker index"), point.marker, self.markers.len())?;
                for value in point.position_m.iter() {
                    finite(&of("measured position"), *value)?;
                }
            }
        }
        Ok(self)
    }

    /// Noise is above 0; diameters, panes and tolerances are 0 or above.
    fn check_sizes(&self) -> Result<()> {
        for (what, std) in [("noise (px)", self.pixel_std_px), ("noise (m)", self.point_std_m)] {
            std.map(|std| positive(what, std)).transpose()?;
        }
        if let Some(sight) = &self.sight {
            not_negative("thickness of the pane (m)", sight.glass_thickness_m)?;
            positive("refractive index of the pane", sight.refractive_index)?;
        }
        for marker in &self.markers {
            not_negative(&format!("diameter of marker {} (m)", marker.name), marker.diameter_m)?;
        }
        let mounts = [&self.tolerances.board, &self.tolerances.camera];
        for of in mounts.into_iter().chain(&self.tolerances.markers) {
            of.shift_m.map(|std| not_negative("tolerance of a mount (m)", std)).transpose()?;
            of.turn_rad.map(|std| not_negative("tolerance of a mount (rad)", std)).transpose()?;
        }
        Ok(())
    }
}

fn check_index(what: &str, got: usize, count: usize) -> Result<()> {
    if got < count {
        return Ok(());
    }
    Err(Error::OutOfRange { what: what.to_owned(), got: got as f64, needed: format!("below {count}") })
}
