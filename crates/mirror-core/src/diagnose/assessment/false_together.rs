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
    let of_marker = |m: usize| seen.iter().filter_map(|of_frame| of_frame[m]).collect::<Vec<bool>>();
    let in_a_run = (0..recording.markers.len()).filter_map(|m| run_of(&of_marker(m), p)).map(|run| run.gain);
    in_a_run.fold(0.0, f64::max).max(at_once(&seen, p)) > -LOG_PRIOR_STRUCTURE
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

/// A run in which a marker was left out more often than elsewhere: from one to another of what shows it.
pub(super) struct Run {
    pub gain: f64,
    pub first: usize,
    pub last: usize,
}

/// The run that gains most over chance, of what shows one marker: whether it was left out; `p` is the share that was of all.
pub(super) fn run_of(outs: &[bool], p: f64) -> Option<Run> {
    let gain = |out: bool| (MAJORITY / if out { p } else { 1.0 - p }).ln();
    let gains: Vec<f64> = outs.iter().map(|out| gain(*out)).collect();
    let (first, last) = best_run(&gains)?;
    Some(Run { gain: gains[first..=last].iter().sum(), first, last })
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
