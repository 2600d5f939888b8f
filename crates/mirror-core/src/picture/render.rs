//! From beams to a picture of linear light: stratified samples, more of them at edges.

use super::light::{Probe, Seen, look};
use super::{Colour, Eye, Scene};
use crate::cancel::Cancel;
use crate::error::{Error, Result, finite};
use crate::statistics::GOLDEN_SECTION;
use nalgebra::Vector2;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

/// How densely a picture is sampled.
#[derive(Debug, Clone, PartialEq)]
pub struct Sampling {
    /// Each pixel is looked at on a grid of this many by this many places, each shifted within its cell.
    pub grid: usize,
    /// The same, for pixels in which an edge was found.
    pub edge_grid: usize,
    /// Samples of a pixel and its neighbours that differ by more than this make an edge (linear light).
    pub edge_contrast: f64,
    /// How far the picture moves while the shutter is open, px; the truth is its middle.
    pub motion_px: Vector2<f64>,
    /// Seed of the samples' places.
    pub seed: u64,
    /// Looked at in every row.
    pub cancel: Cancel,
}

impl Default for Sampling {
    fn default() -> Self {
        Self {
            grid: 2,
            edge_grid: 4,
            edge_contrast: 0.10,
            motion_px: Vector2::zeros(),
            seed: 0,
            cancel: Cancel::default(),
        }
    }
}

/// A picture of linear light, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct LightField {
    /// Width, px.
    pub width: usize,
    /// Height, px.
    pub height: usize,
    /// Light of the pixels.
    pub pixels: Vec<Colour>,
}

/// What the first pass knows of a pixel.
#[derive(Debug, Clone, Copy)]
struct Draft {
    mean: Colour,
    low: f64,
    high: f64,
    /// Fingerprint of the bodies seen; 0 where samples of one pixel disagree.
    seen: u64,
}

/// Draws the scene.
///
/// The same scene, eye and sampling give the same picture on any number of cores.
///
/// # Errors
/// [`Error::OutOfRange`] for a grid of zero or above 64, [`Error::NotFinite`] for a motion or contrast that is not a number.
pub fn render(scene: &Scene, eye: &Eye, sampling: &Sampling) -> Result<LightField> {
    for (what, grid) in [("samples' grid", sampling.grid), ("edge samples' grid", sampling.edge_grid)] {
        if !(1..=64).contains(&grid) {
            return Err(Error::OutOfRange { what: what.into(), got: grid as f64, needed: "1 to 64".into() });
        }
    }
    finite("edge contrast", sampling.edge_contrast)?;
    finite("motion (px)", sampling.motion_px.x)?;
    finite("motion (px)", sampling.motion_px.y)?;
    let (width, height) = eye.size_px();
    let mut drafts = vec![Draft { mean: Colour::zeros(), low: 0.0, high: 0.0, seen: 0 }; width * height];
    drafts.par_chunks_mut(width).enumerate().try_for_each(|(row, line)| {
        let mut random = row_random(sampling.seed, 0, row);
        for (column, draft) in line.iter_mut().enumerate() {
            // Checked at every pixel, because a row with thousands of rays a pixel takes seconds.
            sampling.cancel.check()?;
            *draft = look_at_pixel(scene, eye, sampling, sampling.grid, (column, row), &mut random);
        }
        Ok::<(), Error>(())
    })?;
    let mut pixels = vec![Colour::zeros(); width * height];
    pixels.par_chunks_mut(width).enumerate().try_for_each(|(row, line)| {
        let mut random = row_random(sampling.seed, 1, row);
        for (column, pixel) in line.iter_mut().enumerate() {
            sampling.cancel.check()?;
            *pixel = if sampling.edge_grid > sampling.grid
                && is_edge(&drafts, (width, height), (column, row), sampling.edge_contrast)
            {
                look_at_pixel(scene, eye, sampling, sampling.edge_grid, (column, row), &mut random).mean
            } else {
                drafts[row * width + column].mean
            };
        }
        Ok::<(), Error>(())
    })?;
    Ok(LightField { width, height, pixels })
}

/// A separate source of random numbers for each pass and row, so that the distribution among cores does not matter.
fn row_random(seed: u64, pass: u64, row: usize) -> ChaCha8Rng {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(pass << 32 | row as u64);
    random
}

fn look_at_pixel(
    scene: &Scene,
    eye: &Eye,
    sampling: &Sampling,
    grid: usize,
    (column, row): (usize, usize),
    random: &mut ChaCha8Rng,
) -> Draft {
    let cell = 1.0 / grid as f64;
    let mut draft = Draft { mean: Colour::zeros(), low: f64::INFINITY, high: f64::NEG_INFINITY, seen: 0 };
    let count = grid * grid;
    // The lamp's places are stratified too, and turned by a random angle from pixel to pixel.
    let ghost_weight = count as f64 / count.div_ceil(GHOST_EVERY) as f64;
    let (turn, spread): (f64, f64) = (random.random(), random.random());
    for i in 0..count {
        let (a, b) = (i % grid, i / grid);
        let du = (a as f64 + random.random::<f64>()) * cell - 0.5;
        let dv = (b as f64 + random.random::<f64>()) * cell - 0.5;
        let mut at = Vector2::new(column as f64 + du, row as f64 + dv);
        if sampling.motion_px != Vector2::zeros() {
            at += sampling.motion_px * (random.random::<f64>() - 0.5);
        }
        let probe = Probe {
            on_lamp: Probe::on_lamp(
                (i as f64 / count as f64 + spread).fract(),
                (i as f64 * GOLDEN_SECTION + turn).fract(),
            ),
            // The ghosts are weak: a few samples are sufficient.
            ghost_weight: if i % GHOST_EVERY == 0 { ghost_weight } else { 0.0 },
        };
        let beam = eye.beam(&at, &scene.scene_from_camera.translation.vector, &scene.eye_rotation);
        let seen = look(scene, &beam, probe);
        draft.mean += seen.colour + seen.ghosts;
        let brightness = seen.colour.sum() / 3.0;
        draft.low = draft.low.min(brightness);
        draft.high = draft.high.max(brightness);
        let print = fingerprint(&seen);
        draft.seen = if i == 0 || draft.seen == print { print } else { 0 };
    }
    draft.mean /= count as f64;
    draft
}

/// One sample of this many follows the mirror's ghosts.
const GHOST_EVERY: usize = 4;

fn fingerprint(seen: &Seen) -> u64 {
    seen.body.map_or(1, |b| b as u64 + 2) << 1 | u64::from(seen.in_mirror)
}

/// Whether the samples of a pixel and its eight neighbours show an edge of light or of a body.
fn is_edge(
    drafts: &[Draft],
    (width, height): (usize, usize),
    (column, row): (usize, usize),
    contrast: f64,
) -> bool {
    let here = drafts[row * width + column];
    if here.seen == 0 {
        return true;
    }
    let (mut low, mut high) = (here.low, here.high);
    for y in row.saturating_sub(1)..(row + 2).min(height) {
        for x in column.saturating_sub(1)..(column + 2).min(width) {
            let other = drafts[y * width + x];
            if other.seen != here.seen {
                return true;
            }
            low = low.min(other.low);
            high = high.max(other.high);
        }
    }
    high - low > contrast
}
