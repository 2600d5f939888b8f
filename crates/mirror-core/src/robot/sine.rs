//! Sines and cosines of several angles at once, in code that every compiler turns into vector instructions.
//!
//! Angles are reduced by multiples of π/2 held in three parts (Cody and Waite), then the polynomials of FreeBSD's
//! msun (`k_sin.c`, `k_cos.c`) apply on [−π/4, π/4]. No branch, no table, no fused multiply-add: the same bits on every machine.

/// Beyond this angle, rad, the reduction loses digits, and the standard library takes over.
const LARGEST_ANGLE: f64 = 1e5;

const TWO_OVER_PI: f64 = core::f64::consts::FRAC_2_PI;
/// π/2 in three parts of 33 bits and a rest: a product with an integer below 2^20 is exact.
const PI_2_HIGH: f64 = 1.570_796_326_734_125_6;
const PI_2_MIDDLE: f64 = 6.077_100_506_303_966e-11;
const PI_2_LOW: f64 = 2.022_266_248_795_950_6e-21;
/// 1.5 · 2^52: adding it rounds to the nearest integer, which is then in the lowest bits.
const ROUNDER: f64 = 6_755_399_441_055_744.0;

const S: [f64; 6] = [
    -1.666_666_666_666_663_2e-1,
    8.333_333_333_322_49e-3,
    -1.984_126_982_985_795e-4,
    2.755_731_370_707_006_8e-6,
    -2.505_076_025_340_686_3e-8,
    1.589_690_995_211_55e-10,
];
const C: [f64; 6] = [
    4.166_666_666_666_66e-2,
    -1.388_888_888_887_411e-3,
    2.480_158_728_947_673e-5,
    -2.755_731_435_139_066_3e-7,
    2.087_572_321_298_175e-9,
    -1.135_964_755_778_819_5e-11,
];

/// Sine and cosine of one angle of moderate size, rad.
#[inline(always)]
fn reduced(angle: f64) -> (f64, f64) {
    let rounded = angle * TWO_OVER_PI + ROUNDER;
    let quarter_turns = rounded - ROUNDER;
    let r = ((angle - quarter_turns * PI_2_HIGH) - quarter_turns * PI_2_MIDDLE) - quarter_turns * PI_2_LOW;
    let r2 = r * r;
    let sine = r + r * r2 * (S[0] + r2 * (S[1] + r2 * (S[2] + r2 * (S[3] + r2 * (S[4] + r2 * S[5])))));
    let half = 0.5 * r2;
    let tail = r2 * r2 * (C[0] + r2 * (C[1] + r2 * (C[2] + r2 * (C[3] + r2 * (C[4] + r2 * C[5])))));
    let base = 1.0 - half;
    let cosine = base + ((1.0 - base - half) + tail);
    // The quadrant, from the integer's lowest bits: odd ones exchange sine and cosine, signs follow.
    let bits = rounded.to_bits();
    let exchange = (bits & 1).wrapping_neg();
    let (s, c) = (sine.to_bits(), cosine.to_bits());
    let sine = (s & !exchange) | (c & exchange);
    let cosine = (c & !exchange) | (s & exchange);
    let sine_sign = (bits & 2) << 62;
    let cosine_sign = (bits.wrapping_add(1) & 2) << 62;
    (f64::from_bits(sine ^ sine_sign), f64::from_bits(cosine ^ cosine_sign))
}

/// Sines and cosines of `angles` (rad) into slices of the same length; within 2 units in the last place.
#[inline(always)]
pub(super) fn sines_cosines(angles: &[f64], sines: &mut [f64], cosines: &mut [f64]) {
    let count = angles.len().min(sines.len()).min(cosines.len());
    let (angles, sines, cosines) = (&angles[..count], &mut sines[..count], &mut cosines[..count]);
    let mut beyond = 0;
    for i in 0..count {
        (sines[i], cosines[i]) = reduced(angles[i]);
        // An integer: a largest angle in floating point would keep the loop from becoming vector instructions.
        beyond |= u64::from(angles[i].abs() > LARGEST_ANGLE);
    }
    if beyond != 0 {
        for i in 0..count {
            (sines[i], cosines[i]) = angles[i].sin_cos();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::sines_cosines;

    #[test]
    fn agrees_with_the_standard_library() {
        let mut angles: Vec<f64> = (0..200_001).map(|i| f64::from(i - 100_000) * 1.234_567e-3).collect();
        angles.extend((-40..=40).map(|k| f64::from(k) * core::f64::consts::FRAC_PI_4));
        angles.extend([0.0, -0.0, 1e-300, -1e-9, 99_999.5, -99_999.5]);
        for scale in [1.0, 1e-3, 700.0] {
            let scaled: Vec<f64> = angles.iter().map(|a| a * scale).collect();
            let (mut s, mut c) = (vec![0.0; scaled.len()], vec![0.0; scaled.len()]);
            sines_cosines(&scaled, &mut s, &mut c);
            for (i, a) in scaled.iter().enumerate() {
                assert!((s[i] - a.sin()).abs() < 3e-16, "sin {a}: {} against {}", s[i], a.sin());
                assert!((c[i] - a.cos()).abs() < 3e-16, "cos {a}: {} against {}", c[i], a.cos());
            }
        }
    }
}
