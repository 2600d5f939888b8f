//! How far a blurred edge's sum is moved where light mixes on another scale than the values are on.

/// Shares of a step's light at places so many blurs apart across it.
const SHARES: [f64; 11] =
    [0.0062, 0.0228, 0.0668, 0.1587, 0.3085, 0.5, 0.6915, 0.8413, 0.9332, 0.9772, 0.9938];
const SHARES_STEP: f64 = 0.5;
/// Channels whose values differ by less tell nothing of an edge.
const LEAST_STEP: f64 = 1e-3;

/// Shift of the covered length between two colours, in blurs: `Σ_c p_c ∫ g_c(Φ(−x)) − Φ(−x) dx`, g_c(w) the share that a channel's value shows at the share w of
/// what mixes, its value to the given power; p_c the channel's part in what is summed.
pub(super) fn moved_by_mixing(ball: &[f64; 3], behind: &[f64; 3], channels: &[f64; 3], power: f64) -> f64 {
    let mixing = |value: f64| value.clamp(0.0, 1.0).powf(power);
    let mut moved = 0.0;
    for c in 0..3 {
        let (own, other) = (ball[c], behind[c]);
        if (own - other).abs() < LEAST_STEP {
            continue;
        }
        let more: f64 = SHARES
            .iter()
            .map(|share| {
                let value = (share * mixing(own) + (1.0 - share) * mixing(other)).powf(power.recip());
                (value - other) / (own - other) - share
            })
            .sum();
        moved += channels[c] * more;
    }
    moved * SHARES_STEP
}
