//! Progress of a diagnosis while it runs, and the partial result if it is stopped.

use crate::diagnose::data::diagnosis::{Cause, Data, Diagnosis, Gap, GapStep, VERSION, Verdict};
use crate::diagnose::data::recording::{Recording, Target};
use std::collections::{BTreeMap, HashSet};
use std::sync::{Arc, Mutex, PoisonError};

/// Looks at a running diagnosis from outside. Clones watch the same one; the default one watches nothing.
///
/// ```
/// use mirror_core::diagnose::{DiagnoseOptions, Progress};
///
/// let progress = Progress::new();
/// let options = DiagnoseOptions { progress: progress.clone(), ..DiagnoseOptions::default() };
/// assert_eq!(progress.stage(), "");
/// # drop(options);
/// ```
#[derive(Debug, Clone, Default)]
pub struct Progress(Option<Arc<Mutex<SoFar>>>);

#[derive(Debug, Default)]
struct SoFar {
    stage: &'static str,
    mistakes: Vec<Cause>,
    causes: Vec<Cause>,
}

impl Progress {
    /// One that watches.
    #[must_use]
    pub fn new() -> Self {
        Self(Some(Arc::default()))
    }

    fn with<T>(&self, change: impl FnOnce(&mut SoFar) -> T) -> Option<T> {
        self.0.as_ref().map(|state| change(&mut state.lock().unwrap_or_else(PoisonError::into_inner)))
    }

    /// Whether an observer is registered.
    pub(crate) fn is_watched(&self) -> bool {
        self.0.is_some()
    }

    pub(crate) fn enter(&self, stage: &'static str) {
        self.with(|s| s.stage = stage);
    }

    pub(crate) fn tell_mistakes(&self, mistakes: &[Cause]) {
        self.with(|s| s.mistakes = mistakes.to_vec());
    }

    pub(crate) fn tell_causes(&self, causes: Vec<Cause>) {
        self.with(|s| s.causes = causes);
    }

    /// The current stage in a few words; empty before the start.
    #[must_use]
    pub fn stage(&self) -> &'static str {
        self.with(|s| s.stage).unwrap_or_default()
    }

    /// How many causes were found so far.
    #[must_use]
    pub fn found(&self) -> usize {
        self.with(|s| s.mistakes.len() + s.causes.len()).unwrap_or_default()
    }

    /// The partial result, marked as interrupted: causes with probability `p/(1 + p)`, p against their absence alone,
    /// because an alternative that was not compared may be as probable; and no gap, because nothing was held out yet.
    #[must_use]
    pub fn so_far(&self, recording: &Recording) -> Diagnosis {
        let (stage, causes) = self
            .with(|s| (s.stage, s.mistakes.iter().chain(&s.causes).cloned().collect::<Vec<_>>()))
            .unwrap_or_default();
        let step = |added| GapStep { added, rms_m: None, rms_px: None };
        let added = causes.iter().map(|c| Some(format!("{}@{}", c.effect, c.at)));
        let sentence = match causes.len() {
            0 => format!("Interrupted while {stage}: no cause had been found yet. This is no verdict."),
            1 => {
                format!(
                    "Interrupted while {stage}: one cause was found so far; its alternatives were not compared."
                )
            }
            n => format!(
                "Interrupted while {stage}: {n} causes were found so far; their alternatives were not compared."
            ),
        };
        Diagnosis {
            format: "mirror-posture/diagnosis".into(),
            version: VERSION,
            interrupted: true,
            verdict: if causes.is_empty() { Verdict::Insufficient } else { Verdict::Partial },
            sentence,
            data: counted(recording),
            gap: Gap {
                before_m: None,
                after_m: None,
                noise_floor_m: None,
                closed: None,
                closed_ci95: None,
                chosen_anew: None,
                before_px: None,
                after_px: None,
                noise_floor_px: None,
                steps: core::iter::once(None).chain(added).map(step).collect(),
                held_out_postures: 0,
                checked: Vec::new(),
            },
            causes,
            r#where: Vec::new(),
            limits: Vec::new(),
            next_postures: Vec::new(),
            warnings: vec![
                "interrupted: these are the causes found so far; diagnose again before you correct anything"
                    .into(),
            ],
            noise: BTreeMap::new(),
            trace: Vec::new(),
            ranking: Vec::new(),
            signatures: Vec::new(),
            tracks: Vec::new(),
            fields: Vec::new(),
            markers: Vec::new(),
        }
    }
}

/// What was given; nothing was left out so far.
fn counted(recording: &Recording) -> Data {
    let frames = recording.frames.len();
    let postures = recording.frames.iter().map(|f| f.posture).collect::<HashSet<_>>().len();
    let of_markers = |f: &crate::diagnose::data::recording::Frame| {
        f.points.len() + f.sightings.iter().filter(|s| matches!(s.target, Target::Marker(_))).count()
    };
    let points = recording.frames.iter().map(of_markers).sum();
    Data {
        frames_given: frames,
        frames_used: frames,
        postures_given: postures,
        postures_used: postures,
        points_given: points,
        points_used: points,
        left_out: Vec::new(),
    }
}
