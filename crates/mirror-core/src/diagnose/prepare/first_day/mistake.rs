//! Gross mistakes of model or log: the name of each, and how it is undone exactly.

use super::exchanges::fewest;
use super::variant::{Variant, other_of};
use crate::camera::Camera;
use crate::diagnose::data::left_out::Reason;
use crate::diagnose::data::recording::{Recording, Target};
use crate::diagnose::model::body::{NodeId, Site};
use crate::diagnose::model::pose::Pose;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::model::slips::{Slip, Slipped};
use crate::diagnose::principles::{Guard, NEARLY_ALL};
use crate::error::Result;
use crate::robot::Robot;
use core::f64::consts::{FRAC_PI_2, PI, TAU};
use nalgebra::{Rotation3, Vector2, Vector3, Vector6};

/// What a column of another unit must be multiplied by: degrees, half turns, turns, tenths and hundredths of a degree, ticks of
/// common encoders, thousandths.
pub(super) const UNITS: [f64; 9] =
    [PI / 180.0, PI, TAU, PI / 1800.0, PI / 18000.0, TAU / 4096.0, TAU / 1024.0, TAU / 16384.0, 1e-3];

/// The same of a joint that slides: millimetres, centimetres, decimetres, and metres where the model has these.
pub(super) const LENGTH_UNITS: [f64; 6] = [1e-3, 1e-2, 0.1, 10.0, 100.0, 1000.0];

/// The unit that a column is in whose factor is this, within so much of it.
pub(crate) fn unit_near(factor: f64, within: f64) -> Option<f64> {
    UNITS.into_iter().find(|unit| (unit - factor).abs() < within)
}

/// Whether a factor is that of another unit.
pub(super) fn is_unit(factor: f64) -> bool {
    UNITS.contains(&factor) || LENGTH_UNITS.contains(&factor)
}

/// What a zero that changes from a row on is called within: it has no public name.
pub(crate) const ZERO_LOST: &str = "zero_lost";

/// A mistake, by indices of the robot's independent joints and of the recording's markers.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Mistake {
    /// The joint turns the other way.
    AxisSign { node: NodeId },
    /// Two columns, or two cables, changed places.
    JointsSwapped { joints: (usize, usize) },
    /// Several columns changed places, by exchanges one after the other: left and right, or all of a run moved on by one.
    ColumnsSwapped { pairs: Vec<(usize, usize)> },
    /// The column is in another unit: it must be multiplied by the factor.
    JointUnit { joint: usize, factor: f64 },
    /// As above, of all joints that turn; the columns of joints that slide are in another unit by themselves.
    AllUnits { turning: Vec<usize>, factor: f64 },
    /// A wrong zero too large for a small error, rad: added to the column.
    Zero { joint: usize, offset: f64 },
    /// The column contains earlier rows' positions, or by a negative number later ones; no joint means all.
    Late { joint: Option<usize>, rows: f64, kind: LateKind },
    /// The log stands still over a run of rows: the commands there are unknown.
    LogFrozen { joint: usize, first: usize, last: usize },
    /// The joint stands still over a run of rows, at this position.
    JointFrozen { joint: usize, first: usize, last: usize, position: f64 },
    /// The column is unrelated to the joint in these rows (ascending), so that its position there is unknown. No public
    /// name.
    ColumnLost { joint: usize, rows: Vec<usize> },
    /// The joint has another zero from a row on, rad or m: added to the column. No public name.
    ZeroLost { joint: usize, first: usize, offset: f64 },
    /// Two markers' names exchanged in these frames; `always`: in all that show one of them.
    MarkersSwapped { markers: (usize, usize), frames: Vec<usize>, always: bool },
    /// The camera's parameters are of another resolution: multiplied by the factor.
    Resolution { factor: f64, offset_px: Vector2<f64> },
    /// The picture is mirrored: 1 left and right, 2 up and down, 3 both.
    Flipped { flip: u8 },
    /// The measured points are in a left-handed frame: this coordinate has the wrong sign. In an unknown frame any one
    /// is as good as another.
    PointsMirrored { axis: usize },
    /// The board's squares are larger by this factor. It is searched for so that nothing else is taken for it, and
    /// left to the search, which finds it as `board_scale`.
    Squares { factor: f64 },
    /// The board's corners are counted from another corner: quarter turns.
    BoardTurned { quarters: u8 },
    /// The marker is fixed to another body, at this place in its frame, m.
    MarkerParent { marker: usize, node: Option<NodeId>, place: Vector3<f64> },
    /// Gravity has another direction: the rotation from the stated to the true direction, rad.
    Gravity { turn: Vector3<f64> },
    /// A marker, the board or the camera slipped; with the standard deviations of its motion.
    Slip { slip: Slip, std: Vector6<f64> },
    /// Rows that repeat the measurement of the row before them.
    Hung { first: usize, last: usize },
    /// A run of rows to be examined by [`crate::diagnose::prepare::row_slip`], not undone here.
    Rows { first: usize, last: usize, shift: i64 },
}

/// How a column is late.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LateKind {
    /// Each row of the log lies between the true positions of this and an earlier row.
    Blend,
    /// The true position lies between the log's rows.
    Follow,
}

/// Changes of one place during the session (a slip, and perhaps the way back) with their log odds, if any were found.
pub(super) type Changes = Option<(Vec<Mistake>, f64)>;

impl Mistake {
    /// Undoes it on the joints' positions, as far as it concerns them.
    pub(super) fn on_variant(&self, variant: &mut Variant) {
        let rows = &mut variant.positions;
        match *self {
            Self::AxisSign { node } => variant.signs[node] = -variant.signs[node],
            Self::JointsSwapped { joints: (a, b) } => rows.iter_mut().for_each(|row| row.swap(a, b)),
            Self::ColumnsSwapped { ref pairs } => {
                rows.iter_mut().for_each(|row| pairs.iter().for_each(|&(a, b)| row.swap(a, b)));
            }
            Self::JointUnit { joint, factor } => rows.iter_mut().for_each(|row| row[joint] *= factor),
            Self::AllUnits { ref turning, factor } => {
                rows.iter_mut().for_each(|row| turning.iter().for_each(|&j| row[j] *= factor));
            }
            Self::ZeroLost { joint, first, offset } => {
                rows.range_mut(first..rows.len()).for_each(|row| row[joint] += offset);
            }
            Self::Zero { joint, offset } => rows.iter_mut().for_each(|row| row[joint] += offset),
            Self::Late { joint, rows: late, kind } => {
                let joints: Vec<usize> = joint.map_or_else(|| (0..rows.width()).collect(), |j| vec![j]);
                for j in joints {
                    let column = in_time(&variant.column(j), late, kind);
                    variant.set_column(j, &column);
                }
            }
            Self::JointFrozen { joint, first, last, position } => {
                rows.range_mut(first..last + 1).for_each(|row| row[joint] = position);
            }
            Self::Rows { first, last, shift } => {
                let old = rows.clone();
                for f in first..=last {
                    let from = (f as i64 + shift).clamp(0, old.len() as i64 - 1) as usize;
                    rows[f].copy_from_slice(&old[from]);
                }
            }
            Self::MarkersSwapped { markers, ref frames, .. } => {
                frames.iter().for_each(|&f| variant.exchange_labels(f, markers));
            }
            Self::Squares { factor } => variant.squares *= factor,
            Self::PointsMirrored { axis } => variant.mirrored = Some(axis),
            Self::MarkerParent { marker, node, place } => {
                let r = variant.sites[marker].node_from_site.r;
                variant.sites[marker] = Site { node, node_from_site: Pose { r, t: place } };
            }
            _ => {}
        }
    }

    /// Undoes it in the recording, its robot included; data that are unknown after that are left out.
    ///
    /// # Errors
    /// A camera whose parameters would be invalid.
    pub fn undo(&self, robot: &mut Robot, problem: &Problem, recording: &mut Recording) -> Result<()> {
        match self {
            Self::AxisSign { node } => robot.reverse_axis(&problem.scene.body.nodes[*node].joint)?,
            Self::Resolution { factor, offset_px } => {
                if let Some(sight) = &mut recording.sight {
                    let c = &sight.camera;
                    sight.camera = Camera::new(
                        c.size_px(),
                        c.focal_px() * *factor,
                        scaled_center(&c.center_px(), *factor) + offset_px,
                        c.distortion(),
                    )?;
                }
            }
            Self::Squares { factor } => {
                if let Some(board) = recording.sight.as_mut().and_then(|s| s.board.as_mut()) {
                    board.square_m *= factor;
                }
            }
            Self::Flipped { flip } => flip_pictures(recording, *flip),
            Self::PointsMirrored { axis } => {
                for point in recording.frames.iter_mut().flat_map(|f| &mut f.points) {
                    point.position_m[*axis] = -point.position_m[*axis];
                }
            }
            Self::BoardTurned { quarters } => turn_board(recording, *quarters),
            Self::MarkersSwapped { markers, frames, .. } => {
                for &f in frames {
                    exchange(&mut recording.frames[f], *markers);
                }
            }
            Self::Gravity { turn } => recording.gravity = Rotation3::new(*turn) * recording.gravity,
            Self::Hung { first, last } => {
                for frame in &mut recording.frames[*first..=*last] {
                    frame.sightings.clear();
                    frame.points.clear();
                }
            }
            Self::MarkerParent { .. } | Self::Slip { .. } | Self::Rows { .. } | Self::ColumnLost { .. } => {}
            _ => {
                let mut variant = Variant::of(recording, problem);
                self.on_variant(&mut variant);
                for (frame, row) in recording.frames.iter_mut().zip(variant.positions.iter()) {
                    frame.commanded = row.to_vec();
                }
            }
        }
        for (frame, joint) in self.not_known(recording.frames.len()) {
            leave_out(problem, &mut recording.frames[frame], joint);
        }
        Ok(())
    }

    /// Undoes its part in the arranged problem: sites.
    ///
    /// # Errors
    /// Invalid parameters of camera or mirror.
    pub fn on_problem(&self, problem: &mut Problem) -> Result<()> {
        match self {
            Self::MarkerParent { marker, node, place } => {
                let turn = problem.marker_sites[*marker].node_from_site.r;
                let site = Site { node: *node, node_from_site: Pose { r: turn, t: *place } };
                problem.marker_sites[*marker] = site;
                problem.marker_mounts[*marker] = Site { node: *node, node_from_site: Pose::identity() };
                // The place on that link is unknown: this is the start of the search.
                problem.scene.mount_known[*marker] = false;
                problem.markers_moved();
            }
            Self::Slip { slip, .. } => {
                problem.slips.push(*slip);
                problem.fit_boards()?;
            }
            _ => {}
        }
        Ok(())
    }

    /// The one mistake that this and another one together are, if they are one: late by whole rows, and by a part
    /// of one; exchanges that fewer have the effect of.
    pub fn together(&self, other: &Self) -> Option<Self> {
        if let (Some(first), Some(then)) = (self.exchanges(), other.exchanges()) {
            let pairs = fewest(&[&first[..], &then[..]].concat());
            return match pairs[..] {
                [] => None,
                _ if pairs.len() >= first.len() + then.len() => None,
                [joints] => Some(Self::JointsSwapped { joints }),
                _ => Some(Self::ColumnsSwapped { pairs }),
            };
        }
        let (Self::Late { joint, rows: a, kind: of_a }, Self::Late { joint: its, rows: b, kind: of_b }) =
            (self, other)
        else {
            return None;
        };
        let kind = if a.fract() == 0.0 { *of_b } else { *of_a };
        let whole = a.fract() == 0.0 || b.fract() == 0.0;
        (whole && joint == its).then_some(Self::Late { joint: *joint, rows: a + b, kind })
    }

    /// The pairs of columns that changed places, one after the other.
    fn exchanges(&self) -> Option<Vec<(usize, usize)>> {
        match self {
            Self::JointsSwapped { joints } => Some(vec![*joints]),
            Self::ColumnsSwapped { pairs } => Some(pairs.clone()),
            _ => None,
        }
    }

    /// Whether nothing about it is found from the data but that it is there.
    pub fn has_no_number(&self) -> bool {
        match self {
            Self::AxisSign { .. }
            | Self::JointsSwapped { .. }
            | Self::ColumnsSwapped { .. }
            | Self::PointsMirrored { .. }
            | Self::AllUnits { .. } => true,
            Self::MarkersSwapped { always, .. } => *always,
            Self::JointUnit { factor, .. } => is_unit(*factor),
            Self::Zero { offset, .. } => (offset / FRAC_PI_2).fract() == 0.0,
            _ => false,
        }
    }

    /// The reason why data are left out when it is undone.
    pub fn takes_away_since(&self) -> Reason {
        match self {
            Self::Hung { .. } => Reason::Repeated,
            _ => Reason::PositionUnknown,
        }
    }

    /// Whether the public vocabulary has no name for it.
    pub fn has_no_word(&self) -> bool {
        matches!(self, Self::ColumnLost { .. } | Self::ZeroLost { .. })
    }

    /// Whether it is a slip of this.
    pub fn slips(&self, what: Slipped) -> bool {
        matches!(self, Self::Slip { slip, .. } if slip.what == what)
    }

    /// Its name in the public vocabulary.
    pub fn effect(&self) -> &'static str {
        match self {
            Self::AxisSign { .. } => "axis_sign",
            Self::JointsSwapped { .. } | Self::ColumnsSwapped { .. } => "joints_swapped",
            Self::JointUnit { .. } | Self::AllUnits { .. } => "joint_unit",
            Self::Zero { .. } => "joint_offset",
            Self::Late { .. } => "joint_late",
            Self::LogFrozen { .. } | Self::JointFrozen { .. } => "joint_frozen",
            // Without a public name: never reported as causes.
            Self::ColumnLost { .. } => "column_lost",
            Self::ZeroLost { .. } => ZERO_LOST,
            Self::MarkersSwapped { .. } => "markers_swapped",
            Self::Resolution { .. } => "camera_resolution",
            Self::Flipped { .. } => "picture_flipped",
            Self::PointsMirrored { .. } => "points_mirrored",
            Self::BoardTurned { .. } => "board_turned",
            Self::Squares { .. } => "board_scale",
            Self::MarkerParent { .. } => "marker_parent",
            Self::Gravity { .. } => "gravity_direction",
            Self::Slip { .. } => "slip",
            Self::Hung { .. } | Self::Rows { .. } => "pairing",
        }
    }

    /// Whether it is the same mistake, apart from its parameter.
    pub fn is_like(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::JointUnit { joint: a, .. }, Self::JointUnit { joint: b, .. })
            | (Self::Zero { joint: a, .. }, Self::Zero { joint: b, .. })
            | (Self::ZeroLost { joint: a, .. }, Self::ZeroLost { joint: b, .. })
            | (Self::LogFrozen { joint: a, .. }, Self::LogFrozen { joint: b, .. })
            | (Self::JointFrozen { joint: a, .. }, Self::JointFrozen { joint: b, .. }) => a == b,
            (Self::Late { joint: a, .. }, Self::Late { joint: b, .. }) => a == b,
            (Self::MarkersSwapped { markers: a, .. }, Self::MarkersSwapped { markers: b, .. }) => a == b,
            (Self::AllUnits { .. }, Self::AllUnits { .. })
            | (Self::Squares { .. }, Self::Squares { .. })
            | (Self::Rows { .. }, Self::Rows { .. }) => true,
            _ => self == other,
        }
    }

    /// Frames in which a joint's position is unknown even when the mistake is undone; none means all joints.
    pub(super) fn not_known(&self, frames: usize) -> Vec<(usize, Option<usize>)> {
        match *self {
            Self::LogFrozen { joint, first, last } => (first..=last).map(|f| (f, Some(joint))).collect(),
            Self::Late { joint, rows, kind } => {
                let lost = (rows.abs().ceil() as usize).min(frames);
                // Of an early column the positions of the first rows are not in the log.
                let (mut at_start, mut at_end) = if rows < 0.0 { (lost, 0) } else { (0, lost) };
                if kind == LateKind::Blend {
                    let part = rows - rows.floor();
                    let end = if part <= 0.5 { &mut at_start } else { &mut at_end };
                    *end = (*end).max(rows_of_decay(part, frames)).min(frames);
                }
                let end = (frames - at_end..frames).map(|f| (f, joint));
                (0..at_start).map(|f| (f, joint)).chain(end).collect()
            }
            _ => Vec::new(),
        }
    }
}

/// A share of the first position's error that changes nothing.
const OF_THE_START: Guard = 0.01;

/// Rows after which a mixture that was undone from one end is right: from row to row the error of the start shrinks by
/// `min(p, 1 − p) / max(p, 1 − p)`. Near a half it hardly shrinks: no more rows are given up than leave nearly all.
pub(super) fn rows_of_decay(part: f64, frames: usize) -> usize {
    let most = ((1.0 - NEARLY_ALL) * frames as f64) as usize;
    let ratio = part.min(1.0 - part) / part.max(1.0 - part);
    let rows = (OF_THE_START.ln() / ratio.ln()).ceil();
    if ratio < 1.0 { (rows as usize).min(most) } else { most }
}

/// The camera's centre at another resolution, as calibration files are scaled. Where pictures were resampled it is ½ (f − 1) px further:
/// that is left to `camera_center`.
pub(super) fn scaled_center(center: &Vector2<f64>, factor: f64) -> Vector2<f64> {
    center * factor
}

/// A late column put in time.
pub(super) fn in_time(column: &[f64], rows: f64, kind: LateKind) -> Vec<f64> {
    let count = column.len();
    let whole = rows.floor();
    let part = rows - whole;
    let shifted = |f: usize, by: i64| column[(f as i64 + by).clamp(0, count as i64 - 1) as usize];
    match kind {
        LateKind::Follow => (0..count)
            .map(|f| (1.0 - part) * shifted(f, whole as i64) + part * shifted(f, whole as i64 + 1))
            .collect(),
        LateKind::Blend => {
            let late: Vec<f64> = (0..count).map(|f| shifted(f, whole as i64)).collect();
            // An end from which it is undone starts at its own position.
            unblended(&late, part, column)
        }
    }
}

/// Solves `log_f = (1 − p) θ_f + p θ_{f−1}` from the end at which errors die out.
fn unblended(log: &[f64], part: f64, start: &[f64]) -> Vec<f64> {
    let mut out = start.to_vec();
    if part <= 0.5 {
        for f in 1..out.len() {
            out[f] = (log[f] - part * out[f - 1]) / (1.0 - part);
        }
    } else {
        for f in (1..out.len()).rev() {
            out[f - 1] = (log[f] - (1.0 - part) * out[f]) / part;
        }
    }
    out
}

fn exchange(frame: &mut crate::diagnose::data::recording::Frame, markers: (usize, usize)) {
    for sighting in &mut frame.sightings {
        if let Target::Marker(m) = &mut sighting.target {
            *m = other_of(markers, *m);
        }
    }
    for point in &mut frame.points {
        point.marker = other_of(markers, point.marker);
    }
}

fn flip_pictures(recording: &mut Recording, flip: u8) {
    let Some(sight) = &recording.sight else { return };
    let (w, h) = sight.camera.size_px();
    for sighting in recording.frames.iter_mut().flat_map(|f| &mut f.sightings) {
        let p = &mut sighting.pixel;
        if flip & 1 != 0 {
            p.x = f64::from(w) - 1.0 - p.x;
        }
        if flip & 2 != 0 {
            p.y = f64::from(h) - 1.0 - p.y;
        }
    }
}

/// The corner that one of the other numbering is.
pub(super) fn turned(index: usize, (nx, ny): (usize, usize), quarters: u8) -> usize {
    let (ix, iy) = (index % nx, index / nx);
    match quarters {
        2 => (ny - 1 - iy) * nx + (nx - 1 - ix),
        // By quarters the grid has as many corners along x as it had along y.
        1 => ix * ny + (ny - 1 - iy),
        3 => (nx - 1 - ix) * ny + iy,
        _ => index,
    }
}

fn turn_board(recording: &mut Recording, quarters: u8) {
    let Some(board) = recording.sight.as_mut().and_then(|s| s.board.as_mut()) else { return };
    let corners = board.corners;
    if quarters % 2 == 1 {
        board.corners = (corners.1, corners.0);
    }
    for sighting in recording.frames.iter_mut().flat_map(|f| &mut f.sightings) {
        if let Target::Corner(i) = &mut sighting.target {
            *i = turned(*i, corners, quarters);
        }
    }
}

/// Leaves out what a joint (none: any joint) moves in a frame.
fn leave_out(problem: &Problem, frame: &mut crate::diagnose::data::recording::Frame, joint: Option<usize>) {
    let body = &problem.scene.body;
    let observers = [problem.camera_site, problem.points_site];
    let moves = |marker: usize| {
        body.nodes.iter().enumerate().any(|(n, node)| {
            let target = body.carries(n, problem.marker_sites[marker].node);
            joint.is_none_or(|j| node.command.0 == j)
                && observers.iter().flatten().any(|o| body.carries(n, o.node) != target)
        })
    };
    frame.sightings.retain(|s| !matches!(s.target, Target::Marker(m) if moves(m)));
    frame.points.retain(|p| !moves(p.marker));
}
