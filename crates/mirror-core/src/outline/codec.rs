//! Which pixels share a colour, estimated from the picture: a decoded video frame or JPEG that was stored without
//! loss no longer says so.
//!
//! Where a decoder has interpolated colour between samples two pixels apart, four neighbours across one sample's
//! place lie on two lines that meet there: their third difference vanishes, and that of the four neighbours one
//! pixel on does not. Where it has repeated the sample, neighbours of a pair are alike. In a picture whose colour
//! has full resolution both phases look the same.

use super::patch::Picture;
use multiversion::multiversion;

/// Places are looked at in blocks of so many.
const LANES: usize = 32;
/// Every so many lines are read.
const STRIDE: usize = 3;
/// Four neighbours count where their colour changes by this, levels.
const LEAST_CHANGE: f32 = 14.0;
/// Least number of places that count, in each phase.
const LEAST_PLACES: f64 = 60.0;
/// A phase is distinguished from the other if its mean square is below this share of it.
const TELLING_SHARE: f64 = 0.3;

/// Mean squares by phase.
#[derive(Default)]
struct Phases {
    sum: [f64; 2],
    count: [f64; 2],
}

impl Phases {
    fn add(&mut self, phase: usize, value: f32) {
        self.sum[phase] += f64::from(value * value);
        self.count[phase] += 1.0;
    }

    /// Whether a phase's mean square is far below the other's.
    fn told(&self, low: usize) -> bool {
        let mean = |phase: usize| self.sum[phase] / self.count[phase].max(1.0);
        self.count[0] >= LEAST_PLACES
            && self.count[1] >= LEAST_PLACES
            && mean(low) < TELLING_SHARE * mean(1 - low)
    }
}

/// Pixels across and down that share a colour: 1 or 2 each; 1 where the picture does not determine it.
pub fn chroma_step(picture: &Picture<'_>) -> (usize, usize) {
    let (width, height) = (picture.width, picture.height);
    let (mut across, mut down) = (Changes::default(), Changes::default());
    // Lines across from every so many rows; lines down of every so many columns side by side, by the last four rows.
    let columns = width.div_ceil(STRIDE);
    let mut line = [vec![0.0f32; width], vec![0.0f32; width]];
    let mut near = [(); 2].map(|()| [(); 4].map(|()| vec![0.0f32; columns]));
    for row in 0..height {
        let pixels = picture.row(row);
        if row % STRIDE == 0 {
            let [red, blue] = &mut line;
            colours_of(pixels, red, blue);
            for values in &line {
                across.add_line(values);
            }
        }
        for rows in &mut near {
            rows.rotate_left(1);
        }
        let [red, blue] = &mut near;
        colours_of_some(pixels, &mut red[3], &mut blue[3]);
        if row >= 3 {
            for rows in &near {
                down.add_rows(rows, (row - 3) % 2);
            }
        }
    }
    (if across.told() { 2 } else { 1 }, if down.told() { 2 } else { 1 })
}

/// Red and blue against the brightness, levels (ITU-R BT.601).
#[inline(always)]
fn colour_of(pixel: &[u8]) -> [f32; 2] {
    let (b, g, r) = (f32::from(pixel[0]), f32::from(pixel[1]), f32::from(pixel[2]));
    [0.5 * r - 0.4187 * g - 0.0813 * b, 0.5 * b - 0.3313 * g - 0.1687 * r]
}

/// Of all pixels of a row.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn colours_of(pixels: &[u8], red: &mut [f32], blue: &mut [f32]) {
    for ((pixel, red), blue) in pixels.chunks_exact(3).zip(red).zip(blue) {
        [*red, *blue] = colour_of(pixel);
    }
}

/// Of every so many columns of a row.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn colours_of_some(pixels: &[u8], red: &mut [f32], blue: &mut [f32]) {
    for ((pixels, red), blue) in pixels.chunks(3 * STRIDE).zip(red).zip(blue) {
        [*red, *blue] = colour_of(&pixels[..3]);
    }
}

/// First and third differences of a colour along lines.
#[derive(Default)]
struct Changes {
    first: Phases,
    third: Phases,
}

impl Changes {
    /// Of four neighbours on a line; the phase is the parity of the first.
    fn add(&mut self, [x0, x1, x2, x3]: [f32; 4], phase: usize) {
        self.third.add(phase, x0 - 3.0 * x1 + 3.0 * x2 - x3);
        self.first.add(phase, x2 - x1);
    }

    /// Of a whole line.
    fn add_line(&mut self, values: &[f32]) {
        let Some(count) = values.len().checked_sub(3) else { return };
        let four: [&[f32]; 4] = core::array::from_fn(|i| &values[i..][..count]);
        self.add_telling(&four, |begin| begin % 2);
    }

    /// Of four neighbouring places on many lines.
    fn add_rows(&mut self, rows: &[Vec<f32>; 4], phase: usize) {
        self.add_telling(&rows.each_ref().map(Vec::as_slice), |_| phase);
    }

    /// Most places change too little to count, which is decided for a block of them at once.
    fn add_telling(&mut self, four: &[&[f32]; 4], phase: impl Fn(usize) -> usize) {
        let count = four[0].len();
        for begin in (0..count).step_by(LANES) {
            let end = (begin + LANES).min(count);
            if end - begin == LANES && !any_tells(four, begin) {
                continue;
            }
            for place in begin..end {
                let values = [four[0][place], four[1][place], four[2][place], four[3][place]];
                if change(values) >= LEAST_CHANGE {
                    self.add(values, phase(place));
                }
            }
        }
    }

    fn told(&self) -> bool {
        // The samples' places lie between pixels 0 and 1, 2 and 3, ...: four neighbours around one begin at an odd pixel, and the pair in their middle is one sample's.
        self.third.told(1) || self.first.told(1)
    }
}

#[inline(always)]
fn change([x0, x1, x2, x3]: [f32; 4]) -> f32 {
    let larger = |a: f32, b: f32| if a > b { a } else { b };
    let smaller = |a: f32, b: f32| if a < b { a } else { b };
    larger(larger(x0, x1), larger(x2, x3)) - smaller(smaller(x0, x1), smaller(x2, x3))
}

/// Whether four neighbours change enough at a place of the block from `begin` on.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn any_tells(four: &[&[f32]; 4], begin: usize) -> bool {
    let [x0, x1, x2, x3] = [0, 1, 2, 3].map(|i: usize| &four[i][begin..begin + LANES]);
    let mut found = 0u32;
    for (((x0, x1), x2), x3) in x0.iter().zip(x1).zip(x2).zip(x3) {
        found |= u32::from(change([*x0, *x1, *x2, *x3]) >= LEAST_CHANGE);
    }
    found > 0
}
