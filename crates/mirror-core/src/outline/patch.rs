//! A cut-out of a picture, prepared for reading edges.

use super::circle::Circle;
use super::curve::CURVE_DOUBT;
use super::picture_noise::{Noise, smooth};
use crate::error::{Error, Result};
use nalgebra::Vector2;
use std::sync::LazyLock;

/// The codec's blocks of colour are at most so many pixels wide.
const BLOCK_PX: usize = 4;
/// A ball's patch extends this far beyond it: a share of its radius and some px more; its sides are at least so long.
const MARGIN_SHARE: f64 = 1.4;
const MARGIN_PX: f64 = 16.0;
const LEAST_SIDE_PX: usize = 4;

/// Linear light of each 8-bit level (sRGB, IEC 61966-2-1). Cameras differ a little; what matters is the curve's bend.
static LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| {
    core::array::from_fn(|level| {
        let value = level as f64 / 255.0;
        (if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }) as f32
    })
});

/// sRGB's linear light by level.
pub(super) fn linear() -> &'static [f32; 256] {
    &LINEAR
}

/// A colour picture: rows of 8-bit blue, green, red, as OpenCV keeps them.
#[derive(Debug, Clone, Copy)]
pub struct Picture<'a> {
    bgr: &'a [u8],
    pub(super) width: usize,
    pub(super) height: usize,
    chroma_step: (usize, usize),
    /// The light of each level, where it is not sRGB's.
    own_light: Option<[f32; 256]>,
}

impl<'a> Picture<'a> {
    /// A picture of `width` × `height` px; `chroma_step` pixels across and down share a colour, as its codec has it: (1, 1) for none.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`] for another number of bytes, [`Error::OutOfRange`] for a step that is not 1, 2 or 4.
    pub fn new(bgr: &'a [u8], width: usize, height: usize, chroma_step: (usize, usize)) -> Result<Self> {
        if bgr.len() != width * height * 3 {
            return Err(Error::LengthMismatch {
                what: format!("bytes of a picture of {width} × {height} px"),
                got: bgr.len(),
                needed: width * height * 3,
            });
        }
        for step in [chroma_step.0, chroma_step.1] {
            if ![1, 2, 4].contains(&step) {
                return Err(Error::OutOfRange {
                    what: "pixels that share a colour".to_owned(),
                    got: step as f64,
                    needed: "1, 2 or 4".to_owned(),
                });
            }
        }
        Ok(Self { bgr, width, height, chroma_step, own_light: None })
    }

    /// The same by a camera whose tone curve differs from sRGB's by so many deviations of what covariances allow for:
    /// its light is sRGB's to the power `1.085^deviations`. Where a codec keeps colour coarsely, levels are read as they are.
    #[must_use]
    pub fn with_curve(self, deviations: f64) -> Self {
        // Once for all balls: a power for each level.
        let power = CURVE_DOUBT.powf(deviations) as f32;
        Self { own_light: (power != 1.0).then(|| LINEAR.map(|light| light.powf(power))), ..self }
    }

    /// The light of each level.
    fn light(&self) -> &[f32; 256] {
        self.own_light.as_ref().unwrap_or(&LINEAR)
    }

    /// A row's bytes.
    pub(super) fn row(&self, row: usize) -> &[u8] {
        &self.bgr[row * self.width * 3..(row + 1) * self.width * 3]
    }

    /// The same, its values taken as light whatever its codec.
    pub(super) fn as_light(&self) -> Self {
        Self { chroma_step: (1, 1), ..*self }
    }

    /// Whether the codec keeps colour at a lower resolution than brightness.
    pub(super) fn coded(&self) -> bool {
        self.chroma_step != (1, 1)
    }

    /// The larger of the steps, px.
    pub(super) fn widest_step(&self) -> f64 {
        self.chroma_step.0.max(self.chroma_step.1) as f64
    }
}

/// A rectangle of the picture, px: whole blocks of colour, for the codec's grid starts at the picture's corner.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    pub left: usize,
    pub top: usize,
    pub width: usize,
    pub height: usize,
}

impl Place {
    /// What a measurement of the ball at a circle reads.
    pub fn around(picture: &Picture<'_>, start: &Circle) -> Option<Self> {
        let Circle { center_px, radius_px } = start;
        if !(*radius_px > 1.0 && radius_px.is_finite() && center_px.iter().all(|v| v.is_finite())) {
            return None;
        }
        Self::within(picture, center_px, radius_px * MARGIN_SHARE + MARGIN_PX)
    }

    /// What is so near to a point across and down.
    pub fn within(picture: &Picture<'_>, middle_px: &Vector2<f64>, reach_px: f64) -> Option<Self> {
        let [u, v] = [middle_px.x, middle_px.y];
        let place = Self::between(picture, [u - reach_px, v - reach_px], [u + reach_px, v + reach_px]);
        (place.width >= LEAST_SIDE_PX && place.height >= LEAST_SIDE_PX).then_some(place)
    }

    fn between(picture: &Picture<'_>, low: [f64; 2], high: [f64; 2]) -> Self {
        let begin = |v: f64, size: usize| (v.max(0.0) as usize / BLOCK_PX * BLOCK_PX).min(size);
        let end = |v: f64, size: usize| {
            (v.ceil().max(0.0) as usize / BLOCK_PX * BLOCK_PX).saturating_add(BLOCK_PX).min(size)
        };
        let (left, top) = (begin(low[0], picture.width), begin(low[1], picture.height));
        let (right, bottom) = (end(high[0], picture.width).max(left), end(high[1], picture.height).max(top));
        Self { left, top, width: right - left, height: bottom - top }
    }

    /// The picture's levels there.
    pub fn levels(&self, picture: &Picture<'_>) -> Vec<[u8; 3]> {
        let mut levels = Vec::with_capacity(self.width * self.height);
        for row in self.top..self.top + self.height {
            let start = (row * picture.width + self.left) * 3;
            levels.extend(
                picture.bgr[start..start + self.width * 3].chunks_exact(3).map(|p| [p[0], p[1], p[2]]),
            );
        }
        levels
    }
}

/// Four pixels of a patch around a place, and their weights in what is seen there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Corners {
    places: [u32; 4],
    weights: [f32; 4],
}

/// Values in a rectangle of the picture.
#[derive(Debug, Clone)]
pub(super) struct Patch {
    left: f64,
    top: f64,
    pub width: usize,
    pub height: usize,
    /// Blue, green and red: linear light, or, where the codec blurs the colours, its levels (0..1): colours mix linearly where they are blurred. Last the brightness,
    /// 0..1, as sharp as the codec has it; only where `coded`.
    pub pixels: Vec<[f32; 4]>,
    pub coded: bool,
    /// What was done about its noise.
    pub noise: Noise,
}

impl Patch {
    /// What a measurement of the ball at a circle reads; None where that is not a part of the picture.
    pub fn around(picture: &Picture<'_>, start: &Circle) -> Option<Self> {
        let place = Place::around(picture, start)?;
        Some(Self::of(place.levels(picture), &place, picture))
    }

    /// The part of a picture between two corners, px.
    pub fn cut(picture: &Picture<'_>, low: [f64; 2], high: [f64; 2]) -> Self {
        let place = Place::between(picture, low, high);
        Self::of(place.levels(picture), &place, picture)
    }

    /// Of levels (blue, green, red) at a place of a picture like this one.
    pub fn of(levels: Vec<[u8; 3]>, place: &Place, picture: &Picture<'_>) -> Self {
        let (width, height, chroma_step) = (place.width, place.height, picture.chroma_step);
        let coded = chroma_step != (1, 1);
        let noise = Noise::of(&levels, (width, height), coded);
        let mut pixels: Vec<[f32; 4]> = if coded {
            let luma: Vec<f32> = levels.iter().map(|p| luma_of(p) / 255.0).collect();
            at_chroma_resolution(&levels, &luma, width, height, chroma_step)
        } else {
            let table = picture.light();
            let of = |level: u8| table[usize::from(level)];
            levels.iter().map(|[b, g, r]| [of(*b), of(*g), of(*r), 0.0]).collect()
        };
        if noise.smoothing_px > 0.0 {
            for channel in 0..if coded { 4 } else { 3 } {
                let mut plane: Vec<f32> = pixels.iter().map(|p| p[channel]).collect();
                smooth(&mut plane, width, height, noise.smoothing_px);
                for (pixel, value) in pixels.iter_mut().zip(plane) {
                    pixel[channel] = value;
                }
            }
        }
        Self { left: place.left as f64, top: place.top as f64, width, height, pixels, coded, noise }
    }

    /// The pixel of a place in the patch.
    pub fn place(&self, column: usize, row: usize) -> [f64; 2] {
        [self.left + column as f64, self.top + row as f64]
    }

    /// Whether a place lies in the patch.
    pub fn holds(&self, place: Vector2<f64>) -> bool {
        let (x, y) = (place.x - self.left, place.y - self.top);
        x >= 0.0 && y >= 0.0 && x <= self.width as f64 - 1.0 && y <= self.height as f64 - 1.0
    }

    /// The pixels around a place; beyond the patch, those of its border.
    pub fn around_place(&self, place: Vector2<f64>) -> Corners {
        let (x, y) = (place.x - self.left, place.y - self.top);
        let (widest, highest) = (self.width as f64 - 1.0, self.height as f64 - 1.0);
        let (x, y) = (x.max(0.0).min(widest), y.max(0.0).min(highest));
        self.around_place_within(Vector2::new(x + self.left, y + self.top))
    }

    /// The pixels around a place in the patch.
    #[inline(always)]
    pub fn around_place_within(&self, place: Vector2<f64>) -> Corners {
        let (x, y) = (place.x - self.left, place.y - self.top);
        // (Half as long as to 64 bits: for that a float is converted twice.)
        let (column, row) = (x as u32 as usize, y as u32 as usize);
        let (next, below) = ((column + 1).min(self.width - 1), (row + 1).min(self.height - 1));
        let (a, b) = ((x - column as f64) as f32, (y - row as f64) as f32);
        let weights = [(1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b];
        let (above, below) = (row * self.width, below * self.width);
        let places =
            [(above + column) as u32, (above + next) as u32, (below + column) as u32, (below + next) as u32];
        Corners { places, weights }
    }

    /// The light between pixels, and the brightness, which is read only where `coded`.
    #[inline(always)]
    pub fn seen_at(&self, corners: &Corners) -> ([f64; 3], f64) {
        let ([a, b, c, d], [wa, wb, wc, wd]) = (corners.places, corners.weights);
        let at = |place: u32| &self.pixels[place as usize];
        let share = |pixel: u32, weight: f32| at(pixel).map(|value| value * weight);
        let (a, b, c, d) = (share(a, wa), share(b, wb), share(c, wc), share(d, wd));
        let sum: [f32; 4] = core::array::from_fn(|k| a[k] + b[k] + c[k] + d[k]);
        let [blue, green, red, _] = sum.map(f64::from);
        ([blue, green, red], [a[3], b[3], c[3], d[3]].map(f64::from).iter().sum())
    }
}

fn luma_of(bgr: &[u8; 3]) -> f32 {
    0.114 * f32::from(bgr[0]) + 0.587 * f32::from(bgr[1]) + 0.299 * f32::from(bgr[2])
}

/// Levels (0..1) with the brightness averaged over the blocks that share a colour, and interpolated between them as decoders do with the colour; last the brightness.
fn at_chroma_resolution(
    levels: &[[u8; 3]],
    luma: &[f32],
    width: usize,
    height: usize,
    (across, down): (usize, usize),
) -> Vec<[f32; 4]> {
    let (columns, rows) = (width.div_ceil(across), height.div_ceil(down));
    let mut blocks = vec![0.0f32; columns * rows];
    for (row, blocks) in blocks.chunks_exact_mut(columns.max(1)).enumerate() {
        let lines = row * down..((row + 1) * down).min(height);
        let lines_count = lines.len();
        for line in lines {
            let line = &luma[line * width..(line + 1) * width];
            for (block, pixels) in blocks.iter_mut().zip(line.chunks(across)) {
                for pixel in pixels {
                    *block += pixel;
                }
            }
        }
        for (column, block) in blocks.iter_mut().enumerate() {
            *block /= (lines_count * across.min(width - column * across)) as f32;
        }
    }
    let between = |place: usize, step: usize, count: usize| {
        let at = ((place as f32 + 0.5) / step as f32 - 0.5).clamp(0.0, (count - 1) as f32);
        let low = at as usize;
        (low, (low + 1).min(count - 1), at - low as f32)
    };
    let along: Vec<(usize, usize, f32)> = (0..width).map(|column| between(column, across, columns)).collect();
    let mut result = Vec::with_capacity(width * height);
    let mut wide = vec![0.0f32; columns];
    for row in 0..height {
        // Down first: once for the samples of a row of pixels.
        let (above, below, share) = between(row, down, rows);
        for (column, value) in wide.iter_mut().enumerate() {
            *value =
                (1.0 - share) * blocks[above * columns + column] + share * blocks[below * columns + column];
        }
        let own = row * width..(row + 1) * width;
        let pixels = levels[own.clone()].iter().zip(&luma[own]).zip(&along);
        result.extend(pixels.map(|((pixel, brightness), (left, right, share))| {
            let change = (1.0 - share) * wide[*left] + share * wide[*right] - brightness;
            let [blue, green, red] = pixel.map(|v| (f32::from(v) / 255.0 + change).clamp(0.0, 1.0));
            [blue, green, red, *brightness]
        }));
    }
    result
}
