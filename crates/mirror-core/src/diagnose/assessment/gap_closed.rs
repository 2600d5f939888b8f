//! How far the causes close the gap, and the interval of that figure.
//!
//! `closed = (before − after) / (before − floor)`, of root mean squares in the unit of the measurement: pixels where
//! there are pictures. In metres the poorly observed depth direction would dominate.

use crate::diagnose::assessment::noise_floor::Floor;
use crate::diagnose::criteria::cross_validation::{PostureGap, size};
use crate::diagnose::data::checked::Checked;
use crate::diagnose::data::diagnosis::Gap;
use crate::diagnose::principles::{FEWEST_POSTURES, LEAST_HELD_OUT_RATIO, Size};
use crate::random::Random;
use std::collections::HashMap;

/// Bootstrap resamples over postures.
const RESAMPLES: Size = 400;

/// The gap before and after, its floor, and the share that is closed; `law_shifts` are mean squares by which errors
/// of the causes' laws may move the markers.
pub(crate) fn gap_over(
    before: &[PostureGap],
    after: &[PostureGap],
    floor: &Floor,
    law_shifts: &[f64],
    checked: Vec<Checked>,
) -> Gap {
    let (from, to) = (size(before), size(after));
    let bottom = floor.of(&floor.fitted, 0.0);
    let closed = closed(before, after, &floor.fitted, floor, 0.0, 0.0);
    Gap {
        before_m: from.told_m(),
        after_m: to.told_m(),
        noise_floor_m: to.told_m().map(|_| bottom.m),
        // Noise can make the figure slightly larger than 1.
        closed: closed.map(|c| c.min(1.0)),
        closed_ci95: closed.and_then(|_| interval(before, after, floor, law_shifts)),
        before_px: from.rms_px,
        after_px: to.rms_px,
        noise_floor_px: to.rms_px.map(|_| bottom.px),
        steps: Vec::new(),
        held_out_postures: after.len(),
        chosen_anew: None,
        checked,
    }
}

fn closed(
    before: &[PostureGap],
    after: &[PostureGap],
    fitted: &[PostureGap],
    floor: &Floor,
    deviation: f64,
    law_square: f64,
) -> Option<f64> {
    let (b, a, bottom) = (size(before), size(after), floor.of(fitted, deviation));
    let (before, after, bottom) = match (b.rms_px, a.rms_px) {
        (Some(before), Some(after)) => (before, after, bottom.px),
        _ => (b.rms_m, a.rms_m, bottom.m),
    };
    let after = after.hypot(law_square.sqrt());
    let room = before - bottom;
    // If the gap before does not differ from the floor on held-out regions, there is nothing to close.
    (room > (1.0 - LEAST_HELD_OUT_RATIO) * bottom).then(|| (before - after) / room)
}

/// 95 % interval by resampling postures with a fixed generator: gaps and floor from the same postures, the
/// independent estimate of the floor varied by its own uncertainty, and the laws by theirs.
///
/// The gap after already contains the laws' errors in the postures recorded, so it is as probable that they make it no
/// larger as that they do. If every resample made it larger, the interval could lie below the gap itself.
fn interval(
    before: &[PostureGap],
    after: &[PostureGap],
    floor: &Floor,
    law_shifts: &[f64],
) -> Option<[f64; 2]> {
    let fitted: HashMap<usize, PostureGap> = floor.fitted.iter().map(|g| (g.frame, *g)).collect();
    let both: HashMap<usize, PostureGap> = after.iter().map(|g| (g.frame, *g)).collect();
    let rows: Vec<[PostureGap; 3]> =
        before.iter().filter_map(|b| Some([*b, *both.get(&b.frame)?, *fitted.get(&b.frame)?])).collect();
    if rows.len() < FEWEST_POSTURES {
        return None;
    }
    let mut random = Random::new(0x2545_F491_4F6C_DD1D);
    let mut values: Vec<f64> = (0..RESAMPLES)
        .filter_map(|_| {
            let picked: Vec<[PostureGap; 3]> =
                (0..rows.len()).map(|_| rows[random.below(rows.len())]).collect();
            let of = |k: usize| picked.iter().map(|row| row[k]).collect::<Vec<_>>();
            let deviation = random.normal();
            closed(&of(0), &of(1), &of(2), floor, deviation, laws_err(law_shifts, &mut random))
        })
        .collect();
    values.sort_by(f64::total_cmp);
    let at = |share: f64| values.get(((values.len() as f64 - 1.0) * share).round() as usize).copied();
    Some([at(0.025)?.min(1.0), at(0.975)?.min(1.0)])
}

/// Mean square by which the laws' errors make the gap after larger in one resample.
fn laws_err(law_shifts: &[f64], random: &mut Random) -> f64 {
    if random.below(2) == 0 {
        return 0.0;
    }
    law_shifts.iter().map(|square| square * random.normal().powi(2)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn laws_make_the_gap_larger_in_half_of_the_resamples() {
        let mut random = Random::new(1);
        let drawn: Vec<f64> = (0..4000).map(|_| laws_err(&[1.0, 3.0], &mut random)).collect();
        let larger: Vec<f64> = drawn.iter().copied().filter(|square| *square > 0.0).collect();
        assert!(larger.len().abs_diff(2000) < 150, "{}", larger.len());
        let mean = larger.iter().sum::<f64>() / larger.len() as f64;
        assert!((mean - 4.0).abs() < 0.5, "{mean}");
    }
}
