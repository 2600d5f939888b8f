//! Several causes of the optics at once, an error of the detector of markers among them: together they stand for a lens or a
//! mirror that the vocabulary lacks.
//!
//! A fisheye that is described by a polynomial, a mirror that is bent about one axis, or one of two panels moves the picture
//! of each point in its own way. An offset and a scale of the markers' pixels, which the board's corners do not share, with
//! a centre, a focal length or a curvature beside it, absorb most of that. Each alone is a plausible error; that both
//! happened is less probable than one law without a name.

use crate::diagnose::data::diagnosis::{Diagnosis, Verdict};
use crate::diagnose::likelihood::probability::unfinished;

/// The error of the detector of markers.
const OF_DETECTOR: &str = "marker_image";
/// The effects that it may stand beside.
const OF_OPTICS: [&str; 5] =
    ["camera_center", "camera_focal", "lens_distortion", "mirror_curvature", "mirror_glass"];

/// Limits what is told of them: each is no more probable than something without a name.
pub(crate) fn limit(diagnosis: &mut Diagnosis) {
    let has = |names: &[&str]| diagnosis.causes.iter().any(|c| names.contains(&c.effect.as_str()));
    if !has(&[OF_DETECTOR]) || !has(&OF_OPTICS) {
        return;
    }
    let together = |effect: &str| effect == OF_DETECTOR || OF_OPTICS.contains(&effect);
    for cause in diagnosis.causes.iter_mut().filter(|c| together(&c.effect)) {
        cause.probability = unfinished(cause.probability);
    }
    let told = "an error of the markers' pixels beside one of the camera or the mirror: both together may stand for a lens of another model, or for a mirror \
                that is not flat in a way of its own; calibrate the camera again with the model of its lens, and use one flat pane";
    if diagnosis.verdict == Verdict::Explained {
        diagnosis.verdict = Verdict::Partial;
        diagnosis.sentence += &format!(" But it is {told}.");
    } else {
        diagnosis.warnings.push(told.to_owned());
    }
}

#[cfg(test)]
mod tests {
    use super::{OF_DETECTOR, OF_OPTICS};
    use crate::diagnose::effects::vocabulary;

    #[test]
    fn all_of_them_are_effects() {
        let names: Vec<String> = vocabulary().iter().map(|e| e.name().to_owned()).collect();
        assert!(OF_OPTICS.iter().chain(&[OF_DETECTOR]).all(|name| names.iter().any(|n| n == name)));
    }
}
