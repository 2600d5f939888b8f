//! Warnings about the measurement's noise: measured from the views and larger than stated, or not measured by anything.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::criteria::lack_of_fit::adequacy;
use crate::diagnose::data::diagnosis::{Diagnosis, Verdict};
use crate::diagnose::data::recording::Recording;
use crate::diagnose::likelihood::noise::STATED_LOG_STD;
use crate::diagnose::principles::SURE_DEVIATIONS;
use crate::diagnose::selection::nonparametric::Unexplained;
use crate::error::Result;

/// The warning if corners or markers scatter far more than the session states: `ln(measured/stated)` above three of the
/// standard deviations by which a stated noise is usually wrong. What such a noise hides is not found.
pub(crate) fn noise_is_larger(findings: &Findings<'_>, recording: &Recording) -> Option<String> {
    let stated =
        recording.pixel_std_px.filter(|std| findings.search.problem.camera.is_some() && *std > 0.0)?;
    let noise = findings.search.detector_noise();
    let far = |measured: f64| (measured / stated).ln() > SURE_DEVIATIONS * STATED_LOG_STD;
    let measured = [("corners", noise.corner_px), ("markers", noise.marker_px)];
    let larger: Vec<String> = measured
        .iter()
        .filter(|(_, std)| far(*std))
        .map(|(what, std)| format!("{what} {std:.2} px"))
        .collect();
    (!larger.is_empty()).then(|| {
        format!(
            "the noise that the views of one posture show is larger than the {stated:.2} px that session.toml states (pixel_std): {}. The measured one was used, and small \
             errors hide below it: look for blur, compression, small or badly lit markers, and a robot or a mirror that moves while a picture is taken",
            larger.join(", ")
        )
    })
}

/// The warning if what is left may be the markers' noise, which nothing but the session states.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn noise_may_be_larger(findings: &Findings<'_>) -> Result<Option<String>> {
    if !findings.unexplained.as_ref().is_some_and(Unexplained::is_lawless) {
        return Ok(None);
    }
    let search = &findings.search;
    let left =
        adequacy(&search.problem, &search.deformation(&findings.found.fit.model), search.measured_noise)?;
    let (stated, scale) = (search.measured_noise.marker_px, (1.0 + left.excess).sqrt());
    Ok((left.significant && left.may_be_noise).then(|| {
        format!(
            "what is left is {scale:.2} times the noise of the markers ({stated:.3} px), in all postures alike: where each posture has one view only pixel_std in \
             session.toml tells that noise, and it may be larger; state what your detector does, or record two mirror poses or more of a posture"
        )
    }))
}

/// The warning if a remainder without place or law may be the noise of measured points that the session does not state: no view measures it.
pub(super) fn noise_is_not_stated(diagnosis: &Diagnosis, findings: &Findings<'_>) -> Option<String> {
    let problem = &findings.search.problem;
    let unknown = problem.camera.is_none() && !problem.point_noise_stated;
    let lawless = findings.unexplained.as_ref().is_some_and(Unexplained::is_lawless);
    let left = matches!(diagnosis.verdict, Verdict::Unknown | Verdict::Partial);
    (unknown && lawless && left).then(|| {
        format!(
            "no noise of the measured points is stated, and {:.2} mm on each axis was assumed; {:.2} mm are left: if your measurement scatters by so much, state it as \
             point_std in [noise] of session.toml, and there is nothing left to explain",
            findings.search.detector_noise().point_m * 1e3,
            findings.found.noise.point_m * 1e3
        )
    })
}
