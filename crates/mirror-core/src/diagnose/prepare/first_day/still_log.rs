//! Runs of rows over which a joint's column stands still, as that of a log that hangs does.

use super::variant::Variant;
use crate::diagnose::principles::{FEWEST_FRAMES, FEWEST_POSTURES, Guard, MAJORITY};
use core::ops::RangeInclusive;

/// Changes below this are none, rad or m.
const SAME: Guard = 1e-9;

/// Runs of rows over which a column does not change while others do, and outside of which it changes in most steps. A joint that is often
/// commanded to stand still, as where one joint is moved at a time, does so in the run too: there nothing shows that its log hung.
pub(super) fn still_runs(column: &[f64], variant: &Variant) -> Vec<(usize, usize)> {
    let mut out = Vec::new();
    let mut first = 0;
    for f in 1..=column.len() {
        if f < column.len() && (column[f] - column[first]).abs() < SAME {
            continue;
        }
        let last = f - 1;
        let mut others: Vec<&Vec<f64>> = variant.positions[first..=last].iter().collect();
        others.dedup();
        let is_run = others.len() >= FEWEST_POSTURES && last + 1 - first >= FEWEST_FRAMES;
        if is_run && usually_moves(column, variant, first..=last) {
            out.push((first, last));
        }
        first = f;
    }
    out
}

/// Whether a column changes in most of the steps, outside of a run, in which any column does.
fn usually_moves(column: &[f64], variant: &Variant, run: RangeInclusive<usize>) -> bool {
    let rows = &variant.positions;
    let steps = (1..column.len()).filter(|f| !run.contains(f) && rows[*f] != rows[f - 1]);
    let (mut all, mut own) = (0.0, 0.0);
    for f in steps {
        all += 1.0;
        own += f64::from(u8::from((column[f] - column[f - 1]).abs() >= SAME));
    }
    own > MAJORITY * all
}
