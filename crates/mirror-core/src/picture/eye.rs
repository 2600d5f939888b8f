//! The tracer's camera: from a pixel to the beam of rays that forms it.

use super::Beam;
use crate::camera::{Camera, Distortion};
use crate::error::{Error, Result};
use nalgebra::{Isometry3, Matrix3, Vector2, Vector3};
use rayon::prelude::*;

/// The fixed point stops when a step is this small (normalised image coordinates; 1e-15 is below 1e-12 px).
const FIXED_POINT_STEP: f64 = 1e-15;
/// Steps of the fixed point; each gains a decimal or more for the lenses of real cameras.
const FIXED_POINT_STEPS: usize = 300;
/// Largest number of pixels: the table of beams takes 16 bytes for each.
const MOST_PIXELS: usize = 50_000_000;
/// How far the lens formula, applied to the result, may miss the pixel (normalised image coordinates).
const FIXED_POINT_TOLERANCE: f64 = 1e-12;

/// The lens as beams: the direction of the light that reaches each place of the picture.
///
/// The lens formula (Brown's, as published for OpenCV and ROS) is inverted by the fixed point
/// `x ← (x_d − tangential(x)) / radial(x)`; the estimators invert theirs by Newton's method.
/// [`Eye::beam`] interpolates a table at the pixels' corners: within a pixel the lens bends by less than 1e-3 px.
#[derive(Debug, Clone)]
pub struct Eye {
    width: usize,
    height: usize,
    focal_px: Vector2<f64>,
    center_px: Vector2<f64>,
    lens: [f64; 8],
    /// Undistorted image coordinates of the pixels' corners, row by row, (width + 1) · (height + 1).
    nodes: Vec<Vector2<f64>>,
}

impl Eye {
    /// The beams of a camera of these numbers.
    ///
    /// # Errors
    /// [`Error::NotUnprojectable`] where the fixed point does not converge in some corner of the picture: the lens is
    /// too strong for this tracer; [`Error::OutOfRange`] for a picture of more than 50 million pixels.
    pub fn new(camera: &Camera) -> Result<Self> {
        if matches!(camera.distortion(), Distortion::Equidistant(_)) {
            return Err(Error::NotUnprojectable {
                u: -0.5,
                v: -0.5,
                reason: "the picture maker draws with plumb_bob and rational_polynomial lenses, not with fisheyes",
            });
        }
        let (width, height) = camera.size_px();
        let (width, height) = (width as usize, height as usize);
        if width.saturating_mul(height) > MOST_PIXELS {
            return Err(Error::OutOfRange {
                what: "pixels of the picture".into(),
                got: width as f64 * height as f64,
                needed: format!("at most {MOST_PIXELS}"),
            });
        }
        let mut eye = Self {
            width,
            height,
            focal_px: camera.focal_px(),
            center_px: camera.center_px(),
            lens: camera.distortion().coefficients(),
            nodes: Vec::new(),
        };
        let nodes: Option<Vec<_>> = (0..(width + 1) * (height + 1))
            .into_par_iter()
            .map(|i| {
                let (row, column) = (i / (width + 1), i % (width + 1));
                eye.undistorted(&Vector2::new(column as f64 - 0.5, row as f64 - 0.5))
            })
            .collect();
        eye.nodes = nodes.ok_or(Error::NotUnprojectable {
            u: -0.5,
            v: -0.5,
            reason: "the picture maker needs a lens whose formula can be inverted over the whole picture",
        })?;
        Ok(eye)
    }

    /// Width and height of the picture, px.
    pub fn size_px(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// The mean focal length, px.
    pub fn mean_focal_px(&self) -> f64 {
        (self.focal_px.x + self.focal_px.y) / 2.0
    }

    /// Whether a pixel lies in the picture.
    pub fn contains(&self, pixel: &Vector2<f64>) -> bool {
        let inside = |x: f64, size: usize| x >= -0.5 && x <= size as f64 - 0.5;
        inside(pixel.x, self.width) && inside(pixel.y, self.height)
    }

    /// Undistorted image coordinates of any pixel, by the fixed point; nothing where it does not converge.
    fn undistorted(&self, pixel: &Vector2<f64>) -> Option<Vector2<f64>> {
        let [k1, k2, p1, p2, k3, k4, k5, k6] = self.lens;
        let seen = (pixel - self.center_px).component_div(&self.focal_px);
        let parts = |x: &Vector2<f64>| {
            let r2 = x.norm_squared();
            let r4 = r2 * r2;
            let r6 = r4 * r2;
            let radial = (1.0 + k1 * r2 + k2 * r4 + k3 * r6) / (1.0 + k4 * r2 + k5 * r4 + k6 * r6);
            let tangential = Vector2::new(
                2.0 * p1 * x.x * x.y + p2 * (r2 + 2.0 * x.x * x.x),
                p1 * (r2 + 2.0 * x.y * x.y) + 2.0 * p2 * x.x * x.y,
            );
            (radial, tangential)
        };
        let mut x = seen;
        for _ in 0..FIXED_POINT_STEPS {
            let (radial, tangential) = parts(&x);
            let next = (seen - tangential) / radial;
            let step = (next - x).amax();
            x = next;
            if !(step > FIXED_POINT_STEP) {
                break;
            }
        }
        let (radial, tangential) = parts(&x);
        let missed = (x * radial + tangential - seen).amax();
        (missed < FIXED_POINT_TOLERANCE && radial > 0.0).then_some(x)
    }

    /// The exact beam of a pixel, for a camera at `scene_from_camera`; none where the lens cannot be inverted.
    pub fn exact_beam(&self, pixel: &Vector2<f64>, scene_from_camera: &Isometry3<f64>) -> Option<Beam> {
        let rotation = scene_from_camera.rotation.to_rotation_matrix().into_inner();
        self.undistorted(pixel).map(|x| place(&x, &scene_from_camera.translation.vector, &rotation))
    }

    /// The beam of a place in the picture (px, clamped to the picture), by the table; the camera is at `from` (m),
    /// with the given rotation from camera to scene.
    #[inline]
    pub fn beam(&self, pixel: &Vector2<f64>, from: &Vector3<f64>, rotation: &Matrix3<f64>) -> Beam {
        let u = (pixel.x + 0.5).clamp(0.0, self.width as f64);
        let v = (pixel.y + 0.5).clamp(0.0, self.height as f64);
        let (column, row) = ((u as usize).min(self.width - 1), (v as usize).min(self.height - 1));
        let (a, b) = (u - column as f64, v - row as f64);
        let top = row * (self.width + 1) + column;
        let bottom = top + self.width + 1;
        let x = (self.nodes[top] * (1.0 - a) + self.nodes[top + 1] * a) * (1.0 - b)
            + (self.nodes[bottom] * (1.0 - a) + self.nodes[bottom + 1] * a) * b;
        place(&x, from, rotation)
    }
}

#[inline]
fn place(x: &Vector2<f64>, from: &Vector3<f64>, rotation: &Matrix3<f64>) -> Beam {
    Beam { from: *from, along: rotation * Vector3::new(x.x, x.y, 1.0).normalize() }
}
