//! A place that is elsewhere for a run of rows, and then again where it was, or nearly: something pushed it, and somebody
//! put it back.
//!
//! With a constant displacement a and another one, b, from row k to before row l, and sums over all frames (H, g) and over
//! the run (H_r, g_r), the gain of b is that of a step ([`super::changes`]) with the run's sums in place of those from k on.
//! Runs between rows of a grid are compared first, and the best one's ends are moved row by row. A step alone gains little:
//! it is half wrong on either side. Where each row of the run has a displacement of its own, something else is wrong.

use super::by_frame::{Constant, Gain, Place, Sums};
use crate::diagnose::principles::{FEWEST_FRAMES, Guard, MAJORITY, Size};
use core::ops::Range;
use nalgebra::{DMatrix, DVector};

/// Rows between which runs are compared first.
const ENDS: Size = 48;
/// A direction of which a row tells less than this share of all is not seen in it.
const WELL_SEEN: Guard = 1e-6;

/// Sums of a place's normal equations before each row.
struct Before(Vec<Sums>);

impl Before {
    fn of(place: &Place, count: usize) -> Self {
        let mut sums = vec![(DMatrix::zeros(count, count), DVector::zeros(count))];
        for (h, g) in &place.frames {
            let next = sums.last().map(|(sum_h, sum_g)| (sum_h + h, sum_g + g));
            sums.extend(next);
        }
        Self(sums)
    }

    fn over(&self, run: &Range<usize>) -> Sums {
        let ((h, g), (h_before, g_before)) = (&self.0[run.end], &self.0[run.start]);
        (h - h_before, g - g_before)
    }
}

/// The run of rows over which a place's displacement gains most, neither from the first row on nor to the last.
pub(super) fn best_run(place: &Place) -> Option<(Range<usize>, Gain)> {
    let (rows, count) = (place.frames.len(), place.frames.first()?.0.nrows());
    let before = Before::of(place, count);
    let constant = Constant::of(&before.over(&(0..rows)))?;
    let can_be = |run: &Range<usize>| {
        let long = run.start + 2 * FEWEST_FRAMES <= run.end;
        long && run.start >= FEWEST_FRAMES && run.end + FEWEST_FRAMES <= rows
    };
    let gained = |run: Range<usize>| {
        can_be(&run).then(|| constant.gain(&before.over(&run))).flatten().map(|gain| (run, gain))
    };
    let better = |runs: &mut dyn Iterator<Item = Range<usize>>| {
        runs.filter_map(gained).max_by(|(_, a), (_, b)| a.gain.total_cmp(&b.gain))
    };
    let ends: Vec<usize> = (0..=ENDS).map(|i| i * rows / ENDS).collect();
    let mut pairs = ends.iter().flat_map(|&start| ends.iter().map(move |&end| start..end));
    let mut best = better(&mut pairs)?;
    let mut step = rows.div_ceil(ENDS);
    while step > 0 {
        let Range { start, end } = best.0;
        let near = [
            start.saturating_sub(step)..end,
            start + step..end,
            start..end.saturating_sub(step),
            start..end + step,
        ];
        match better(&mut near.into_iter()).filter(|(_, gain)| gain.gain > best.1.gain) {
            Some(next) => best = next,
            None => step /= 2,
        }
    }
    Some(best).filter(|(run, found)| found.gain > MAJORITY * of_each_row(place, run))
}

/// What a displacement of the place in each row of a run by itself would gain, together: a constant one is the reason of
/// what is left there only if it gains most of that.
fn of_each_row(place: &Place, run: &Range<usize>) -> f64 {
    let of = |(h, g): &Sums| {
        // One view does not show the depth.
        let inverse = h.clone().pseudo_inverse(WELL_SEEN * h.trace().max(f64::MIN_POSITIVE));
        inverse.map_or(0.0, |inverse| g.dot(&(inverse * g)))
    };
    place.frames[run.clone()].iter().map(of).sum()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::diagnose::model::slips::Slipped;
    use crate::diagnose::prepare::first_day::by_frame::What;

    /// A place of unit information in each row, displaced over a run.
    fn place(rows: usize, run: &Range<usize>, there: f64) -> Place {
        let frame = |row: usize| {
            let by = if run.contains(&row) { there } else { 0.0 };
            // Residuals that differ, as noise does.
            let g = DVector::from_fn(3, |i, _| {
                by * f64::from(u8::from(i == 1)) + 0.1 * ((7 * row + i) as f64).sin()
            });
            (DMatrix::identity(3, 3), g)
        };
        Place { what: What::Slips(Slipped::Marker(0)), frames: (0..rows).map(frame).collect() }
    }

    #[test]
    fn the_run_is_found_to_the_row_and_gains_its_displacement() {
        for (rows, run) in [(160, 49..89), (90, 20..33), (1000, 501..777)] {
            let (found, gain) = best_run(&place(rows, &run, 4.0)).unwrap();
            assert_eq!(found, run);
            let (motion, _) = gain.motion();
            assert!((motion[4] - 4.0).abs() < 0.2 && motion[3].abs() < 0.1, "{motion}");
        }
    }

    #[test]
    fn a_session_that_is_too_short_for_a_run_has_none() {
        assert!(best_run(&place(2 * FEWEST_FRAMES, &(8..12), 4.0)).is_none());
    }
}
