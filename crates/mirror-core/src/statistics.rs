//! Medians, quantiles of the normal and of the chi-squared distribution, runs in a sequence, an evenly spread sequence,
//! and the least value of a function by golden sections.

/// (√5 − 1)/2. The fractional parts of its multiples are evenly spread whatever their number, without a period; it
/// is also the factor by which a golden-section search narrows its interval.
pub(crate) const GOLDEN_SECTION: f64 = 0.618_033_988_749_895;

/// The median of numbers, of an even count the upper of the two in the middle; 0 for none.
pub(crate) fn median(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// As [`median`], of an even count the mean of the two in the middle (infinite where one of them is).
pub(crate) fn median_of_both(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    let even = values.len().is_multiple_of(2);
    let (below, upper, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
    let lower = below.iter().copied().max_by(f64::total_cmp).filter(|_| even).unwrap_or(*upper);
    0.5 * (lower + *upper)
}

/// Where a function is least between two numbers, by so many golden sections; of two equal values the larger number's
/// side is kept.
///
/// # Errors
/// Those of the function.
pub(crate) fn least_between<E>(
    mut a: f64,
    mut b: f64,
    sections: usize,
    mut of: impl FnMut(f64) -> Result<f64, E>,
) -> Result<f64, E> {
    let (mut c, mut d) = (b - GOLDEN_SECTION * (b - a), a + GOLDEN_SECTION * (b - a));
    let (mut at_c, mut at_d) = (of(c)?, of(d)?);
    for _ in 0..sections {
        if at_c < at_d {
            (b, d, at_d) = (d, c, at_c);
            c = b - GOLDEN_SECTION * (b - a);
            at_c = of(c)?;
        } else {
            (a, c, at_c) = (c, d, at_d);
            d = a + GOLDEN_SECTION * (b - a);
            at_d = of(d)?;
        }
    }
    Ok(0.5 * (a + b))
}

/// The run with the largest sum (Kadane), first and last; none where no sum is positive.
pub(crate) fn best_run(gains: &[f64]) -> Option<(usize, usize)> {
    let (mut start, mut sum, mut best, mut top) = (0, 0.0, None, 0.0);
    for (f, gain) in gains.iter().enumerate() {
        if sum <= 0.0 {
            (start, sum) = (f, 0.0);
        }
        sum += gain;
        if sum > top {
            (best, top) = (Some((start, f)), sum);
        }
    }
    best
}

/// Φ⁻¹(p), the quantile of the standard normal distribution (Acklam's rational approximation, within 1.2e-9 of it relatively).
pub(crate) fn normal_quantile(p: f64) -> f64 {
    const A: [f64; 6] = [
        -3.969_683_028_665_376e1,
        2.209_460_984_245_205e2,
        -2.759_285_104_469_687e2,
        1.383_577_518_672_69e2,
        -3.066_479_806_614_716e1,
        2.506_628_277_459_239,
    ];
    const B: [f64; 5] = [
        -5.447_609_879_822_406e1,
        1.615_858_368_580_409e2,
        -1.556_989_798_598_866e2,
        6.680_131_188_771_972e1,
        -1.328_068_155_288_572e1,
    ];
    const C: [f64; 6] = [
        -7.784_894_002_430_293e-3,
        -3.223_964_580_411_365e-1,
        -2.400_758_277_161_838,
        -2.549_732_539_343_734,
        4.374_664_141_464_968,
        2.938_163_982_698_783,
    ];
    const D: [f64; 4] =
        [7.784_695_709_041_462e-3, 3.224_671_290_700_398e-1, 2.445_134_137_142_996, 3.754_408_661_907_416];
    const TAIL: f64 = 0.02425;
    let along = |c: &[f64], x: f64| c.iter().fold(0.0, |sum, k| sum * x + k);
    let tail = |p: f64| {
        let q = (-2.0 * p.ln()).sqrt();
        along(&C, q) / (along(&D, q) * q + 1.0)
    };
    if p < TAIL {
        tail(p)
    } else if p > 1.0 - TAIL {
        -tail(1.0 - p)
    } else {
        let q = p - 0.5;
        along(&A, q * q) * q / (along(&B, q * q) * q * q + 1.0)
    }
}

/// Φ(x), the standard normal distribution (Abramowitz and Stegun 26.2.17, within 8e-8).
pub(crate) fn normal_below(x: f64) -> f64 {
    const B: [f64; 5] = [1.330_274_429, -1.821_255_978, 1.781_477_937, -0.356_563_782, 0.319_381_530];
    let t = 1.0 / (1.0 + 0.231_641_9 * x.abs());
    let density = (-0.5 * x * x).exp() / core::f64::consts::TAU.sqrt();
    let above = density * t * B.iter().fold(0.0, |sum, b| sum * t + b);
    if x < 0.0 { above } else { 1.0 - above }
}

/// Medians of chi-squared of one, two and three degrees of freedom.
pub(crate) const CHI_SQUARED_MEDIANS: [f64; 3] = [0.454_936, 1.386_294, 2.365_974];

/// Chi-squared as a standard normal deviate, by Wilson and Hilferty's cube root.
pub(crate) fn chi_squared_deviate(chi_squared: f64, degrees_of_freedom: f64) -> f64 {
    let spread = 2.0 / (9.0 * degrees_of_freedom);
    ((chi_squared / degrees_of_freedom).cbrt() - (1.0 - spread)) / spread.sqrt()
}

/// The quantile of χ²/k whose standard normal deviate is z, by Wilson and Hilferty's cube root: `(1 − s + z √s)³`, `s = 2/(9 k)`.
pub(crate) fn reduced_chi_squared_at(z: f64, degrees_of_freedom: f64) -> f64 {
    let spread = 2.0 / (9.0 * degrees_of_freedom);
    (1.0 - spread + z * spread.sqrt()).max(0.0).powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn the_normal_distribution_is_the_inverse_of_its_quantile() {
        for p in [1e-6, 0.001, 0.025, 0.2, 0.5, 0.7, 0.95, 0.999, 1.0 - 1e-6] {
            approx::assert_abs_diff_eq!(normal_below(normal_quantile(p)), p, epsilon = 1e-7);
        }
        assert_eq!((normal_below(-40.0), normal_below(40.0)), (0.0, 1.0));
    }

    #[test]
    fn the_median_of_an_even_count_lies_between_the_two_in_the_middle() {
        assert_eq!(median_of_both(vec![4.0, 1.0, 3.0, 10.0]), 3.5);
        assert_eq!(median_of_both(vec![4.0, 1.0, 10.0]), 4.0);
        assert_eq!(median_of_both(vec![f64::INFINITY, 1.0]), f64::INFINITY);
        assert_eq!(median_of_both(vec![]), 0.0);
    }

    #[test]
    fn golden_sections_find_the_least_value_and_hand_errors_on() {
        let found = least_between(-1.0, 2.0, 40, |x| Ok::<_, ()>((x - 0.3).powi(2)));
        assert!(found.is_ok_and(|at| (at - 0.3).abs() < 1e-7));
        // Where all is equal the larger number's side is kept.
        assert!(least_between(0.0, 1.0, 30, |_| Ok::<_, ()>(f64::INFINITY)).is_ok_and(|at| at > 0.999));
        assert_eq!(least_between(0.0, 1.0, 30, |x| if x > 0.9 { Err("late") } else { Ok(-x) }), Err("late"));
    }

    #[test]
    fn quantiles_are_those_of_the_tables() {
        for (p, z) in
            [(0.5, 0.0), (0.975, 1.959_964), (0.99, 2.326_348), (1e-3, -3.090_232), (1e-6, -4.753_424)]
        {
            assert_relative_eq!(normal_quantile(p), z, epsilon = 1e-5);
        }
    }

    #[test]
    fn chi_squared_deviates_are_near_those_of_the_tables() {
        // 0.1 % points of chi-squared: 10.83, 16.27, 29.59 for 1, 3, 10.
        for (x, k) in [(10.83, 1.0), (16.27, 3.0), (29.59, 10.0)] {
            assert_relative_eq!(chi_squared_deviate(x, k), 3.09, epsilon = 0.12);
        }
    }

    #[test]
    fn quantiles_and_deviates_of_chi_squared_are_each_others_inverse() {
        for (z, k) in [(0.524, 2.0), (-1.0, 7.5), (3.0, 40.0)] {
            assert_relative_eq!(chi_squared_deviate(k * reduced_chi_squared_at(z, k), k), z, epsilon = 1e-12);
        }
    }
}
