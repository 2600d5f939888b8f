//! Cross-validation: the gap on postures that were not fitted.

use crate::diagnose::criteria::fit_without_each::fit_without_each;
use crate::diagnose::criteria::regions::{frames_of, only, regions};
use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::likelihood::fit::{FitOptions, Group, Until};
use crate::diagnose::likelihood::saturated::{FreePosture, free_markers};
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::model::solver::SOLVER;
use crate::error::Result;
use rayon::prelude::*;

/// One posture's squared distances between predicted and measured markers, and their count.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct PostureGap {
    pub frame: usize,
    pub square_sum_m2: f64,
    /// What noise alone would give, m².
    pub noise_sum_m2: f64,
    pub markers: f64,
    pub square_sum_px2: f64,
    pub pixels: f64,
}

/// Predicts every region with the parameters fitted to all others: one entry a posture.
///
/// Free-form errors are fitted with the rest, and left out of the prediction if it is `of_causes_alone`: they
/// cannot be added to a model, but the causes' parameters were estimated with them.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn held_out(
    problem: &Problem,
    catalogue: &Catalogue,
    group: &Group,
    model: &Model,
    noise: Noise,
    measured: Noise,
    of_causes_alone: bool,
) -> Result<Vec<PostureGap>> {
    let labels = regions(problem);
    let nothing_to_fit = model.terms.is_empty() && model.nuisances.is_empty() && model.group.is_empty();
    let fitted = if nothing_to_fit {
        vec![model.clone(); frames_of(&labels).len()]
    } else {
        let options = FitOptions { noise, steps: SOLVER.candidate_steps };
        let fits =
            fit_without_each(problem, catalogue, group, model, options, &labels, Until::WithinDeviations)?;
        fits.into_iter().map(|fit| fit.model).collect()
    };
    let parts = fitted
        .into_par_iter()
        .enumerate()
        .map(|(region, mut fitted)| -> Result<Vec<PostureGap>> {
            if of_causes_alone {
                fitted.terms.retain(|t| !catalogue.is_free(t.hypothesis));
            }
            let deformation = fitted.deformation(problem, catalogue, &group.columns);
            gaps_in(problem, &deformation, measured, Some(&only(&labels, region)))
        })
        .collect::<Result<Vec<_>>>()?;
    let mut out = parts.concat();
    out.sort_by_key(|g| g.frame);
    Ok(out)
}

/// The gap of a given deformation on all postures, without a fit: one entry a posture.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn in_sample(
    problem: &Problem,
    deformation: &Deformation,
    measured: Noise,
) -> Result<Vec<PostureGap>> {
    gaps_in(problem, deformation, measured, None)
}

/// The same on the postures that `mask` lets count.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn gaps_in(
    problem: &Problem,
    deformation: &Deformation,
    measured: Noise,
    mask: Option<&[bool]>,
) -> Result<Vec<PostureGap>> {
    Ok(free_markers(problem, deformation, measured, true, mask)?.iter().map(gap_of).collect())
}

/// A posture's gap: what lies along a single view's ray is not seen and does not count.
pub(crate) fn gap_of(posture: &FreePosture) -> PostureGap {
    let mut out = PostureGap {
        frame: posture.frames.first().copied().unwrap_or(0),
        square_sum_px2: posture.pixel_square_sum,
        pixels: posture.pixel_count as f64,
        ..PostureGap::default()
    };
    for marker in &posture.markers {
        out.square_sum_m2 += marker.displacement.norm_squared();
        out.noise_sum_m2 += marker.noise_m2;
        out.markers += 1.0;
    }
    out
}

/// Root mean squares over postures.
#[derive(Debug, Clone, Copy)]
pub(crate) struct GapSize {
    pub rms_m: f64,
    pub floor_m: f64,
    pub rms_px: Option<f64>,
    /// Whether any marker was compared in space.
    compared: bool,
}

impl GapSize {
    /// RMS distance, m; none where no marker was compared.
    pub fn told_m(&self) -> Option<f64> {
        self.compared.then_some(self.rms_m)
    }
}

/// The size of a gap, false observations (postures far beyond the others) included: they were observed too.
pub(crate) fn size(gaps: &[PostureGap]) -> GapSize {
    let sum = |f: fn(&PostureGap) -> f64| gaps.iter().map(f).sum::<f64>();
    let compared = sum(|g| g.markers) > 0.0;
    let markers = sum(|g| g.markers).max(1.0);
    let pixels = sum(|g| g.pixels);
    GapSize {
        rms_m: (sum(|g| g.square_sum_m2) / markers).sqrt(),
        floor_m: (sum(|g| g.noise_sum_m2) / markers).sqrt(),
        rms_px: (pixels > 0.0).then(|| (sum(|g| g.square_sum_px2) / pixels).sqrt()),
        compared,
    }
}

/// Size of a gap in the unit of the observations: pixels where there are pictures.
pub(crate) fn seen_size(gaps: &[PostureGap]) -> f64 {
    let size = size(gaps);
    size.rms_px.unwrap_or(size.rms_m)
}
