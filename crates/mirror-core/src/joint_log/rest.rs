//! The moments in which no joint moves.

use super::log::JointLog;
use crate::error::{Error, Result};

/// A moment in which no joint moved: from and to, s of the joints' clock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rest {
    /// Its first row's time, s.
    pub start_s: f64,
    /// Its last row's time, s.
    pub end_s: f64,
}

/// The moments of at least `least_s` in which every joint stays within `tolerance` (rad or m), none twice.
///
/// A rest is grown from its first row on while max − min of every joint, over all rows of the rest so far, is at most the tolerance:
/// a slow creep ends it as a quick move does. Where the rows so far are shorter than `least_s`, the rest begins at the next row.
///
/// # Errors
/// A tolerance or a duration that is not a positive number.
pub fn rests(log: &JointLog, tolerance: f64, least_s: f64) -> Result<Vec<Rest>> {
    for (what, got) in [("tolerance of a rest, rad (m)", tolerance), ("duration of a rest, s", least_s)] {
        if !(got.is_finite() && got > 0.0) {
            let needed = "a finite number above 0".into();
            return Err(Error::OutOfRange { what: what.into(), got, needed });
        }
    }
    let time_s = log.time_s();
    let mut rests = Vec::new();
    let mut range = Range::of(log.row(0));
    let mut start = 0;
    for row in 1..=time_s.len() {
        if row < time_s.len() && range.still_within(log.row(row), tolerance) {
            continue;
        }
        let (start_s, end_s) = (time_s[start], time_s[row - 1]);
        if end_s - start_s >= least_s {
            rests.push(Rest { start_s, end_s });
            start = row;
        } else {
            start += 1;
        }
        if row == time_s.len() {
            break;
        }
        // The rows of a move: the rest may begin at any of them.
        range = loop {
            let mut range = Range::of(log.row(start));
            if (start..=row).all(|i| range.still_within(log.row(i), tolerance)) {
                break range;
            }
            start += 1;
        };
    }
    Ok(rests)
}

/// The lowest and highest position of each joint.
struct Range {
    lowest: Vec<f64>,
    highest: Vec<f64>,
}

impl Range {
    fn of(row: &[f64]) -> Self {
        Self { lowest: row.to_vec(), highest: row.to_vec() }
    }

    fn add(&mut self, row: &[f64]) {
        for ((low, high), x) in self.lowest.iter_mut().zip(&mut self.highest).zip(row) {
            (*low, *high) = (low.min(*x), high.max(*x));
        }
    }

    /// Adds a row if every joint's range is then within the tolerance, and whether it is.
    fn still_within(&mut self, row: &[f64], tolerance: f64) -> bool {
        let both = self.lowest.iter().zip(&self.highest).zip(row);
        let within = both.into_iter().all(|((low, high), x)| high.max(*x) - low.min(*x) <= tolerance);
        if within {
            self.add(row);
        }
        within
    }
}
