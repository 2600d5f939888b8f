//! Reproducible random numbers for resampling and drawing: a linear congruential generator.

/// Knuth's MMIX generator ("The Art of Computer Programming", fascicle 1, 1999): `x ← a x + c mod 2⁶⁴`, of which the high bits are used.
pub(crate) struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        self.0
    }

    /// One of 0, 1, … `count` − 1; 0 where there are none.
    pub fn below(&mut self, count: usize) -> usize {
        (self.next() >> 33) as usize % count.max(1)
    }

    /// Uniform from 0 to 1, 1 left out.
    pub fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Standard normal: twelve uniform numbers less their mean.
    pub fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.unit()).sum::<f64>() - 6.0
    }
}

#[cfg(test)]
mod tests {
    use super::Random;

    const DRAWS: usize = 20_000;

    fn moments(draw: impl FnMut() -> f64) -> (f64, f64) {
        let values: Vec<f64> = std::iter::repeat_with(draw).take(DRAWS).collect();
        let mean = values.iter().sum::<f64>() / DRAWS as f64;
        (mean, values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / DRAWS as f64)
    }

    #[test]
    fn the_sequence_is_that_of_mmix() {
        let mut random = Random::new(1);
        assert_eq!(random.next(), 7_806_831_264_735_756_412);
        assert_eq!(random.next(), 9_396_908_728_118_811_419);
    }

    #[test]
    fn numbers_are_spread_as_they_say() {
        let mut random = Random::new(7);
        let (mean, variance) = moments(|| random.unit());
        assert!((mean - 0.5).abs() < 0.01 && (variance - 1.0 / 12.0).abs() < 0.002, "{mean} {variance}");
        let (mean, variance) = moments(|| random.normal());
        assert!(mean.abs() < 0.03 && (variance - 1.0).abs() < 0.03, "{mean} {variance}");
        let mut counts = [0; 5];
        (0..DRAWS).for_each(|_| counts[random.below(5)] += 1);
        assert!(counts.iter().all(|c| (3800..4200).contains(c)), "{counts:?}");
        assert_eq!(random.below(0), 0);
    }
}
