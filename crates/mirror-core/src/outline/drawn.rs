//! A chessboard's pattern as a picture shows it without a lens: 1 and −1 by square, edges averaged over each pixel.

use multiversion::multiversion;
use nalgebra::Matrix3;

/// Samples a pixel each way.
const FINE: usize = 2;

/// The pattern `(height, width)`, rows of pixels from a `first` one (u, v) on; `grid_from_px` takes pixels to places on the board, in squares, with a corner of four
/// squares at each whole number.
pub fn drawn_pattern(
    grid_from_px: &Matrix3<f64>,
    first: [f64; 2],
    (width, height): (usize, usize),
) -> Vec<f32> {
    let places = |first: f64, count: usize| -> Vec<f64> {
        (0..count * FINE).map(|i| first + (i as f64 + 0.5) / FINE as f64 - 0.5).collect()
    };
    let (across, down) = (places(first[0], width), places(first[1], height));
    let mut samples = vec![0.0; across.len()];
    let mut pattern = Vec::with_capacity(width * height);
    let mut sums = vec![0.0; width];
    for lines in down.chunks_exact(FINE) {
        sums.fill(0.0);
        for v in lines {
            sample_line(grid_from_px, &across, *v, &mut samples);
            for (sum, samples) in sums.iter_mut().zip(samples.chunks_exact(FINE)) {
                *sum += samples.iter().sum::<f64>();
            }
        }
        pattern.extend(sums.iter().map(|sum| (sum / (FINE * FINE) as f64) as f32));
    }
    pattern
}

/// The pattern at places of a line of the picture, its edges as wide as a sample: their places are kept to more than that.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn sample_line(grid_from_px: &Matrix3<f64>, across: &[f64], v: f64, samples: &mut [f64]) {
    let h = grid_from_px;
    for (sample, u) in samples.iter_mut().zip(across) {
        let depth = h[(2, 0)] * u + h[(2, 1)] * v + h[(2, 2)];
        let mut product = 1.0;
        for row in 0..2 {
            let cell = (h[(row, 0)] * u + h[(row, 1)] * v + h[(row, 2)]) / depth;
            let (by_u, by_v) = (h[(row, 0)] - cell * h[(2, 0)], h[(row, 1)] - cell * h[(2, 1)]);
            let slope = (by_u * by_u + by_v * by_v).sqrt() / depth.abs();
            // A triangle wave has the squares' signs; cut at half a sample from where it is zero.
            let half = cell + 0.5;
            let wave = (half - 2.0 * (0.5 * half).floor() - 1.0).abs() - 0.5;
            product *= (wave * (2 * FINE) as f64 / slope).clamp(-1.0, 1.0);
        }
        *sample = product;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_alternate_from_corner_to_corner_and_a_pixel_on_an_edge_is_half_of_each() {
        // Squares of 4 px, a corner of four in the middle of pixel (4, 4).
        let grid_from_px = Matrix3::new(0.25, 0.0, -1.0, 0.0, 0.25, -1.0, 0.0, 0.0, 1.0);
        let pattern = drawn_pattern(&grid_from_px, [0.0, 0.0], (9, 9));
        let at = |u: usize, v: usize| pattern[v * 9 + u];
        assert_eq!((at(2, 2), at(6, 2), at(2, 6), at(6, 6)), (1.0, -1.0, -1.0, 1.0));
        assert!((at(4, 2).abs() < 1e-6) && (at(2, 4).abs() < 1e-6) && (at(4, 4).abs() < 1e-6));
        // The same part, from another pixel on.
        let part = drawn_pattern(&grid_from_px, [3.0, 2.0], (4, 5));
        assert!((0..5).all(|v| (0..4).all(|u| part[v * 4 + u] == at(u + 3, v + 2))));
    }
}
