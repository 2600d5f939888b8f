//! The sensor: blur, exposure, noise, gamma, compression.

use super::{Colour, LightField};
use crate::error::{Error, Result, finite};
use image::{Rgb, RgbImage};
use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

/// How linear light becomes 8-bit values.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensor {
    /// Standard deviation of the Gaussian blur of lens and focus, px.
    pub blur_px: f64,
    /// Factor on the light.
    pub exposure: f64,
    /// Electrons of a pixel at full white: shot noise is their square root. Infinite for none.
    pub full_well_electrons: f64,
    /// Standard deviation of the electronics' noise, electrons.
    pub read_noise_electrons: f64,
    /// Values are `255 light^(1/gamma)`.
    pub gamma: f64,
    /// Quality of JPEG compression, 1 to 100; none for a picture without its traces.
    pub jpeg_quality: Option<u8>,
    /// Seed of the noise.
    pub seed: u64,
}

impl Default for Sensor {
    /// A decent webcam in a lit room.
    fn default() -> Self {
        Self {
            blur_px: 0.55,
            exposure: 1.0,
            full_well_electrons: 9000.0,
            read_noise_electrons: 12.0,
            gamma: 2.2,
            jpeg_quality: None,
            seed: 0,
        }
    }
}

/// Largest blur that is taken, px.
const LARGEST_BLUR_PX: f64 = 20.0;

impl Sensor {
    /// Turns light into a picture.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for an invalid exposure, gamma, blur, noise or quality;
    /// [`Error::Picture`] where the JPEG coder refuses.
    pub fn expose(&self, light: &LightField) -> Result<RgbImage> {
        self.check()?;
        let blurred = blur(light, self.blur_px);
        let mut picture = RgbImage::new(light.width as u32, light.height as u32);
        let row_bytes = light.width * 3;
        picture.par_chunks_mut(row_bytes).enumerate().for_each(|(row, line)| {
            let mut random = ChaCha8Rng::seed_from_u64(self.seed);
            random.set_stream(row as u64);
            let pixels = &blurred[row * light.width..(row + 1) * light.width];
            for (pixel, bytes) in pixels.iter().zip(line.chunks_exact_mut(3)) {
                for (value, byte) in pixel.iter().zip(bytes) {
                    *byte = self.digitise(value * self.exposure, &mut random);
                }
            }
        });
        match self.jpeg_quality {
            None => Ok(picture),
            Some(quality) => through_jpeg(&picture, quality),
        }
    }

    fn digitise(&self, light: f64, random: &mut ChaCha8Rng) -> u8 {
        let mut value = light;
        if self.full_well_electrons.is_finite() {
            let electrons = light.max(0.0) * self.full_well_electrons;
            let spread = (electrons + self.read_noise_electrons * self.read_noise_electrons).sqrt();
            let noise: f64 = StandardNormal.sample(random);
            value = (electrons + spread * noise) / self.full_well_electrons;
        }
        // `as` saturates at 0 and 255.
        (value.max(0.0).powf(1.0 / self.gamma) * 255.0).round() as u8
    }

    fn check(&self) -> Result<()> {
        let in_range = |what: &str, got: f64, low: f64, high: f64| {
            if got >= low && got <= high {
                return Ok(());
            }
            Err(Error::OutOfRange { what: what.into(), got, needed: format!("{low} to {high}") })
        };
        in_range("blur (px)", self.blur_px, 0.0, LARGEST_BLUR_PX)?;
        in_range("exposure", self.exposure, 1e-3, 1e3)?;
        in_range("gamma", self.gamma, 0.2, 5.0)?;
        finite("read noise (electrons)", self.read_noise_electrons)?;
        if !(self.full_well_electrons > 0.0) {
            return Err(Error::OutOfRange {
                what: "full well (electrons)".into(),
                got: self.full_well_electrons,
                needed: "a number above 0, or infinity for no noise".into(),
            });
        }
        self.jpeg_quality.map_or(Ok(()), |q| in_range("JPEG quality", f64::from(q), 1.0, 100.0))
    }
}

/// Gaussian blur, rows then columns, edges repeated. A symmetric kernel: it moves nothing.
fn blur(light: &LightField, sigma_px: f64) -> Vec<Colour> {
    if sigma_px == 0.0 {
        return light.pixels.clone();
    }
    let reach = (4.0 * sigma_px).ceil() as i64;
    let weights: Vec<f64> = (-reach..=reach).map(|i| (-0.5 * (i as f64 / sigma_px).powi(2)).exp()).collect();
    let sum: f64 = weights.iter().sum();
    let (width, height) = (light.width as i64, light.height as i64);
    let pass = |from: &[Colour], along_row: bool| {
        let mut to = vec![Vector3::zeros(); from.len()];
        to.par_chunks_mut(light.width).enumerate().for_each(|(row, line)| {
            for (column, pixel) in line.iter_mut().enumerate() {
                let mut total = Colour::zeros();
                for (offset, weight) in (-reach..=reach).zip(&weights) {
                    let (x, y) = if along_row {
                        ((column as i64 + offset).clamp(0, width - 1), row as i64)
                    } else {
                        (column as i64, (row as i64 + offset).clamp(0, height - 1))
                    };
                    total += from[(y * width + x) as usize] * *weight;
                }
                *pixel = total / sum;
            }
        });
        to
    };
    pass(&pass(&light.pixels, true), false)
}

/// The picture after JPEG compression.
fn through_jpeg(picture: &RgbImage, quality: u8) -> Result<RgbImage> {
    let refuse =
        |e: image::ImageError| Error::Picture { what: "JPEG compression".into(), why: e.to_string() };
    let mut bytes = Vec::new();
    let mut encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, quality);
    encoder.encode_image(picture).map_err(refuse)?;
    let decoded = image::load_from_memory_with_format(&bytes, image::ImageFormat::Jpeg).map_err(refuse)?;
    let rgb: image::ImageBuffer<Rgb<u8>, Vec<u8>> = decoded.into_rgb8();
    Ok(rgb)
}
