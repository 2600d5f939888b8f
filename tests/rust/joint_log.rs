//! Moments of rest, and the offset between two clocks, on movements whose truth is known.

use mirror_core::joint_log::{JointLog, match_clocks, rests};
use proptest::prelude::*;

/// Two joints that hold a posture for `HOLD_S`, then go to the next in `MOVE_S` at constant speed.
const HOLD_S: f64 = 0.9;
const MOVE_S: f64 = 0.4;
/// Uneven, so that no two moves are alike.
const POSTURES: [[f64; 2]; 9] = [
    [0.0, 0.0],
    [0.3, -0.1],
    [0.5, 0.4],
    [-0.2, 0.3],
    [0.1, 0.9],
    [0.2, 0.1],
    [0.8, -0.4],
    [0.4, 0.4],
    [0.0, -0.3],
];

fn joints_at(time_s: f64) -> [f64; 2] {
    let beat = (time_s / (HOLD_S + MOVE_S)).max(0.0);
    let last = POSTURES.len() - 1;
    let (from, to) = ((beat as usize).min(last), (beat as usize + 1).min(last));
    let moved = ((beat.fract() * (HOLD_S + MOVE_S) - HOLD_S) / MOVE_S).clamp(0.0, 1.0);
    [0, 1].map(|j| POSTURES[from][j] + moved * (POSTURES[to][j] - POSTURES[from][j]))
}

fn times(step_s: f64) -> Vec<f64> {
    let length_s = POSTURES.len() as f64 * (HOLD_S + MOVE_S);
    (0..(length_s / step_s) as usize).map(|k| k as f64 * step_s).collect()
}

fn log() -> JointLog {
    let time_s = times(0.01);
    let positions = time_s.iter().flat_map(|&time| joints_at(time)).collect();
    JointLog::new(time_s, positions, 2).unwrap()
}

/// How much a picture of that time would differ from the one before: the second joint is farther from the camera.
fn motion(picture_s: &[f64], offset_s: f64) -> Vec<f64> {
    let seen = |time: f64| joints_at(time - offset_s);
    let change = |pair: &[f64]| {
        let (a, b) = (seen(pair[0]), seen(pair[1]));
        30.0 * (b[0] - a[0]).abs() + 12.0 * (b[1] - a[1]).abs()
    };
    core::iter::once(0.0).chain(picture_s.windows(2).map(change)).collect()
}

#[test]
fn rests_are_the_held_moments_in_their_order() {
    let found = rests(&log(), 0.003, 0.5).unwrap();
    assert_eq!(found.len(), POSTURES.len());
    for (index, rest) in found.iter().enumerate().take(POSTURES.len() - 1) {
        let begins = index as f64 * (HOLD_S + MOVE_S);
        assert!(
            (rest.start_s - begins).abs() < 0.02 && (rest.end_s - begins - HOLD_S).abs() < 0.02,
            "{rest:?}"
        );
    }
    // No rest is as long as that.
    assert_eq!(rests(&log(), 0.003, 2.5).unwrap(), []);
    assert!(rests(&log(), f64::NAN, 0.5).unwrap_err().to_string().contains("tolerance"));
    assert!(rests(&log(), 0.003, 0.0).unwrap_err().to_string().contains("duration"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Every joint stays within the tolerance in every rest, none overlaps another, and each is as long as it must be.
    #[test]
    fn a_rest_is_what_it_claims(seed in 0_u64..1_000, tolerance in 0.01..0.2_f64, least_s in 0.05..0.4_f64) {
        // A random walk that stands still now and then.
        let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
        let mut next = || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        let time_s = times(0.02);
        let mut at = [0.0, 0.0];
        let mut positions = Vec::new();
        for k in 0..time_s.len() {
            if (k / 20) % 3 != 0 {
                at = at.map(|x: f64| x + 0.05 * next());
            }
            positions.extend(at);
        }
        let log = JointLog::new(time_s.clone(), positions, 2).unwrap();
        let mut last_s = f64::NEG_INFINITY;
        for rest in rests(&log, tolerance, least_s).unwrap() {
            prop_assert!(rest.start_s > last_s && rest.end_s - rest.start_s >= least_s);
            last_s = rest.end_s;
            let rows = (0..time_s.len()).filter(|&i| (rest.start_s..=rest.end_s).contains(&time_s[i]));
            for joint in 0..2 {
                let values: Vec<f64> = rows.clone().map(|i| log.row(i)[joint]).collect();
                let (low, high) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &x| (a.min(x), b.max(x)));
                prop_assert!(high - low <= tolerance);
            }
        }
    }

    /// The offset is found to a third of the time between two pictures.
    #[test]
    fn the_offset_is_found(offset_s in -2.0..2.0_f64, per_s in 8.0..30.0_f64) {
        let picture_s: Vec<f64> = times(1.0 / per_s).iter().map(|t| t + 0.5 * offset_s).collect();
        let found = match_clocks(&log(), &picture_s, &motion(&picture_s, offset_s), 5.0).unwrap();
        prop_assert!(found.is_trusted(), "{:?}", found);
        prop_assert!((found.offset_s - offset_s).abs() < 0.34 / per_s, "{:?}, true {}", found, offset_s);
    }
}

#[test]
fn pictures_that_show_no_movement_say_nothing() {
    let (log, picture_s) = (log(), times(0.1));
    let still = match_clocks(&log, &picture_s, &vec![0.0; picture_s.len()], 5.0).unwrap();
    assert!(!still.is_trusted() && still.offset_s == 0.0);
    let few = match_clocks(&log, &[0.0, 1.0], &[0.0, 1.0], 5.0).unwrap();
    assert_eq!(few.correlation, 0.0);
    // Nothing but the sensor's noise.
    let noise: Vec<f64> = (0..picture_s.len()).map(|k| 1.0 + 0.1 * (7.3 * k as f64).sin()).collect();
    assert!(!match_clocks(&log, &picture_s, &noise, 5.0).unwrap().is_trusted());
    let told = match_clocks(&log, &picture_s, &noise[1..], 5.0).unwrap_err().to_string();
    assert!(told.contains("one a picture"), "{told}");
    assert!(match_clocks(&log, &picture_s, &vec![f64::NAN; picture_s.len()], 5.0).is_err());
    for most_s in [-1.0, -1e300, 1e300] {
        let told = match_clocks(&log, &picture_s, &noise, most_s).unwrap_err().to_string();
        assert!(told.contains("0 to 3600 s"), "{told}");
    }
    // Sums that overflow are no number.
    let far = JointLog::new(vec![0.0, 5.0, 11.0], vec![0.0, 1e300, -1e300], 1).unwrap();
    assert!(!match_clocks(&far, &picture_s, &noise, 5.0).unwrap().correlation.is_nan());
}
