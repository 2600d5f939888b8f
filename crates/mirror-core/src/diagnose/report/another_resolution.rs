//! A focal length and a centre that are those of another resolution, told as what they are: a mistake in the camera's
//! file.
//!
//! `f' = s f`, `c' = s c + d`. Where s is the factor of another resolution that cameras offer, a focal length wrong by
//! s − 1 is no error of a lens. The boards alone do not show it where the picture is cropped too, so the search finds
//! it, as two causes.

use crate::diagnose::data::diagnosis::{Cause, Estimate};
use crate::diagnose::effects::Concern;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::prepare::first_day::resolution_near;
use crate::diagnose::principles::FAR_DEVIATIONS;
use crate::diagnose::report::gap_steps::Part;
use std::collections::BTreeMap;

/// Puts the causes of focal length and centre together where they are those of another resolution.
pub(crate) fn put_together(told: &mut Vec<(Cause, Part)>, problem: &Problem) {
    let place = |effect: &str| told.iter().position(|(cause, _)| cause.effect == effect);
    let (Some(focal), Some(center), None) =
        (place("camera_focal"), place("camera_center"), place("camera_resolution"))
    else {
        return;
    };
    let ((of_focal, Part::Term(i)), (of_center, Part::Term(j))) = (&told[focal], &told[center]) else {
        return;
    };
    let value = |of: &Cause, name: &str| of.parameters.get(name).copied();
    let (Some(scale), Some(du), Some(dv), Some(camera)) = (
        value(of_focal, "scale_error"),
        value(of_center, "du_px"),
        value(of_center, "dv_px"),
        &problem.camera,
    ) else {
        return;
    };
    let Some(factor) = resolution_near(1.0 + scale.value, FAR_DEVIATIONS * scale.std) else { return };
    let of_file = (1.0 - factor) * camera.center_px();
    let offset = |name: &str, shift: Estimate, of_file_px: f64| {
        (name.to_owned(), Estimate { value: shift.value + of_file_px, std: shift.std })
    };
    let cause = Cause {
        effect: "camera_resolution".into(),
        at: of_focal.at.clone(),
        kind: Concern::Camera.word().into(),
        probability: of_focal.probability.min(of_center.probability),
        parameters: BTreeMap::from([
            ("factor".to_owned(), Estimate { value: factor, std: 0.0 }),
            offset("du_px", du, of_file.x),
            offset("dv_px", dv, of_file.y),
        ]),
        stability: None,
        alternatives: Vec::new(),
        words: "the camera's parameters are of another resolution and crop of the picture".into(),
        rms_shift: of_focal.rms_shift.hypot(of_center.rms_shift),
        members: Vec::new(),
        frames: Vec::new(),
    };
    told[focal] = (cause, Part::Terms(vec![*i, *j]));
    told.remove(center);
}
