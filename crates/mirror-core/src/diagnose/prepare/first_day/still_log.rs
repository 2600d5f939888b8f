//! Runs of rows over which a joint's column stands still, as that of a log that hangs does.

use super::table::Table;
use crate::diagnose::principles::{FEWEST_FRAMES, FEWEST_POSTURES, Guard, MAJORITY};
use core::ops::RangeInclusive;

/// Changes below this are none, rad or m.
pub(super) const SAME: Guard = 1e-9;

/// Runs of rows over which a column does not change while others (`rows`: all positions) do, and outside of which it changes together
/// with others in most steps. A joint that is often commanded to stand still, as where one joint is moved at a time, does so in the run
/// too: there nothing shows that its log hung.
pub(super) fn still_runs(column: &[f64], rows: &Table<f64>) -> Vec<(usize, usize)> {
    let mut out = Vec::new();
    let mut first = 0;
    for f in 1..=column.len() {
        if f < column.len() && (column[f] - column[first]).abs() < SAME {
            continue;
        }
        let last = f - 1;
        let mut others: Vec<&[f64]> = (first..=last).map(|row| &rows[row]).collect();
        others.dedup();
        let is_run = others.len() >= FEWEST_POSTURES && last + 1 - first >= FEWEST_FRAMES;
        if is_run && usually_moves(column, rows, first..=last) {
            out.push((first, last));
        }
        first = f;
    }
    out
}

/// Whether a column changes, and another one with it, in most of the steps outside of a run in which any column does.
fn usually_moves(column: &[f64], rows: &Table<f64>, run: RangeInclusive<usize>) -> bool {
    let (mut all, mut own) = (0.0, 0.0);
    for f in (1..column.len()).filter(|f| !run.contains(f) && rows[*f] != rows[f - 1]) {
        let changed = rows[f].iter().zip(&rows[f - 1]).filter(|(a, b)| a != b).count();
        all += 1.0;
        own += f64::from(u8::from((column[f] - column[f - 1]).abs() >= SAME && changed > 1));
    }
    own > MAJORITY * all
}

#[cfg(test)]
mod tests {
    use crate::diagnose::prepare::first_day::still_log::{SAME, still_runs};
    use crate::diagnose::prepare::first_day::table::Table;
    use crate::diagnose::principles::FEWEST_FRAMES;

    const JOINTS: usize = 3;

    fn runs(rows: &[Vec<f64>]) -> Vec<(usize, usize)> {
        let column: Vec<f64> = rows.iter().map(|row| row[0]).collect();
        still_runs(&column, &Table::of(rows))
    }

    #[test]
    fn a_log_that_hangs_among_moving_ones_is_a_run() {
        let (first, last) = (2 * FEWEST_FRAMES, 4 * FEWEST_FRAMES - 1);
        let at = |row: usize, joint: usize| (0.7 * row as f64 + joint as f64).sin();
        let row = |f: usize| {
            (0..JOINTS)
                .map(|j| at(if j == 0 && (first..=last).contains(&f) { first } else { f }, j))
                .collect()
        };
        let mut rows: Vec<Vec<f64>> = (0..6 * FEWEST_FRAMES).map(row).collect();
        assert_eq!(runs(&rows), [(first, last)]);
        // A change that is none does not end it.
        rows[first + 1][0] += 0.1 * SAME;
        assert_eq!(runs(&rows), [(first, last)]);
    }

    #[test]
    fn where_one_joint_is_moved_at_a_time_none_is() {
        let each = 2 * FEWEST_FRAMES;
        let row = |f: usize| {
            (0..JOINTS).map(|j| if f / each == j { 0.1 * (f % each) as f64 } else { 0.0 }).collect()
        };
        let rows: Vec<Vec<f64>> = (0..JOINTS * each).map(row).collect();
        assert!(runs(&rows).is_empty());
    }
}
