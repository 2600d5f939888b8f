//! Plain PNG files: the pixels of the usual kind at a third of the time of Pillow, which reads all others.

use crate::errors::MirrorPostureError;
use crate::work::Work;
use numpy::ndarray::Array3;
use numpy::{IntoPyArray, PyArray3};
use pyo3::prelude::*;
use std::io::Cursor;

const SIGNATURE: usize = 8;
/// Of a chunk: its length and name before its data, its check sum behind.
const BEFORE: usize = 8;
const BEHIND: usize = 4;
/// Chunks that say nothing of which pixels are shown, or how (EXIF, which may turn a picture, transparency, animation).
const PLAIN: [&[u8; 4]; 9] =
    [b"IHDR", b"IDAT", b"IEND", b"pHYs", b"gAMA", b"cHRM", b"sRGB", b"tIME", b"sBIT"];

/// The pixels `(H, W, 3)`, blue, green, red, of a whole PNG of 8-bit red, green and blue; None for any other file, a broken one included.
#[pyfunction]
pub fn plain_png<'py>(py: Python<'py>, content: &[u8]) -> PyResult<Option<Bound<'py, PyArray3<u8>>>> {
    let Some((width, height, bgr)) = py.work(|| decoded(content)) else { return Ok(None) };
    let pixels = Array3::from_shape_vec((height, width, 3), bgr)
        .map_err(|error| MirrorPostureError::new_err(error.to_string()))?;
    Ok(Some(pixels.into_pyarray(py)))
}

fn decoded(content: &[u8]) -> Option<(usize, usize, Vec<u8>)> {
    if !is_plain(content) {
        return None;
    }
    let mut options = png::DecodeOptions::default();
    options.set_ignore_checksums(false);
    let mut reader = png::Decoder::new_with_options(Cursor::new(content), options).read_info().ok()?;
    let info = reader.info();
    let (width, height) = (info.width as usize, info.height as usize);
    if (info.color_type, info.bit_depth, info.interlaced)
        != (png::ColorType::Rgb, png::BitDepth::Eight, false)
    {
        return None;
    }
    let mut pixels = vec![0; reader.output_buffer_size()?];
    reader.next_frame(&mut pixels).ok()?;
    reader.finish().ok()?;
    for pixel in pixels.chunks_exact_mut(3) {
        pixel.swap(0, 2);
    }
    Some((width, height, pixels))
}

/// Whether all chunks up to the file's end are plain ones.
fn is_plain(content: &[u8]) -> bool {
    let mut rest = content.get(SIGNATURE..).unwrap_or_default();
    while let (Some(length), Some(name)) = (rest.get(..4), rest.get(4..BEFORE)) {
        if !PLAIN.iter().any(|plain| plain.as_slice() == name) {
            return false;
        }
        if name == b"IEND" {
            return true;
        }
        let length = length.iter().fold(0usize, |sum, byte| sum << 8 | usize::from(*byte));
        let Some(next) = rest.get(BEFORE..).and_then(|data| data.get(length.saturating_add(BEHIND)..)) else {
            return false;
        };
        rest = next;
    }
    false
}
