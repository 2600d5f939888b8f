//! The sums of the score test at the nominal model, on all frames. The likeliest single cause, the ranking of all hypotheses, the
//! search's first step and what could be in the place of a single cause are read from them: they are summed once.

use crate::diagnose::effects::Place;
use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::likelihood::fit::Group;
use crate::diagnose::likelihood::score_sums::ScoreSums;
use crate::diagnose::likelihood::score_test::{Screening, scored};
use crate::diagnose::model::problem::{FrameData, Noise, Problem};
use crate::diagnose::model::slips::Slip;
use crate::diagnose::principles::Guard;
use crate::error::Result;

/// Sums serve at another noise that differs by less than this share: hypotheses are ranked with them, not fitted.
const SAME_NOISE: Guard = 0.02;

/// Whether sums at a noise serve at another one.
pub(crate) fn serve_at(noise: Noise, other: Noise) -> bool {
    let near = |a: f64, b: f64| (a - b).abs() <= SAME_NOISE * b.abs();
    near(noise.corner_px, other.corner_px)
        && near(noise.marker_px, other.marker_px)
        && near(noise.point_m, other.point_m)
}

/// The sums, and what they were summed over.
pub(crate) struct NominalSums {
    pub sums: ScoreSums,
    noise: Noise,
    nuisances: Vec<f64>,
    hypotheses: Vec<(String, Place)>,
    data: Data,
}

/// What changes during a diagnosis and sums depend on: observations that are left out as false, positions, gravity's loads, slips.
struct Data {
    frames: Vec<FrameData>,
    commanded: Vec<f64>,
    torque: Vec<f64>,
    slips: Vec<Slip>,
}

impl Data {
    fn of(problem: &Problem) -> Self {
        let scene = &problem.scene;
        let (commanded, torque) = (scene.commanded.clone(), scene.torque.clone());
        Self { frames: problem.frames.clone(), commanded, torque, slips: problem.slips.clone() }
    }

    fn are_of(&self, problem: &Problem) -> bool {
        let scene = &problem.scene;
        self.frames == problem.frames
            && self.commanded == scene.commanded
            && self.torque == scene.torque
            && self.slips == problem.slips
    }
}

impl NominalSums {
    /// # Errors
    /// Invalid parameters of the camera or mirror.
    pub fn at(problem: &Problem, catalogue: &Catalogue, noise: Noise) -> Result<Self> {
        let nominal = Model::nominal(problem);
        Ok(Self {
            sums: ScoreSums::at(problem, catalogue, &Group::default(), &nominal, noise, None)?,
            noise,
            nuisances: nominal.nuisances,
            hypotheses: names(catalogue),
            data: Data::of(problem),
        })
    }

    /// All hypotheses, best first.
    pub fn screening(&self, catalogue: &Catalogue) -> Screening {
        scored(&self.sums, catalogue, &[], &[])
    }

    /// Whether they are those of a model on all frames of a problem, at a noise, for the hypotheses of a catalogue.
    pub fn are_of(&self, problem: &Problem, catalogue: &Catalogue, model: &Model, noise: Noise) -> bool {
        model.terms.is_empty()
            && model.group.is_empty()
            && model.nuisances == self.nuisances
            && serve_at(self.noise, noise)
            && names(catalogue) == self.hypotheses
            && self.data.are_of(problem)
    }
}

fn names(catalogue: &Catalogue) -> Vec<(String, Place)> {
    let of = |h: usize| (catalogue.effect(h).name().to_owned(), catalogue.hypotheses[h].place);
    (0..catalogue.hypotheses.len()).map(of).collect()
}
