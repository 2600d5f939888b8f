//! The offset between the joints' clock and the pictures', from when each shows movement.

use super::log::{JointLog, place};
use crate::error::{Error, Result};
use crate::statistics::median;
use rayon::prelude::*;

/// Step of the offsets that are tried first, and of those around the best of them, s.
const STEP_S: f64 = 0.02;
const FINE_S: f64 = 0.001;
/// Correlation of the two clocks' movement below which they do not determine the offset.
const LEAST_MATCH: f64 = 0.5;
/// Offsets whose correlation is lower by less may be right as well.
const RIVAL_MATCH: f64 = 0.08;
/// A peak is the highest within this many steps either way.
const NEAR: usize = 15;
/// What a picture changes by up to this times the noise is no movement.
const ABOVE_NOISE: f64 = 1.5;
/// The farthest that offsets are looked for, s.
const LARGEST_S: f64 = 3600.0;
/// Pictures below which nothing is told.
const FEWEST: usize = 10;

/// Picture time = joint time + `offset_s`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClockMatch {
    /// s; 0 where nothing is known.
    pub offset_s: f64,
    /// The correlation of both movements: 1 where they are the same, 0 where nothing is known.
    pub correlation: f64,
}

impl ClockMatch {
    const NOTHING: Self = Self { offset_s: 0.0, correlation: 0.0 };

    /// Whether the pictures' movement determines the offset.
    pub fn is_trusted(&self) -> bool {
        self.correlation >= LEAST_MATCH
    }
}

/// The offset δ at which the pictures move when the joints do.
///
/// What changes between two pictures, `c_i` from `t_i` to `t_(i+1)`, is correlated with how far the joint that moves farthest goes
/// between the same two moments, `g_i(δ) = max_j |q_j(t_(i+1) − δ) − q_j(t_i − δ)|`, for offsets up to `most_s` either way; δ has the
/// largest correlation coefficient. Both are cut off at the size of a usual move: a joint near the camera changes a picture more than
/// one far away. An interval in which a move begins or ends shows a part of it, and so the offset is found to a third of the time
/// between two pictures at worst (of 19 in 20 recordings to an eighth), where several moves are seen. Moves in an even beat match at
/// every whole beat: of offsets that match about as well the nearest to 0 is meant.
///
/// `picture_s` (N,): times of the pictures, s of their clock; `motion` (N,): how much each differs from the one before, in any unit.
///
/// # Errors
/// Lengths that differ, numbers that are not finite, and a largest offset below 0 or above an hour.
pub fn match_clocks(log: &JointLog, picture_s: &[f64], motion: &[f64], most_s: f64) -> Result<ClockMatch> {
    if motion.len() != picture_s.len() {
        let what = "motion, one a picture".into();
        return Err(Error::LengthMismatch { what, got: motion.len(), needed: picture_s.len() });
    }
    let numbers = picture_s.iter().chain(motion).chain([&most_s]);
    if let Some(&got) = numbers.into_iter().find(|x| !x.is_finite()) {
        return Err(Error::NotFinite {
            what: "a picture's time or motion, or the largest offset".into(),
            got,
        });
    }
    if !(0.0..=LARGEST_S).contains(&most_s) {
        let needed = format!("0 to {LARGEST_S} s");
        return Err(Error::OutOfRange { what: "largest offset of the clocks".into(), got: most_s, needed });
    }
    let Some(moves) = Moves::of(log, picture_s, motion) else { return Ok(ClockMatch::NOTHING) };
    let steps = (most_s / STEP_S).round() as i64;
    let offsets: Vec<f64> = (-steps..=steps).map(|k| k as f64 * STEP_S).collect();
    let scores: Vec<f64> = offsets.par_iter().map(|&offset_s| moves.coarse(offset_s)).collect();
    let best = scores.iter().copied().fold(0.0, f64::max);
    let is_peak = |&k: &usize| {
        let around = &scores[k.saturating_sub(NEAR)..scores.len().min(k + NEAR + 1)];
        scores[k] >= best - RIVAL_MATCH && around.iter().all(|&other| scores[k] >= other - 1e-9)
    };
    let peaks = (0..offsets.len()).filter(is_peak).map(|k| offsets[k]);
    let nearest = peaks.min_by(|a, b| a.abs().total_cmp(&b.abs()));
    let Some(chosen) = nearest.filter(|_| best > 0.0) else { return Ok(ClockMatch::NOTHING) };
    let count = (STEP_S / FINE_S).round() as i64;
    let fine: Vec<f64> = (-count..=count).map(|k| chosen + k as f64 * FINE_S).collect();
    let exact: Vec<f64> = fine.par_iter().map(|&offset_s| moves.exact(offset_s)).collect();
    let highest = exact.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let good: Vec<f64> =
        fine.iter().zip(&exact).filter(|(_, score)| **score >= highest - 1e-6).map(|(at, _)| *at).collect();
    let (Some(first), Some(last)) = (good.first(), good.last()) else { return Ok(ClockMatch::NOTHING) };
    Ok(ClockMatch { offset_s: 0.5 * (first + last), correlation: highest })
}

/// What the pictures and the joints show of movement.
struct Moves<'a> {
    log: &'a JointLog,
    picture_s: &'a [f64],
    /// By how much each picture but the first changed, above the noise, cut off at a usual move's.
    changed: Vec<f64>,
    /// Moments from which joints' movement is tabulated, and how far they go from there within the usual time between two pictures.
    from_s: Vec<f64>,
    gone: Vec<f64>,
    most_gone: f64,
}

impl<'a> Moves<'a> {
    /// None where pictures or joints show no movement, or are too few.
    fn of(log: &'a JointLog, picture_s: &'a [f64], motion: &[f64]) -> Option<Self> {
        if picture_s.len() < FEWEST || motion.iter().all(|m| *m <= 0.0) {
            return None;
        }
        // The noise of a still picture is the level of the lower half; its square adds to that of the movement.
        let mut sorted = motion[1..].to_vec();
        sorted.sort_unstable_by(f64::total_cmp);
        sorted.truncate((motion.len() / 4).max(1));
        let noise = ABOVE_NOISE * median(sorted);
        let above = |m: &f64| (m * m - noise * noise).max(0.0).sqrt();
        let mut changed: Vec<f64> = motion[1..].iter().map(above).collect();
        let usual_s = median(picture_s.windows(2).map(|pair| pair[1] - pair[0]).collect());
        // Between two moments as far apart as two pictures mostly are, from each at which the joints' speed may change.
        let (first_s, last_s) = log.ends_s();
        let mut from_s: Vec<f64> = log.time_s().iter().flat_map(|&time| [time, time - usual_s]).collect();
        from_s.retain(|&time| time >= first_s && time <= last_s - usual_s);
        from_s.sort_unstable_by(f64::total_cmp);
        from_s.dedup();
        if usual_s <= 0.0 || from_s.len() < 2 {
            return None;
        }
        let mut gone: Vec<f64> = from_s.iter().map(|&time| log.farthest(time, time + usual_s)).collect();
        let (most_changed, most_gone) = (usual_size(&changed, 1), usual_size(&gone, 2));
        if most_changed <= 0.0 || most_gone <= 0.0 {
            return None;
        }
        changed.iter_mut().for_each(|c| *c = c.min(most_changed));
        gone.iter_mut().for_each(|g| *g = g.min(most_gone));
        Some(Self { log, picture_s, changed, from_s, gone, most_gone })
    }

    /// The correlation at an offset, with the tabulated movement; −1 where too few pictures are within the log.
    fn coarse(&self, offset_s: f64) -> f64 {
        self.correlation(offset_s, |from_s, _| {
            let (before, share) = place(&self.from_s, from_s);
            self.gone[before] + share * (self.gone[before + 1] - self.gone[before])
        })
    }

    /// The same with the movement between the two pictures themselves.
    fn exact(&self, offset_s: f64) -> f64 {
        self.correlation(offset_s, |from_s, to_s| self.log.farthest(from_s, to_s).min(self.most_gone))
    }

    /// The correlation coefficient of what pictures and joints show, over the pictures within the log at an offset.
    fn correlation(&self, offset_s: f64, gone: impl Fn(f64, f64) -> f64) -> f64 {
        let (first_s, last_s) = self.log.ends_s();
        let mut sums = Sums::default();
        for (pair, &changed) in self.picture_s.windows(2).zip(&self.changed) {
            let (from_s, to_s) = (pair[0] - offset_s, pair[1] - offset_s);
            if from_s >= first_s && to_s <= last_s {
                sums.add(gone(from_s, to_s), changed);
            }
        }
        let enough = sums.count >= FEWEST.max(self.picture_s.len() / 2) as f64;
        if enough { sums.correlation().unwrap_or(-1.0) } else { -1.0 }
    }
}

/// Sums of two columns, their means and products about them (Welford).
#[derive(Default)]
struct Sums {
    count: f64,
    mean: [f64; 2],
    squares: [f64; 2],
    product: f64,
}

impl Sums {
    fn add(&mut self, x: f64, y: f64) {
        self.count += 1.0;
        let off = [x - self.mean[0], y - self.mean[1]];
        self.mean[0] += off[0] / self.count;
        self.mean[1] += off[1] / self.count;
        let now = [x - self.mean[0], y - self.mean[1]];
        self.squares[0] += off[0] * now[0];
        self.squares[1] += off[1] * now[1];
        self.product += off[0] * now[1];
    }

    /// None where a column is constant, or numbers overflow.
    fn correlation(&self) -> Option<f64> {
        let scale = (self.squares[0] * self.squares[1]).sqrt();
        let correlation = self.product / scale;
        (scale > 0.0 && correlation.is_finite()).then_some(correlation)
    }
}

/// The median of what moved, each weighted by a power of itself: rests, however many, hardly count, and by a low power nor does a lamp
/// that is switched. 0 where nothing moved.
fn usual_size(moved: &[f64], power: i32) -> f64 {
    let mut ordered = moved.to_vec();
    ordered.sort_unstable_by(f64::total_cmp);
    let half = 0.5 * ordered.iter().map(|x| x.powi(power)).sum::<f64>();
    let mut sum = 0.0;
    let reached = ordered.iter().find(|x| {
        sum += x.powi(power);
        sum >= half
    });
    reached.copied().filter(|_| half > 0.0).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use crate::joint_log::clock::{Sums, usual_size};

    #[test]
    fn a_correlation_is_that_of_its_definition() {
        let (x, y) = ([1.0, 2.0, 4.0, 8.0], [3.0, 1.0, 5.0, 6.0]);
        let mut sums = Sums::default();
        x.iter().zip(&y).for_each(|(x, y)| sums.add(*x, *y));
        // By hand: means 3.75 and 3.75, Σdx² = 28.75, Σdy² = 14.75, Σdxdy = 16.75.
        let expected = 16.75 / (28.75_f64 * 14.75).sqrt();
        assert!((sums.correlation().unwrap_or(0.0) - expected).abs() < 1e-12);
        let mut flat = Sums::default();
        x.iter().for_each(|x| flat.add(*x, 1.0));
        assert!(flat.correlation().is_none());
    }

    #[test]
    fn a_usual_move_is_not_a_rest() {
        // 97 rests and three moves, one of which is a lamp.
        let mut moved = vec![0.01; 97];
        moved.extend([1.0, 1.2, 2.0]);
        assert_eq!(usual_size(&moved, 1), 1.2);
        assert_eq!(usual_size(&[0.0, 0.0], 2), 0.0);
        assert_eq!(usual_size(&[], 1), 0.0);
    }
}
