//! Triangulation from the results of estimators and detectors: mirrors and pixels, by any of the methods.

use super::likelihood::{MarkerView, maximum_likelihood};
use super::mid2::{lee_civera_mid2, unbiased};
use super::options::{Triangulated, TriangulationOptions, Triangulator};
use super::rays::midpoint;
use crate::camera::Camera;
use crate::error::Result;
use crate::mirror::MirrorEstimate;
use nalgebra::Vector2;

/// A marker's pixel and the mirror of the same picture.
#[derive(Debug, Clone, Copy)]
pub struct MarkerObservation<'a> {
    /// The mirror.
    pub mirror: &'a MirrorEstimate,
    /// (u, v) of the marker's centre, px.
    pub pixel: Vector2<f64>,
    /// Its standard deviation along one axis, px.
    pub noise_px: f64,
}

/// A marker's position from N ≥ 2 views by the given way.
///
/// With mirrors by [`crate::mirror::MirrorEstimator::Pose`] the closed forms take Eq. 1's rays; maximum likelihood
/// needs planes and takes those of the nearest reflections.
///
/// # Errors
/// As the ways: [`midpoint`], [`lee_civera_mid2`], [`unbiased`], [`maximum_likelihood`].
pub fn triangulate_views(
    triangulator: Triangulator,
    camera: &Camera,
    views: &[MarkerObservation<'_>],
    options: &TriangulationOptions,
) -> Result<Triangulated> {
    if triangulator == Triangulator::MaximumLikelihood {
        let views: Result<Vec<_>> =
            views.iter().map(|v| MarkerView::new(v.mirror, v.pixel, v.noise_px)).collect();
        return maximum_likelihood(camera, &views?, options);
    }
    let rays: Result<Vec<_>> =
        views.iter().map(|v| v.mirror.virtual_camera().ray(camera, &v.pixel, v.noise_px)).collect();
    let rays = rays?;
    match triangulator {
        Triangulator::LeeCiveraMid2 => lee_civera_mid2(&rays, options),
        Triangulator::Unbiased => unbiased(&rays, options),
        _ => midpoint(&rays, options),
    }
}
