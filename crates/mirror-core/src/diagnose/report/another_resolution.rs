//! A focal length and a centre that are those of another resolution, told as what they are: a mistake in the camera's
//! file.
//!
//! `f' = s f`, `c' = s c + d`. Where s is the factor of another resolution that cameras offer, a focal length wrong by
//! s − 1 is no error of a lens. The boards alone do not show it where the picture is cropped too, so the search finds
//! it, as two causes. Beside another gross mistake the wrong factor may have been undone first (1.6, where two is true):
//! then they are what that factor lacks.

use crate::diagnose::data::diagnosis::{Cause, Estimate};
use crate::diagnose::effects::Concern;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::prepare::first_day::resolution_near;
use crate::diagnose::principles::FAR_DEVIATIONS;
use crate::diagnose::report::gap_steps::Part;
use nalgebra::Vector2;
use std::collections::BTreeMap;

const RESOLUTION: &str = "camera_resolution";

/// Puts the causes of focal length and centre together where they are those of another resolution.
pub(crate) fn put_together(told: &mut Vec<(Cause, Part)>, problem: &Problem) {
    let place = |effect: &str| told.iter().position(|(cause, _)| cause.effect == effect);
    let (Some(focal), Some(center)) = (place("camera_focal"), place("camera_center")) else { return };
    let undone = place(RESOLUTION);
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
    let already = |name: &str| undone.and_then(|at| value(&told[at].0, name)).map(|e| e.value);
    let before = already("factor").unwrap_or(1.0);
    let deviation = FAR_DEVIATIONS * before * scale.std;
    let Some(factor) = resolution_near(before * (1.0 + scale.value), deviation) else { return };
    // The camera is that of the file with the factor that was undone.
    let shift = Vector2::new(already("du_px").unwrap_or(0.0), already("dv_px").unwrap_or(0.0));
    let of_file = camera.center_px() - factor * (camera.center_px() - shift) / before;
    let offset = |name: &str, shift: Estimate, of_file_px: f64| {
        (name.to_owned(), Estimate { value: shift.value + of_file_px, std: shift.std })
    };
    let cause = Cause {
        effect: RESOLUTION.into(),
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
    let mut replaced: Vec<usize> = undone.into_iter().chain([center]).collect();
    replaced.sort_unstable();
    replaced.into_iter().rev().for_each(|at| drop(told.remove(at)));
}
