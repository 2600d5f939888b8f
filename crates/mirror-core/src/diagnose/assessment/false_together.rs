//! Whether the observations left out as false lie together. Random detection errors are scattered; a run of them at
//! one marker, or the same two markers again and again, has one cause.
//!
//! With p the share of all observations that was left out:
//!
//! * a run of rows in which half of a marker's observations are false gains, over chance, `Σ ln(½ / p)` over those
//!   left out and `Σ ln(½ / (1 − p))` over the others; the best run is found in one pass (Kadane);
//! * of N frames that show two markers, `E = N p²` have both false by chance; k of them gain `k ln(k / E) − (k − E)`
//!   (Poisson), less the logarithm of the number of pairs.
//!
//! Either gain must exceed the threshold for any structure.

use crate::diagnose::data::diagnosis::Data;
use crate::diagnose::data::recording::{Recording, Target};
use crate::diagnose::principles::{LOG_PRIOR_STRUCTURE, MAJORITY};
use crate::statistics::best_run;
use std::collections::BTreeSet;

/// Whether the observations left out as false lie together.
pub(crate) fn lies_together(recording: &Recording, data: &Data) -> bool {
    let seen = seen(recording, data);
    let Some(p) = false_share(&seen) else { return false };
    let in_a_run = (0..recording.markers.len()).filter_map(|m| run_of(&seen, p, m)).map(|run| run.gain);
    in_a_run.fold(0.0, f64::max).max(at_once(&seen, p)) > -LOG_PRIOR_STRUCTURE
}

/// The warning if a marker was left out in most of a run of frames: it moved, and came back. None where that is `told` of the
/// marker already.
pub(crate) fn came_back(recording: &Recording, data: &Data, told: Option<&str>) -> Option<String> {
    let seen = seen(recording, data);
    let p = false_share(&seen)?;
    let runs = (0..recording.markers.len()).filter_map(|m| Some((m, run_of(&seen, p, m)?)));
    let (marker, run) = runs.max_by(|a, b| a.1.gain.total_cmp(&b.1.gain))?;
    let name = recording.markers[marker].name.as_str();
    (run.gain > -LOG_PRIOR_STRUCTURE && told != Some(name)).then(|| {
        format!(
            "{name} was left out in {} of the {} frames from {} to {} that show it: something touched it there, or was taken for it; look at these frames, and fasten it",
            run.left_out,
            run.shown,
            recording.frames[run.first].number,
            recording.frames[run.last].number
        )
    })
}

/// Of each frame, by marker, whether it was left out; none where it was not seen.
type Seen = Vec<Vec<Option<bool>>>;

fn seen(recording: &Recording, data: &Data) -> Seen {
    let far: BTreeSet<(i64, &str)> =
        data.left_out.iter().filter(|l| l.is_false()).map(|l| (l.frame, l.target.as_str())).collect();
    recording
        .frames
        .iter()
        .map(|frame| {
            let mut of_frame = vec![None; recording.markers.len()];
            let sighted = frame.sightings.iter().filter_map(|s| match s.target {
                Target::Marker(m) => Some(m),
                Target::Corner(_) => None,
            });
            for m in sighted.chain(frame.points.iter().map(|p| p.marker)) {
                of_frame[m] = Some(far.contains(&(frame.number, recording.markers[m].name.as_str())));
            }
            of_frame
        })
        .collect()
}

/// The share of all observations that was left out; none where nothing was, or most.
fn false_share(seen: &Seen) -> Option<f64> {
    let all = || seen.iter().flatten().flatten();
    let p = all().filter(|out| **out).count() as f64 / all().count().max(1) as f64;
    (p > 0.0 && p < MAJORITY).then_some(p)
}

/// A run of frames in which a marker was left out more often than elsewhere.
struct Run {
    gain: f64,
    /// Frames, by index.
    first: usize,
    last: usize,
    shown: usize,
    left_out: usize,
}

fn run_of(seen: &Seen, p: f64, marker: usize) -> Option<Run> {
    let gain = |out: bool| (MAJORITY / if out { p } else { 1.0 - p }).ln();
    let (frames, outs): (Vec<usize>, Vec<bool>) =
        seen.iter().enumerate().filter_map(|(f, of_frame)| Some((f, of_frame[marker]?))).unzip();
    let gains: Vec<f64> = outs.iter().map(|out| gain(*out)).collect();
    let (first, last) = best_run(&gains)?;
    let its = first..=last;
    Some(Run {
        gain: gains[its.clone()].iter().sum(),
        first: frames[first],
        last: frames[last],
        shown: its.clone().count(),
        left_out: outs[its].iter().filter(|out| **out).count(),
    })
}

/// The gain over chance of frames in which both of two markers are false, for the pair with the largest gain.
fn at_once(seen: &[Vec<Option<bool>>], p: f64) -> f64 {
    let markers = seen.first().map_or(0, Vec::len);
    let pairs: Vec<(usize, usize)> = (0..markers).flat_map(|b| (0..b).map(move |a| (a, b))).collect();
    let gain = |&(a, b): &(usize, usize)| {
        let both = || seen.iter().filter_map(|frame| Some(frame[a]? && frame[b]?));
        let (expected, count) = (both().count() as f64 * p * p, both().filter(|out| *out).count() as f64);
        let gained = count * (count / expected).ln() - (count - expected);
        if count > expected { gained - (pairs.len() as f64).ln() } else { 0.0 }
    };
    pairs.iter().map(gain).fold(0.0, f64::max)
}
