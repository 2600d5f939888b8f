//! The result of a diagnosis: plain data, written as JSON in the public format, with further details for the report.

use crate::diagnose::data::checked::Checked;
use crate::diagnose::data::depends_on::DependsOn;
use crate::diagnose::data::left_out::{LeftOut, Reason};
use crate::diagnose::principles::ABOVE_SCATTER;
use serde::Serialize;
use std::collections::BTreeMap;

/// A parameter with its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Estimate {
    /// The value, in the unit given by the parameter's name.
    pub value: f64,
    /// One standard deviation.
    pub std: f64,
}

/// An alternative that these postures cannot separate from a cause.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Alternative {
    /// The effect.
    pub effect: String,
    /// The place.
    pub at: String,
    /// Its probability.
    pub probability: f64,
}

/// A cause of the gap.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Cause {
    /// The effect's name in the vocabulary.
    pub effect: String,
    /// The place.
    pub at: String,
    /// Whom it concerns: `robot`, `setup`, `camera`, `mirror` or `data`.
    pub kind: String,
    /// Posterior probability of this cause against its alternatives.
    pub probability: f64,
    /// Stability: share of resamples of the postures in which the same cause is selected again. None for causes
    /// that are not found by the score test (gross mistakes, slipped rows, small errors everywhere).
    pub stability: Option<f64>,
    /// Its parameters by name.
    pub parameters: BTreeMap<String, Estimate>,
    /// Rivals.
    pub alternatives: Vec<Alternative>,
    /// What happens, in words for the reader.
    pub words: String,
    /// Root mean square shift of the markers that it makes, px (m where points were measured).
    pub rms_shift: f64,
    /// Of a group (`geometry`): each of its small errors, named as single effects.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub members: Vec<Member>,
    /// Of a mistake in some frames only (`markers_swapped`): their numbers.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub frames: Vec<i64>,
}

/// One small error of a group.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Member {
    /// The effect that it would be by itself (`joint_offset`, `axis_tilt`, `link_length`, `marker_mount`, `joint_compliance`), or
    /// `joint_origin` and `transmission_error`, which are no causes of their own.
    pub effect: String,
    /// The place.
    pub at: String,
    /// The effect's parameter, with its unit as suffix.
    pub parameter: String,
    /// Its value under the group's prior.
    pub value: f64,
    /// One standard deviation, of the posterior.
    pub std: f64,
}

/// Share of the gap at a place.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Where {
    /// The place.
    pub at: String,
    /// Share of the gap's variance.
    pub share: f64,
    /// The variables on which the unexplained part depends, if there is one at this place.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depends_on: Option<DependsOn>,
}

impl Where {
    /// The name of the place if the remainder has no single place.
    pub const NOWHERE: &str = "unknown";
    /// The name of the place if all joints have a part in the remainder.
    pub const ROBOT: &str = "robot";
}

/// The gap once one more cause is added.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GapStep {
    /// `effect@place` of the cause; none of the nominal model.
    pub added: Option<String>,
    /// RMS distance on held-out postures, m; none where there is nothing to compare.
    pub rms_m: Option<f64>,
    /// The same in px, where there are pictures.
    pub rms_px: Option<f64>,
}

/// The largest size of an effect at a place that these postures would have hidden.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Limit {
    /// The effect.
    pub effect: String,
    /// The place.
    pub at: String,
    /// Each parameter's limit, alone; none where these postures would hide any size of it.
    pub parameters: BTreeMap<String, Option<f64>>,
}

/// The gap before and after, on postures that the fit did not see.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Gap {
    /// RMS distance between predicted and observed marker positions, nominal model, m; none where there is nothing to compare.
    pub before_m: Option<f64>,
    /// With the causes added, m.
    pub after_m: Option<f64>,
    /// If only noise were left, m.
    pub noise_floor_m: Option<f64>,
    /// (before − after) / (before − noise floor); absent where there is no gap to close.
    pub closed: Option<f64>,
    /// 95 % interval by bootstrap over postures.
    pub closed_ci95: Option<[f64; 2]>,
    /// As above in pixels, where there are pictures.
    pub before_px: Option<f64>,
    /// As above.
    pub after_px: Option<f64>,
    /// As above.
    pub noise_floor_px: Option<f64>,
    /// The gap as causes are added one by one in the reported order; the first entry is the nominal model.
    pub steps: Vec<GapStep>,
    /// Number of postures, each predicted while its region was held out.
    pub held_out_postures: usize,
    /// The gap with causes also selected without the held-out region; none where no cause is named.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub chosen_anew: Option<ChosenAnew>,
    /// Further sessions.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub checked: Vec<Checked>,
}

/// Nested cross-validation: the gap where the parameters and the causes are chosen without the region that they
/// predict. Chosen on all postures are the observations left out, the hypotheses that compete, and which random
/// effects are free.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ChosenAnew {
    /// RMS distance, m; none where no marker was compared in space.
    pub rms_m: Option<f64>,
    /// As above in pixels, where there are pictures.
    pub rms_px: Option<f64>,
    /// Regions that were held out in turn.
    pub regions: usize,
    /// The number of regions without which other causes are selected.
    pub changed: usize,
}

impl Gap {
    /// Before, after and noise floor in px (the picture shows better what in space is mostly the noise of depth), where triangulated positions are mostly noise and there are pictures.
    pub(crate) fn in_pixels(&self) -> Option<[f64; 3]> {
        let in_pixels = [self.before_px?, self.after_px?, self.noise_floor_px?];
        let (Some(before), Some(floor)) = (self.before_m, self.noise_floor_m) else { return Some(in_pixels) };
        (before < ABOVE_SCATTER * floor).then_some(in_pixels)
    }

    /// Whether anything was held out and predicted; without it no agreement is shown.
    pub(crate) fn is_told(&self) -> bool {
        self.after_m.is_some() || self.after_px.is_some()
    }
}

/// One point of a signature plot: the error at a place that one posture alone shows.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SignaturePoint {
    /// The frame's number.
    pub frame: i64,
    /// Commanded position of the joint, rad or m.
    pub position: f64,
    /// Commanded position of the other joint, where the error depends on one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub other_position: Option<f64>,
    /// Gravity's torque on it, N m.
    pub torque_nm: f64,
    /// Sign of the last motion.
    pub direction: f64,
    /// Time, s.
    pub time_s: f64,
    /// The error that this posture alone shows, rad or m.
    pub error: f64,
    /// Its standard deviation.
    pub std: f64,
    /// The fitted value of the cause, or of the free-form error of an unexplained part.
    pub fitted: f64,
}

/// The signature of a cause.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Signature {
    /// Index into the causes; absent for the unexplained part.
    pub cause: Option<usize>,
    /// The place.
    pub at: String,
    /// The other joint on whose position the error depends, where it does.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub other: Option<String>,
    /// Unit of the error: `rad` or `m`.
    pub unit: String,
    /// One point a posture.
    pub points: Vec<SignaturePoint>,
}

/// A quantity against which a track is drawn.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrackAxis {
    /// `time`, `position of joint:J`, `torque of joint:J`, `moment of gravity, x`, `direction of gravity, x`.
    pub name: String,
    /// `s`, `rad`, `m`, `N m`; empty of a direction.
    pub unit: String,
}

/// One posture of a track.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrackPoint {
    /// The frame's number.
    pub frame: i64,
    /// Values of the quantities.
    pub against: Vec<f64>,
    /// What each component would have to be for this posture alone, all else as the model has it.
    pub error: Vec<f64>,
    /// Their standard deviations.
    pub std: Vec<f64>,
    /// The value of the cause, or of the free-form error of an unexplained part.
    pub fitted: Vec<f64>,
}

/// The signature of an error with a direction: of a marker, a link, an axis, the camera; posture by posture.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Track {
    /// Index into the causes; absent for the unexplained part.
    pub cause: Option<usize>,
    /// The place.
    pub at: String,
    /// `shift`, `turn`, `tilt` (of a joint's axis) or `focal` (relative error of the focal length).
    pub what: String,
    /// Unit of the errors: `m`, `rad`, or `1` of a ratio.
    pub unit: String,
    /// The components' names.
    pub components: Vec<String>,
    /// The variable against which it is plotted.
    pub against: Vec<TrackAxis>,
    /// One point a posture.
    pub points: Vec<TrackPoint>,
}

/// A place of a field.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FieldPoint {
    /// `corners` (of the board) or `markers`.
    pub of: String,
    /// Where: mean pixel of the cell, or the corner on the board in m.
    pub at: [f64; 2],
    /// How many observations were averaged.
    pub count: usize,
    /// Mean residual (seen less predicted) without the cause: u, v in px, or the corner's displacement x, y, z in m.
    pub without: Vec<f64>,
    /// With the cause, where there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub with: Option<Vec<f64>>,
    /// Standard deviation by the measurement's noise.
    pub std: Vec<f64>,
}

/// The signature of wrong optics: residuals of corners and markers over the image, or of corners over the board.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Field {
    /// Index into the causes; absent for the unexplained part.
    pub cause: Option<usize>,
    /// The place.
    pub at: String,
    /// `image` or `board`.
    pub over: String,
    /// Unit of the residuals: `px` or `m`.
    pub unit: String,
    /// Width and height of the image, px, or of the board's corners, m.
    pub size: [f64; 2],
    /// The places that were seen often enough.
    pub points: Vec<FieldPoint>,
}

/// A marker in one posture, root frame, m.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SeenMarker {
    /// The posture's first frame.
    pub frame: i64,
    /// The marker's name.
    pub marker: String,
    /// Where it was measured.
    pub measured_m: [f64; 3],
    /// Where the nominal model has it.
    pub before_m: [f64; 3],
    /// Where the model with the causes has it.
    pub after_m: [f64; 3],
}

impl Data {
    /// How many observations of markers were left out as false.
    pub(crate) fn false_count(&self) -> usize {
        self.left_out.iter().filter(|l| l.is_false()).count()
    }

    /// In how many frames the board is seen whole and is no reflection of the board.
    pub(crate) fn boards_without_mirror(&self) -> usize {
        self.left_out.iter().filter(|l| matches!(l.why, Reason::NoMirror { .. })).count()
    }
}

/// What of the data was given and used: nothing is left out without being listed.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Data {
    /// Frames of the session.
    pub frames_given: usize,
    /// Frames with at least one marker used.
    pub frames_used: usize,
    /// Postures of the session.
    pub postures_given: usize,
    /// Postures with at least one marker used.
    pub postures_used: usize,
    /// Observations of markers, image points and measured points.
    pub points_given: usize,
    /// Those that were used.
    pub points_used: usize,
    /// What was left out.
    pub left_out: Vec<LeftOut>,
}

/// One hypothesis of the ranking.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Ranked {
    /// The effect.
    pub effect: String,
    /// The place.
    pub at: String,
    /// Log Bayes factor against the nominal model, by the score test.
    pub log_bayes: f64,
}

/// How much of the gap the causes explain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Too little usable evidence for a statement.
    Insufficient,
    /// The nominal model already predicts to the noise floor.
    None,
    /// The causes bring it there.
    Explained,
    /// The causes shrink the gap, and the remainder is significant.
    Partial,
    /// A significant gap that no effect of the vocabulary explains.
    Unknown,
}

impl Verdict {
    /// Its name in `diagnosis.json`.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Insufficient => "insufficient",
            Self::None => "none",
            Self::Explained => "explained",
            Self::Partial => "partial",
            Self::Unknown => "unknown",
        }
    }
}

impl core::fmt::Display for Verdict {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.as_str())
    }
}

/// The version of the public format that is written.
pub(crate) const VERSION: u32 = 2;

/// The result of a diagnosis.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Diagnosis {
    /// `mirror-posture/diagnosis`.
    pub format: String,
    /// 2: the version of the format.
    pub version: u32,
    /// Whether it was stopped before its end and contains a partial result.
    #[serde(skip_serializing_if = "core::ops::Not::not")]
    pub interrupted: bool,
    /// How much of the gap the causes explain.
    pub verdict: Verdict,
    /// The verdict in one sentence.
    pub sentence: String,
    /// Which data were used, and what was left out.
    pub data: Data,
    /// The causes, the one that closes most of the gap first.
    pub causes: Vec<Cause>,
    /// Places with their share of the gap.
    pub r#where: Vec<Where>,
    /// Before and after.
    pub gap: Gap,
    /// The largest size of each effect at each place that these postures would have hidden (95 %), with free
    /// mounts.
    pub limits: Vec<Limit>,
    /// Commanded postures that would separate the alternatives.
    pub next_postures: Vec<BTreeMap<String, f64>>,
    /// Warnings: missing or weak data.
    pub warnings: Vec<String>,
    /// Estimated noise, one axis: corners and markers in px, points in m.
    pub noise: BTreeMap<String, f64>,
    /// How the search went, a line a step.
    pub trace: Vec<String>,
    /// The score test of all hypotheses against the nominal model, best first (the first forty).
    pub ranking: Vec<Ranked>,
    /// Signatures of causes at joints and of the unexplained part.
    pub signatures: Vec<Signature>,
    /// Signatures of errors with a direction: of markers, links, axes, the camera.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub tracks: Vec<Track>,
    /// Signatures of lens, board and mirror.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub fields: Vec<Field>,
    /// The markers posture by posture, if requested.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub markers: Vec<SeenMarker>,
}
