//! Options of a measurement by one mirror estimator.

use crate::cancel::Cancel;
use crate::error::{Error, Result, positive};
use crate::mirror::{EstimatorOptions, MirrorEstimator, MirrorOptics};
use crate::triangulate::{TriangulationOptions, Triangulator};

/// Corner and blob detectors find well-lit targets to about this, px, one axis (the paper's setting).
const USUAL_NOISE_PX: f64 = 0.2;

/// How a session is measured by one estimator.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasureOptions {
    /// The estimator of each view's mirror.
    pub estimator: MirrorEstimator,
    /// How the views of a marker are joined. `None`: [`Triangulator::MaximumLikelihood`] after the estimator of that
    /// name, the paper's [`Triangulator::Midpoint`] after the others.
    pub triangulator: Option<Triangulator>,
    /// How the mirrors are estimated from the board's corners.
    pub corners: EstimatorOptions,
    /// Standard deviation of a marker's centroid along one axis, px.
    pub marker_noise_px: f64,
    /// Glass and curvature of the mirror.
    pub optics: MirrorOptics,
    /// Least parallax, and the covariance of the camera–board transform, which all views share.
    pub triangulation: TriangulationOptions,
    /// Looked at in every view and every marker.
    pub cancel: Cancel,
}

impl Default for MeasureOptions {
    /// Maximum likelihood, an ideal mirror, corner noise from the residuals, 0.2 px for markers.
    fn default() -> Self {
        Self {
            estimator: MirrorEstimator::MaximumLikelihood,
            triangulator: None,
            corners: EstimatorOptions::default(),
            marker_noise_px: USUAL_NOISE_PX,
            optics: MirrorOptics::IDEAL,
            triangulation: TriangulationOptions::default(),
            cancel: Cancel::default(),
        }
    }
}

impl MeasureOptions {
    /// The triangulator that is used.
    ///
    /// # Errors
    /// [`Error::UnknownName`] for maximum likelihood after Eq. 1, whose map is no mirror and so predicts no pixel.
    pub fn triangulator(&self) -> Result<Triangulator> {
        match (self.estimator, self.triangulator) {
            (MirrorEstimator::Pose, Some(Triangulator::MaximumLikelihood)) => Err(Error::UnknownName {
                what: "triangulator after the estimator pose",
                got: Triangulator::MaximumLikelihood.name().to_owned(),
                valid: Triangulator::Midpoint.name().to_owned(),
            }),
            (_, Some(chosen)) => Ok(chosen),
            (MirrorEstimator::MaximumLikelihood, None) => Ok(Triangulator::MaximumLikelihood),
            (_, None) => Ok(Triangulator::Midpoint),
        }
    }

    pub(super) fn validated(self) -> Result<Self> {
        positive("noise of a marker's pixel (px)", self.marker_noise_px)?;
        self.triangulator()?;
        Ok(self)
    }
}
