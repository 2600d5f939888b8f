//! Surroundings of a ball, coded once more as the file's JPEG was, on a grid of blocks that is moved.
//!
//! What a baseline JPEG loses (ITU-T T.81): brightness and colour differences (ITU-R BT.601), colour averaged over the pixels that share it, the cosine
//! transform of blocks of 8 × 8 samples `F = C f Cᵀ`, and each coefficient rounded to a multiple of its step. Entropy coding loses nothing and is left out. The
//! decoder interpolates colour between samples linearly, as libjpeg does.

use super::patch::Picture;
use multiversion::multiversion;
use std::sync::LazyLock;

/// Side of a block, samples.
pub(super) const BLOCK: usize = 8;
const SIZE: usize = BLOCK * BLOCK;
type Block = [f32; SIZE];
/// Side of the largest unit, pixels.
const WIDEST: usize = 2 * BLOCK;
/// Pixels of a unit.
pub(super) type Decoded = [[[u8; 3]; WIDEST]; WIDEST];
/// So many blocks are transformed together.
const LANES: usize = 32;
/// Samples of blocks, each of all of them.
type Blocks = [[f32; LANES]; SIZE];
/// A block's samples and those around it.
type Samples = [[f32; BLOCK + 2]; BLOCK + 2];

/// How a JPEG was coded: the steps of its coefficients, row by row, and the pixels across and down that share a colour.
#[derive(Debug, Clone, PartialEq)]
pub struct Codec {
    luma_steps: Block,
    chroma_steps: Block,
    sampling: (usize, usize),
}

/// The cosine transform's matrix: row k is `√(2/8) cos((2 n + 1) k π / 16)`, the first `√(1/8)`.
static COSINES: LazyLock<Block> = LazyLock::new(|| {
    core::array::from_fn(|i| {
        let (k, n) = ((i / BLOCK) as f64, (i % BLOCK) as f64);
        let size = if k == 0.0 { 0.125f64 } else { 0.25 }.sqrt();
        (size * ((2.0 * n + 1.0) * k * core::f64::consts::PI / 16.0).cos()) as f32
    })
});

impl Codec {
    /// By tables of steps (levels, at least 1; row by row) of brightness and colour; None where a step is 0 or the sampling is not 1 or 2 each way.
    pub fn new(luma: &[u16; SIZE], chroma: &[u16; SIZE], sampling: (usize, usize)) -> Option<Self> {
        let fits = luma.iter().chain(chroma).all(|step| *step > 0)
            && [sampling.0, sampling.1].iter().all(|step| [1, 2].contains(step));
        fits.then(|| Self { luma_steps: luma.map(f32::from), chroma_steps: chroma.map(f32::from), sampling })
    }

    /// Pixels across and down that share a colour.
    pub(super) fn sampling(&self) -> (usize, usize) {
        self.sampling
    }

    /// Pixels across and down of a unit, the least part that is coded alone.
    pub(super) fn unit(&self) -> [usize; 2] {
        [BLOCK * self.sampling.0, BLOCK * self.sampling.1]
    }

    /// Codes the units from pixels of the planes on.
    pub(super) fn code_units(&self, planes: &mut Planes, units: &[[usize; 2]]) {
        let (across, down) = self.sampling;
        let parts = (0..down).flat_map(|v| (0..across).map(move |u| (u * BLOCK, v * BLOCK)));
        let luma: Vec<(usize, usize)> =
            parts.flat_map(|(u, v)| units.iter().map(move |[x, y]| (x + u, y + v))).collect();
        code_blocks(&mut planes.luma, planes.width, &luma, &self.luma_steps);
        let chroma: Vec<(usize, usize)> = units.iter().map(|[x, y]| (x / across, y / down)).collect();
        for plane in &mut planes.chroma {
            code_blocks(plane, planes.width / across, &chroma, &self.chroma_steps);
        }
    }
}

/// Brightness by pixel and colour differences by sample, levels around 0.
#[derive(Clone)]
pub(super) struct Planes {
    width: usize,
    height: usize,
    luma: Vec<f32>,
    chroma: [Vec<f32>; 2],
}

impl Planes {
    /// Of a rectangle from a corner on; beyond the picture's border as on it.
    pub fn of(
        picture: &Picture<'_>,
        (u0, v0): (isize, isize),
        (width, height): (usize, usize),
        (across, down): (usize, usize),
    ) -> Self {
        let (columns, rows) = (width / across, height / down);
        let mut luma = Vec::with_capacity(width * height);
        let mut chroma = [vec![0.0f32; columns * rows], vec![0.0f32; columns * rows]];
        let share = 1.0 / (across * down) as f32;
        let inside = |at: isize, size: usize| at.clamp(0, size as isize - 1) as usize;
        let places: Vec<usize> = (0..width).map(|x| 3 * inside(u0 + x as isize, picture.width)).collect();
        let mut levels = vec![[0.0f32; 3]; width];
        for y in 0..height {
            let source = picture.row(inside(v0 + y as isize, picture.height));
            for (level, place) in levels.iter_mut().zip(&places) {
                let pixel = &source[*place..][..3];
                *level = [f32::from(pixel[0]), f32::from(pixel[1]), f32::from(pixel[2])];
            }
            luma.extend(levels.iter().map(|[b, g, r]| 0.299 * r + 0.587 * g + 0.114 * b - 128.0));
            let [blue, red] = &mut chroma;
            let samples = y / down * columns..(y / down + 1) * columns;
            let sums = blue[samples.clone()].iter_mut().zip(&mut red[samples]);
            for (pixels, (blue, red)) in levels.chunks_exact(across).zip(sums) {
                for [b, g, r] in pixels {
                    *blue += share * (0.5 * b - 0.331_264 * g - 0.168_736 * r);
                    *red += share * (0.5 * r - 0.418_688 * g - 0.081_312 * b);
                }
            }
        }
        Self { width, height, luma, chroma }
    }

    /// The decoded pixels of the unit from a pixel on, row by row; of smaller units the rest is empty.
    pub fn decoded(&self, [x, y]: [usize; 2], (across, down): (usize, usize)) -> Decoded {
        let first = (x / across, y / down);
        let size = (self.width / across, self.height / down);
        let [blue, red] = self.chroma.each_ref().map(|plane| surrounded(plane, first, size));
        let mut luma = [[0.0f32; WIDEST]; WIDEST];
        let rows = self.luma.chunks_exact(self.width).skip(y).take(BLOCK * down);
        for (to, from) in luma.iter_mut().zip(rows) {
            to[..BLOCK * across].copy_from_slice(&from[x..x + BLOCK * across]);
        }
        levels_of(&luma, &blue, &red, (across, down))
    }
}

/// Samples of a block's colour with their neighbours on all sides; beyond the plane as on its border.
fn surrounded(plane: &[f32], (left, top): (usize, usize), (columns, rows): (usize, usize)) -> Samples {
    let inside = |at: usize, size: usize| at.saturating_sub(1).min(size - 1);
    core::array::from_fn(|row| {
        let from = &plane[inside(top + row, rows) * columns..][..columns];
        core::array::from_fn(|column| from[inside(left + column, columns)])
    })
}

/// The levels of a unit by its brightness and its colour's samples, which are interpolated where pixels share them: three parts of the nearer one, one of the other.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn levels_of(
    luma: &[[f32; WIDEST]; WIDEST],
    blue: &Samples,
    red: &Samples,
    (across, down): (usize, usize),
) -> Decoded {
    #[inline(always)]
    fn mixed(near: f32, other: f32) -> f32 {
        0.75 * near + 0.25 * other
    }
    #[inline(always)]
    fn wide(samples: &[f32; BLOCK + 2], across: usize) -> [f32; WIDEST] {
        let mut wide = [0.0f32; WIDEST];
        if across == 1 {
            wide[..BLOCK].copy_from_slice(&samples[1..=BLOCK]);
        } else {
            for at in 0..BLOCK {
                wide[2 * at] = mixed(samples[at + 1], samples[at]);
                wide[2 * at + 1] = mixed(samples[at + 1], samples[at + 2]);
            }
        }
        wide
    }
    // Across first: once for the rows of pixels that share a sample.
    // (Loops and no closures: these would be built for any processor.)
    let mut along = [[[0.0f32; WIDEST]; BLOCK + 2]; 2];
    for (rows, samples) in along.iter_mut().zip([blue, red]) {
        for (row, samples) in rows.iter_mut().zip(samples) {
            *row = wide(samples, across);
        }
    }
    let mut decoded = [[[0u8; 3]; WIDEST]; WIDEST];
    for (y, (to, luma)) in decoded.iter_mut().zip(luma).take(BLOCK * down).enumerate() {
        let near = y / down + 1;
        let other = if y % down == 0 { near - 1 } else { near + 1 };
        let [mut blue, mut red] = [along[0][near], along[1][near]];
        if down == 2 {
            for x in 0..WIDEST {
                blue[x] = mixed(blue[x], along[0][other][x]);
                red[x] = mixed(red[x], along[1][other][x]);
            }
        }
        // (A float beyond the range of levels becomes the nearest one.)
        let mut levels = [[0u8; WIDEST]; 3];
        for x in 0..WIDEST {
            let luma = luma[x] + 128.0;
            levels[0][x] = (luma + 1.772 * blue[x] + 0.5) as u8;
            levels[1][x] = (luma - 0.344_136 * blue[x] - 0.714_136 * red[x] + 0.5) as u8;
            levels[2][x] = (luma + 1.402 * red[x] + 0.5) as u8;
        }
        for (x, pixel) in to.iter_mut().enumerate() {
            *pixel = [levels[0][x], levels[1][x], levels[2][x]];
        }
    }
    decoded
}

/// Rounds the coefficients of the blocks at samples of a plane, which do not overlap.
fn code_blocks(plane: &mut [f32], width: usize, corners: &[(usize, usize)], steps: &Block) {
    let mut blocks = [[0.0f32; LANES]; SIZE];
    for corners in corners.chunks(LANES) {
        let places = |(left, top): (usize, usize)| {
            (0..BLOCK).map(move |row| (row * BLOCK, (top + row) * width + left))
        };
        for (lane, corner) in corners.iter().enumerate() {
            for (at, start) in places(*corner) {
                for (values, sample) in blocks[at..at + BLOCK].iter_mut().zip(&plane[start..start + BLOCK]) {
                    values[lane] = *sample;
                }
            }
        }
        round(&mut blocks, steps, &COSINES);
        for (lane, corner) in corners.iter().enumerate() {
            for (at, start) in places(*corner) {
                for (values, sample) in blocks[at..at + BLOCK].iter().zip(&mut plane[start..start + BLOCK]) {
                    *sample = values[lane];
                }
            }
        }
    }
}

/// Rounds the coefficients of blocks to multiples of their steps.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn round(blocks: &mut Blocks, steps: &Block, cosines: &Block) {
    /// The transform of eight samples that lie `apart`, or what undoes it.
    #[inline(always)]
    fn transform(blocks: &mut Blocks, first: usize, apart: usize, cosines: &Block, back: bool) {
        let mut sums = [[0.0f32; LANES]; BLOCK];
        for (k, sum) in sums.iter_mut().enumerate() {
            for n in 0..BLOCK {
                let factor = cosines[if back { n * BLOCK + k } else { k * BLOCK + n }];
                for (sum, value) in sum.iter_mut().zip(&blocks[first + n * apart]) {
                    *sum += factor * value;
                }
            }
        }
        for (k, sum) in sums.iter().enumerate() {
            blocks[first + k * apart] = *sum;
        }
    }
    for column in 0..BLOCK {
        transform(blocks, column, BLOCK, cosines, false);
    }
    for row in 0..BLOCK {
        transform(blocks, row * BLOCK, 1, cosines, false);
    }
    for (values, step) in blocks.iter_mut().zip(steps) {
        for value in values {
            *value = (*value / step).round_ties_even() * step;
        }
    }
    for column in 0..BLOCK {
        transform(blocks, column, BLOCK, cosines, true);
    }
    for row in 0..BLOCK {
        transform(blocks, row * BLOCK, 1, cosines, true);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::patch::Place;
    use super::super::surroundings::Surroundings;
    use super::*;
    use nalgebra::Vector2;

    fn pattern(width: usize, height: usize) -> Vec<u8> {
        (0..width * height)
            .flat_map(|i| {
                let (x, y) = ((i % width) as f64, (i / width) as f64);
                [(0.31 * x).sin(), (0.23 * y + 0.1 * x).cos(), (0.05 * x * y).sin()]
                    .map(|v| (127.0 + 100.0 * v) as u8)
            })
            .collect()
    }

    fn change(first: &[[u8; 3]], other: &[[u8; 3]]) -> f64 {
        let squares: f64 = first
            .iter()
            .flatten()
            .zip(other.iter().flatten())
            .map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2))
            .sum();
        (squares / (3 * first.len()) as f64).sqrt()
    }

    fn coded(codec: &Codec, bytes: &[u8], moved: (usize, usize)) -> Vec<[u8; 3]> {
        let picture = Picture::new(bytes, 96, 80, (1, 1)).unwrap();
        let whole = Place { left: 0, top: 0, width: 96, height: 80 };
        Surroundings::of(codec, &picture, &whole, &Vector2::new(48.0, 40.0), 1e3).again(moved)
    }

    #[test]
    fn coarser_steps_change_more_and_a_grid_that_was_coded_before_hardly_at_all() {
        let bytes = pattern(96, 80);
        let as_it_is: Vec<[u8; 3]> = bytes.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect();
        let codec = |step: u16| Codec::new(&[step; 64], &[step; 64], (1, 1)).unwrap();
        assert!(change(&coded(&codec(1), &bytes, (0, 0)), &as_it_is) < 1.0);
        let (fine, coarse) = (coded(&codec(8), &bytes, (3, 5)), coded(&codec(24), &bytes, (3, 5)));
        assert!(change(&coarse, &as_it_is) > 1.5 * change(&fine, &as_it_is));
        // Coded once more on its own grid nothing is lost but by the levels' rounding; on another one, much.
        let flat: Vec<u8> = coarse.iter().flatten().copied().collect();
        let (own, other) = (coded(&codec(24), &flat, (3, 5)), coded(&codec(24), &flat, (0, 0)));
        assert!(change(&own, &coarse) < 0.3 * change(&other, &coarse));
    }

    #[test]
    fn rounding_keeps_the_mean_of_squares_of_a_steps_rounding() {
        // Coefficients are spread over many steps: each is off by step² / 12, and the transform keeps squares.
        let mut seed = 7u32;
        let block: Block = core::array::from_fn(|_| {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (seed >> 24) as f32 - 128.0
        });
        let mut blocks = block.map(|sample| [sample; LANES]);
        round(&mut blocks, &[10.0; SIZE], &COSINES);
        let coded = blocks.map(|samples| samples[LANES - 1]);
        let square = block.iter().zip(&coded).map(|(a, b)| (a - b).powi(2)).sum::<f32>() / SIZE as f32;
        assert!((square - 100.0 / 12.0).abs() < 3.0, "{square}");
    }

    #[test]
    fn only_units_within_reach_are_coded_and_what_is_no_codec_is_none() {
        let bytes = pattern(96, 80);
        let codec = Codec::new(&[40; 64], &[40; 64], (2, 2)).unwrap();
        let picture = Picture::new(&bytes, 96, 80, (2, 2)).unwrap();
        let place = Place { left: 8, top: 4, width: 88, height: 76 };
        let levels =
            Surroundings::of(&codec, &picture, &place, &Vector2::new(16.0, 16.0), 12.0).again((2, 6));
        assert_eq!(levels.len(), 88 * 76);
        let source = |u: usize, v: usize| {
            let at = 3 * (v * 96 + u);
            [bytes[at], bytes[at + 1], bytes[at + 2]]
        };
        let differs = |u: usize, v: usize| levels[(v - 4) * 88 + u - 8] != source(u, v);
        assert!((10..24).any(|u| differs(u, 16)));
        assert!((60..96).all(|u| (4..80).all(|v| !differs(u, v))));
        assert!(Codec::new(&[0; 64], &[1; 64], (1, 1)).is_none());
        assert!(Codec::new(&[1; 64], &[1; 64], (4, 1)).is_none());
    }
}
