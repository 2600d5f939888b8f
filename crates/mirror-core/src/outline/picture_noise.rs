//! The noise of a picture: how much there is, how far it is correlated, and how much a noisy picture is smoothed.
//!
//! A camera's white noise is not correlated. Where colours are made of a sensor's mosaic (Bayer), two thirds of the
//! values are interpolated, and so is their noise: neighbours differ by less than it, and the mean of many pixels has more of it.

/// Noise from which a picture is smoothed before edges are read (levels): by more where its values differ by less than so much. The most that it is smoothed (px).
const NOISY_LEVELS: f64 = 6.0;
const USUAL_SPREAD_LEVELS: f64 = 60.0;
const MOST_SMOOTHING_PX: f64 = 1.4;
/// Noise of neighbours in a mosaic's colours is correlated; over so many px it hardly is. Less correlation than this is chance.
const BEYOND_MOSAIC_PX: usize = 3;
const LEAST_CORRELATION: f64 = 0.15;

/// What is done about the noise of a part of a picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Noise {
    /// Standard deviation of the Gaussian by which it is smoothed, px; 0 where there is little noise.
    pub smoothing_px: f64,
    /// That of the Gaussian which gives white noise the correlation that this noise has by itself, px; 0 where there is little noise.
    pub reach_px: f64,
}

impl Noise {
    /// Of levels (blue, green, red) in rows.
    pub fn of(levels: &[[u8; 3]], (width, height): (usize, usize), coded: bool) -> Self {
        let near = noise_levels(levels, width, height, 1);
        // A codec's own errors reach farther than a mosaic's.
        let noise =
            if coded { near } else { near.max(noise_levels(levels, width, height, BEYOND_MOSAIC_PX)) };
        if noise <= NOISY_LEVELS {
            return Self { smoothing_px: 0.0, reach_px: 0.0 };
        }
        // The covered length does not mind a blur, and noise does.
        let spread = spread_levels(levels).clamp(1.0, USUAL_SPREAD_LEVELS);
        let smoothing_px = MOST_SMOOTHING_PX.min(0.5 * noise / NOISY_LEVELS * USUAL_SPREAD_LEVELS / spread);
        Self { smoothing_px, reach_px: reach_px(near, noise) }
    }

    /// The Gaussian that gives white noise the correlation of the smoothed noise, px.
    pub fn correlation_px(&self) -> f64 {
        self.smoothing_px.hypot(self.reach_px)
    }
}

/// How far apart the darkest and the brightest tenth of the values of a channel are, levels; of the channel where that is most.
fn spread_levels(levels: &[[u8; 3]]) -> f64 {
    let tenth = levels.len() / 10;
    let of_channel = |channel: usize| {
        let mut counts = [0usize; 256];
        for pixel in levels {
            counts[usize::from(pixel[channel])] += 1;
        }
        let below = |most: usize| {
            let mut sum = 0;
            counts.iter().position(|count| {
                sum += count;
                sum > most
            })
        };
        let (low, high) = (below(tenth), below(levels.len() - tenth.min(levels.len())));
        high.unwrap_or(255).saturating_sub(low.unwrap_or(0))
    };
    (0..3).map(of_channel).max().unwrap_or(0) as f64
}

/// Standard deviation of the noise of a channel, levels: the median of mixed differences over some px, which shading and edges hardly touch.
fn noise_levels(levels: &[[u8; 3]], width: usize, height: usize, over_px: usize) -> f64 {
    if width.min(height) < over_px + 2 {
        return 0.0;
    }
    let mut counts = [0u32; 1021];
    for (here, below) in levels.chunks_exact(width).zip(levels[over_px * width..].chunks_exact(width)) {
        for (here, below) in here.windows(over_px + 1).zip(below.windows(over_px + 1)) {
            let rise = |pair: &[[u8; 3]]| i32::from(pair[over_px][1]) - i32::from(pair[0][1]);
            counts[(rise(below) - rise(here)).unsigned_abs() as usize] += 1;
        }
    }
    // The median within its level, as if the levels' values were spread evenly.
    let half = 0.5 * ((width - over_px) * (height - over_px)) as f64;
    let mut below = 0.0;
    for (level, count) in counts.iter().enumerate() {
        let count = f64::from(*count);
        if below + count >= half && count > 0.0 {
            return level as f64 / 0.6745 / 2.0;
        }
        below += count;
    }
    0.0
}

/// The Gaussian smoothing that gives white noise the same standard deviations by mixed differences over one and over more px: the
/// noise's correlation over a distance d is `ρ = exp(−d² / 4σ²)`, and a mixed difference shows `1 − ρ` of its deviation. So `σ² = −1 / (4 ln ρ)`, `ρ = 1 − near / far`, where that over more px is beyond the correlation.
fn reach_px(near: f64, far: f64) -> f64 {
    let correlation = 1.0 - near / far;
    if correlation > LEAST_CORRELATION { (-0.25 / correlation.ln()).sqrt() } else { 0.0 }
}

/// Gaussian blur of a plane, in place; the border is mirrored.
pub(super) fn smooth(plane: &mut [f32], width: usize, height: usize, sigma_px: f64) {
    if sigma_px <= 0.0 || width < 2 || height < 2 {
        return;
    }
    let reach = (4.0 * sigma_px).ceil() as usize;
    let raw: Vec<f64> =
        (0..=2 * reach).map(|i| (-0.5 * ((i as f64 - reach as f64) / sigma_px).powi(2)).exp()).collect();
    let total: f64 = raw.iter().sum();
    let kernel: Vec<f32> = raw.iter().map(|k| (k / total) as f32).collect();
    // Places of a line that is longer by the reach at both of its ends.
    let mirrored = |size: usize| -> Vec<usize> {
        let period = 2 * (size as isize - 1);
        (0..size + 2 * reach)
            .map(|i| (i as isize - reach as isize).rem_euclid(period))
            .map(|folded| folded.min(period - folded) as usize)
            .collect()
    };
    let add = |sums: &mut [f32], share: f32, values: &[f32]| {
        for (sum, value) in sums.iter_mut().zip(values) {
            *sum += share * value;
        }
    };
    let mut wide = vec![0.0f32; plane.len()];
    let across = mirrored(width);
    let mut longer = vec![0.0f32; across.len()];
    for (row, sums) in plane.chunks_exact(width).zip(wide.chunks_exact_mut(width)) {
        for (value, place) in longer.iter_mut().zip(&across) {
            *value = row[*place];
        }
        for (i, share) in kernel.iter().enumerate() {
            add(sums, *share, &longer[i..i + width]);
        }
    }
    let down = mirrored(height);
    for (row, sums) in plane.chunks_exact_mut(width).enumerate() {
        sums.fill(0.0);
        for (share, place) in kernel.iter().zip(&down[row..]) {
            add(sums, *share, &wide[place * width..(place + 1) * width]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    const SIDE: usize = 96;
    const STD_LEVELS: f64 = 12.0;

    /// Grey with white noise.
    fn white(random: &mut Random) -> Vec<f64> {
        (0..SIDE * SIDE).map(|_| 120.0 + STD_LEVELS * random.normal()).collect()
    }

    fn levels(values: &[f64]) -> Vec<[u8; 3]> {
        values.iter().map(|v| [v.round().clamp(0.0, 255.0) as u8; 3]).collect()
    }

    #[test]
    fn white_noise_is_told_at_its_size_and_without_correlation() {
        let pixels = levels(&white(&mut Random::new(3)));
        for over_px in [1, BEYOND_MOSAIC_PX] {
            let told = noise_levels(&pixels, SIDE, SIDE, over_px);
            assert!((told / STD_LEVELS - 1.0).abs() < 0.08, "{over_px}: {told}");
        }
        let noise = Noise::of(&pixels, (SIDE, SIDE), false);
        assert!(noise.reach_px == 0.0 && noise.smoothing_px > 0.9, "{noise:?}");
        assert!(noise.correlation_px() == noise.smoothing_px);
    }

    #[test]
    fn smoothed_noise_is_told_at_its_own_size_with_its_reach() {
        for sigma_px in [0.6, 0.8] {
            let mut plane: Vec<f32> =
                white(&mut Random::new(5)).iter().map(|v| 4.0 * (*v as f32 - 120.0)).collect();
            smooth(&mut plane, SIDE, SIDE, sigma_px);
            let std = (plane.iter().map(|v| f64::from(v * v)).sum::<f64>() / plane.len() as f64).sqrt();
            let pixels = levels(&plane.iter().map(|v| 120.0 + f64::from(*v)).collect::<Vec<_>>());
            let told = noise_levels(&pixels, SIDE, SIDE, BEYOND_MOSAIC_PX);
            assert!((told / std - 1.0).abs() < 0.06, "{told} for {std}");
            let noise = Noise::of(&pixels, (SIDE, SIDE), false);
            assert!((noise.reach_px / sigma_px - 1.0).abs() < 0.15, "{noise:?} for {sigma_px}");
        }
    }

    #[test]
    fn the_mean_of_a_mosaics_noise_scatters_as_its_reach_tells() {
        // Every other value of a row and every other row is measured; the rest is the mean of its neighbours.
        let (mut told, mut squares, mut variance, mut count) = (0.0, 0.0, 0.0, 0.0);
        for seed in 0..40 {
            let raw = white(&mut Random::new(100 + seed));
            let at = |row: usize, column: usize| {
                let near = |i: usize| [i - i % 2, (i + i % 2).min(SIDE - 2)];
                let (rows, columns) = (near(row), near(column));
                rows.iter().flat_map(|r| columns.map(|c| raw[r * SIDE + c])).sum::<f64>() / 4.0
            };
            let mosaic: Vec<f64> = (0..SIDE * SIDE).map(|i| at(i / SIDE, i % SIDE)).collect();
            told += Noise::of(&levels(&mosaic), (SIDE, SIDE), false).reach_px / 40.0;
            for part in mosaic.chunks_exact(16 * SIDE) {
                for column in (0..SIDE).step_by(16) {
                    let rows = part.chunks_exact(SIDE).map(|row| &row[column..column + 16]);
                    let sum: f64 = rows.flatten().map(|v| v - 120.0).sum();
                    squares += (sum / 256.0).powi(2);
                    count += 1.0;
                }
            }
            variance += mosaic.iter().map(|v| (v - 120.0).powi(2)).sum::<f64>() / mosaic.len() as f64 / 40.0;
        }
        // Noise under a Gaussian of σ is worth one number in (2 √π σ)² pixels.
        let worth = squares / count * 256.0 / variance;
        let by_reach = 4.0 * core::f64::consts::PI * told * told;
        assert!(
            (by_reach / worth - 1.0).abs() < 0.35,
            "{worth} pixels are one number, {by_reach} by a reach of {told} px"
        );
    }
}
