//! How probable a scatter of all joints is ([`crate::diagnose::likelihood::joint_scatter`]), compared with models without it.

use crate::diagnose::effects::hypothesis::Catalogue;
use crate::diagnose::likelihood::fit::Fit;
use crate::diagnose::likelihood::joint_scatter::{JointScatter, scattering_joints};
use crate::diagnose::likelihood::noise::SETTLED;
use crate::diagnose::likelihood::noise_scale::NoiseScale;
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::problem::Noise;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::{LEAST_LOG_ODDS, LOG_PRIOR_STRUCTURE, Size};
use crate::diagnose::selection::nonparametric::gain_of_free_form;
use crate::diagnose::selection::search::{Found, Search};
use crate::diagnose::selection::with_tolerances::gain_of_small_errors;
use crate::error::Result;

/// Joints whose scatter alone is compared with that of all, the likeliest first.
const ALONE: Size = 3;

/// Whether what was found with free mounts is clearly more probable beside a scatter of all joints than by itself, beside any one
/// free-form error of `all` or small errors everywhere (each at three times the gain that its linear model predicts), and beside a
/// scatter of one joint; and whether the scatter leaves no more than the noise, which a law that is missing would. The cheapest
/// comparison comes first.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn scatter_stands_out(search: &Search<'_>, found: &Found, all: &Catalogue) -> Result<bool> {
    let joints = scattering_joints(&search.problem);
    // Measured points of one posture share the error of a measured pose: joints that scatter look like that.
    if search.problem.camera.is_none() || joints.is_empty() {
        return Ok(false);
    }
    let deformation = search.deformation(&found.fit.model);
    let (gain, _) =
        JointScatter::gain(&search.problem, &deformation, &joints, search.measured_noise, search.mask)?;
    let hoped = SOLVER.most_hoped * gain + LOG_PRIOR_STRUCTURE;
    if hoped < LEAST_LOG_ODDS {
        return Ok(false);
    }
    let of_others = SOLVER.most_hoped * gain_of_free_form(search, found, all)?;
    if hoped < of_others {
        return Ok(false);
    }
    let of_others = of_others.max(SOLVER.most_hoped * gain_of_small_errors(search, found)?);
    if hoped < of_others {
        return Ok(false);
    }
    let weighed = Weighed::new(search, found, &joints)?;
    let (here, beside) = weighed.with_scatter(search, &found.fit, &joints)?;
    Ok(beside.noise.marker_px * SETTLED <= search.measured_noise.marker_px
        && here + LOG_PRIOR_STRUCTURE - weighed.of_found > of_others.max(LEAST_LOG_ODDS)
        && !weighed.one_is_likelier(search, found, &joints, here)?)
}

/// What models are compared by: all at the session's measured noise, each paying for a larger one.
pub(crate) struct Weighed {
    scale: NoiseScale,
    measured: Noise,
    /// Log posterior of what was found, without scatter.
    pub of_found: f64,
}

impl Weighed {
    pub fn new(search: &Search<'_>, found: &Found, joints: &[NodeId]) -> Result<Self> {
        let (problem, deformation) = (&search.problem, search.deformation(&found.fit.model));
        let measured = search.measured_noise;
        let scale = NoiseScale::new(problem, &deformation, measured, search.mask)?;
        let mut weighed = Self { scale, measured, of_found: 0.0 };
        weighed.of_found = weighed.without_scatter(search, &found.fit, joints)?;
        Ok(weighed)
    }

    /// Log posterior of a model by itself, at the noise that it leaves.
    pub fn without_scatter(&self, search: &Search<'_>, fit: &Fit, joints: &[NodeId]) -> Result<f64> {
        let deformation = search.deformation(&fit.model);
        let alone = JointScatter::none(&search.problem, &deformation, joints, self.measured, search.mask)?;
        Ok(self.log_posterior(search, fit, &alone))
    }

    /// Log posterior of a model beside a scatter of some joints, and the scatter.
    pub fn with_scatter(
        &self,
        search: &Search<'_>,
        fit: &Fit,
        joints: &[NodeId],
    ) -> Result<(f64, JointScatter)> {
        let deformation = search.deformation(&fit.model);
        let beside = JointScatter::fitted(&search.problem, &deformation, joints, self.measured, search.mask)?;
        Ok((self.log_posterior(search, fit, &beside), beside))
    }

    /// Whether a scatter of one joint is more probable than one of all, whose value is given: it is found by a search of
    /// its own.
    pub fn one_is_likelier(
        &self,
        search: &Search<'_>,
        found: &Found,
        joints: &[NodeId],
        of_all: f64,
    ) -> Result<bool> {
        let deformation = search.deformation(&found.fit.model);
        let (problem, mask) = (&search.problem, search.mask);
        let alone = JointScatter::likeliest_alone(problem, &deformation, joints, self.measured, mask)?;
        for joint in alone.into_iter().take(ALONE) {
            if self.with_scatter(search, &found.fit, &[joint])?.0 > of_all {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// The likelihood beside the scatter, with the priors and the volume of a model's parameters.
    fn log_posterior(&self, search: &Search<'_>, fit: &Fit, beside: &JointScatter) -> f64 {
        let of_parameters = search.log_posterior(fit) + 0.5 * (fit.misfit - search.penalty(&fit.model));
        of_parameters - 0.5 * beside.cost + self.scale.log_density(beside.noise, self.measured)
    }
}
