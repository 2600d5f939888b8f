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
    let term = |at: usize| if let Part::Term(i) = told[at].1 { Some(i) } else { None };
    let value = |at: usize, name: &str| told[at].0.parameters.get(name).copied();
    let (undone, center) = (place(RESOLUTION), place("camera_center"));
    let Some((focal, of_focal)) = place("camera_focal").and_then(|at| Some((at, term(at)?))) else { return };
    let (Some(scale), Some(camera)) = (value(focal, "scale_error"), &problem.camera) else { return };
    let already = |name: &str| undone.and_then(|at| value(at, name));
    let before = already("factor").map_or(1.0, |e| e.value);
    let deviation = FAR_DEVIATIONS * before * scale.std;
    let ratio = before * (1.0 + scale.value);
    let is_crop = undone.is_some() && (ratio - 1.0).abs() < deviation;
    let Some(factor) = is_crop.then_some(1.0).or_else(|| resolution_near(ratio, deviation)) else { return };
    let terms = match center {
        None if is_crop => vec![of_focal],
        None => return,
        Some(at) => {
            let Some(of_center) = term(at) else { return };
            vec![of_focal, of_center]
        }
    };
    // The camera is that of the file with the factor that was undone.
    let shift = ["du_px", "dv_px"].map(|name| already(name).unwrap_or(Estimate { value: 0.0, std: 0.0 }));
    let shift_px = Vector2::new(shift[0].value, shift[1].value);
    let of_file = camera.center_px() - factor * (camera.center_px() - shift_px) / before;
    let offset = |k: usize| {
        let name = ["du_px", "dv_px"][k];
        // Without a centre of its own it is as well known as where the factor was undone.
        let moved = center.and_then(|at| value(at, name));
        let moved = moved.unwrap_or(Estimate { value: 0.0, std: shift[k].std });
        (name.to_owned(), Estimate { value: moved.value + of_file[k], std: moved.std })
    };
    let causes = || core::iter::once(focal).chain(center).map(|at| &told[at].0);
    let cause = Cause {
        effect: RESOLUTION.into(),
        at: told[focal].0.at.clone(),
        kind: Concern::Camera.word().into(),
        probability: causes().map(|c| c.probability).fold(1.0, f64::min),
        parameters: BTreeMap::from([
            ("factor".to_owned(), Estimate { value: factor, std: 0.0 }),
            offset(0),
            offset(1),
        ]),
        stability: None,
        alternatives: Vec::new(),
        words: "the camera's parameters are of another resolution and crop of the picture".into(),
        rms_shift: causes().map(|c| c.rms_shift).fold(0.0, f64::hypot),
        members: Vec::new(),
        frames: Vec::new(),
    };
    told[focal] = (cause, Part::Terms(terms));
    let mut replaced: Vec<usize> = undone.into_iter().chain(center).collect();
    replaced.sort_unstable();
    replaced.into_iter().rev().for_each(|at| drop(told.remove(at)));
}
