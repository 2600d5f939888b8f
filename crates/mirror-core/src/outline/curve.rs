//! Levels and light, and how far the sum of a blurred edge is displaced where light mixes on another scale than the
//! values are on.

use std::sync::LazyLock;

/// Levels are about this root of linear light.
const ENCODING_POWER: f64 = 2.2;
/// Steps of the tables below, and the light up to which they reach.
const TABLE_STEPS: usize = 2048;
const TABLE_LIGHT: f64 = 4.0;

/// Levels at evenly spaced roots of light: the curve is steep in the dark, and a square root removes most of that.
static LEVELS: LazyLock<Vec<f64>> = LazyLock::new(|| {
    let root = |i: usize| TABLE_LIGHT.sqrt() * i as f64 / TABLE_STEPS as f64;
    (0..=TABLE_STEPS).map(|i| root(i).powf(2.0 / ENCODING_POWER)).collect()
});

/// Light at evenly spaced levels, 0..1.
static LIGHT: LazyLock<Vec<f64>> = LazyLock::new(|| {
    (0..=TABLE_STEPS).map(|i| (i as f64 / TABLE_STEPS as f64).powf(ENCODING_POWER)).collect()
});

/// A camera's own curve may differ from sRGB's by this power.
pub(super) const CURVE_DOUBT: f64 = 1.085;

/// That power of evenly spaced values of 0..1, and its root.
static POWERS: LazyLock<[Vec<f64>; 2]> = LazyLock::new(|| {
    [CURVE_DOUBT, CURVE_DOUBT.recip()]
        .map(|power| (0..=TABLE_STEPS).map(|i| (i as f64 / TABLE_STEPS as f64).powf(power)).collect())
});

fn between(table: &[f64], place: f64) -> f64 {
    let low = (place as usize).min(TABLE_STEPS - 1);
    table[low] + (place - low as f64) * (table[low + 1] - table[low])
}

/// The level (0..1 for light of 0..1) of linear light, within 1e-6: a power costs ten times as much, and a ball
/// needs some ten thousand.
#[inline]
pub(super) fn level_of(light: f64) -> f64 {
    if light >= TABLE_LIGHT {
        return light.powf(ENCODING_POWER.recip());
    }
    between(&LEVELS, (light.max(0.0) / TABLE_LIGHT).sqrt() * TABLE_STEPS as f64)
}

/// The linear light of a level of 0..1, within 1e-6.
#[inline]
pub(super) fn light_of(level: f64) -> f64 {
    between(&LIGHT, level.clamp(0.0, 1.0) * TABLE_STEPS as f64)
}

/// Shares of a step's light at places so many blurs apart across it.
const SHARES: [f64; 11] =
    [0.0062, 0.0228, 0.0668, 0.1587, 0.3085, 0.5, 0.6915, 0.8413, 0.9332, 0.9772, 0.9938];
const SHARES_STEP: f64 = 0.5;
/// Channels whose values differ by less do not determine an edge.
const LEAST_STEP: f64 = 1e-3;

/// Shift of the covered length between two values of a channel, in blurs: `∫ g(Φ(−x)) − Φ(−x) dx`, g(w) the share that the channel's value shows at the share w of
/// the mixture. `mixing` is the mixing quantity of a value, `shown` the value of it.
fn moved(own: f64, other: f64, mixing: impl Fn(f64) -> f64, shown: impl Fn(f64) -> f64) -> f64 {
    if (own - other).abs() < LEAST_STEP {
        return 0.0;
    }
    let (mixed_own, mixed_other) = (mixing(own), mixing(other));
    let more: f64 = SHARES
        .iter()
        .map(|share| {
            let value = shown(share * mixed_own + (1.0 - share) * mixed_other);
            (value - other) / (own - other) - share
        })
        .sum();
    more * SHARES_STEP
}

/// That shift of each channel where the camera's curve differs from sRGB's by one deviation, in blurs.
pub(super) fn moved_by_another_curve(ball: &[f64; 3], behind: &[f64; 3]) -> [f64; 3] {
    let [mixed, shown] = &*POWERS;
    let read = |table: &[f64], value: f64| between(table, value.clamp(0.0, 1.0) * TABLE_STEPS as f64);
    core::array::from_fn(|c| {
        moved(ball[c], behind[c], |value| read(mixed, value), |light| read(shown, light))
    })
}

/// The shift where light mixes and values are levels, in blurs: the channels' own by their parts in what is read.
pub(super) fn moved_by_light(ball: &[f64; 3], behind: &[f64; 3], channels: &[f64; 3]) -> f64 {
    (0..3).map(|c| channels[c] * moved(ball[c], behind[c], light_of, level_of)).sum()
}
