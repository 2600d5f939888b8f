//! The searches on resampled postures, kept for a later stage that asks for the same.

use crate::diagnose::effects::hypothesis::Model;
use crate::diagnose::model::problem::Noise;
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::selection::linear_scales::WeighedSet;
use crate::diagnose::selection::linear_search::LinearSearch;
use crate::diagnose::selection::standing::Standing;

/// The searches on resampled postures, with what they were made for.
pub(crate) struct Resampled {
    pub made_for: MadeFor,
    pub whole: LinearSearch,
    /// What each search found; none of those in which numbers overflow.
    pub sets: Vec<WeighedSet>,
}

/// Causes, each with its alternatives, and the scales beside which they were found.
#[derive(PartialEq)]
pub(crate) struct MadeFor {
    causes: Vec<(usize, f64)>,
    /// Of each cause its alternatives.
    pub rivals: Vec<Vec<usize>>,
    scales: Vec<f64>,
    noise: Noise,
}

impl MadeFor {
    /// The causes of a model and how they stand.
    pub fn of(
        model: &Model,
        standings: &[Option<Standing>],
        geometry: Option<&Geometry>,
        noise: Noise,
    ) -> Self {
        let rivals = |i: usize| -> Vec<usize> {
            standings.get(i).into_iter().flatten().flat_map(|s| &s.rivals).map(|r| r.hypothesis).collect()
        };
        Self {
            causes: model.terms.iter().map(|t| (t.hypothesis, t.variant)).collect(),
            rivals: (0..model.terms.len()).map(rivals).collect(),
            scales: geometry.map(|g| g.group.prior_std.clone()).unwrap_or_default(),
            noise,
        }
    }
}
