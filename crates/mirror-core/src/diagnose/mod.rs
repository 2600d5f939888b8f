//! The sim-to-real gap: where the model is wrong, which effect causes it, how far the gap shrinks once it is added.
//!
//! In: a robot's model and a [`Recording`] (commanded postures, and where the board's corners and the markers were seen or measured).
//! Out: a [`Diagnosis`]. [`diagnose()`] reads like the method; each stage is a folder and uses only those above it, which a test holds.
//!
//! | stage | what it does | equation |
//! | --- | --- | --- |
//! | `data` | the recording, and the diagnosis as it is written | |
//! | `model` | forward model: a deformation δ of robot, camera, board and mirror, to predicted pixels or points; each frame's mirror plane f is eliminated | `r(δ) = z − h(δ, f̂(δ))`; `⟨x, y⟩ = x·y − (L⁻¹Dᵀx)·(L⁻¹Dᵀy)`, `D = ∂h/∂f`, `LLᵀ = DᵀD` |
//! | `effects` | the vocabulary: an effect at a place is columns of elementary changes, with priors `p ~ N(0, s²)` | `δ = Σ p_k x_k(place, frame)` |
//! | `likelihood` | noise from the data, Gauss–Newton fit with its Laplace evidence, the score test of all hypotheses at once | `log E = −½ (r² + (p/s)² + log det(I + S H S))` |
//! | `prepare` | options; what in the data is not used: slipped rows, false observations | |
//! | `criteria` | held-out prediction by regions of posture space; lack of fit against free markers | `gap = rms(ẑ_free − z_model)` on postures that were not fitted |
//! | `random_effects` | Gaussian random effects: discrepancy of each law, geometric tolerances with an estimated spread, free forms | `p ~ N(0, σ²)`, σ by maximal evidence |
//! | `selection` | posterior odds of models; the search that adds, exchanges, merges and drops; pairs that cancel; alternatives | `log P(M) = log E + Σ log π(effect, place)` |
//! | `assessment` | noise floor, gap closed, uncertainty of parameters, postures that would separate the alternatives, other sessions | `closed = (before − after)/(before − floor)` |
//! | `report` | verdict, sentence, signatures, plots | `δ_posture = ⟨x, r⟩/⟨x, x⟩` |
//!
//! A cause is told as found where its posterior odds against the same error at a tolerated size are above 1: a spike-and-slab
//! prior. What no effect explains is told as a place and as what it depends on, from free forms.
//!
//! Held out: postures are grouped into regions; for each region the parameters are fitted on the others and predicted on it. Not held out is the choice of
//! the model: false observations, slips and causes are searched on all postures, and the same regions decide whether a cause stays and
//! between a few models. Only another session (`OtherSession`) took part in neither.
//!
//! Sources: variable projection, Golub and Pereyra (1973); score test, Rao (1948); evidence framework, MacKay (1992); lack of fit, as in
//! regression with repeated measurements; T-optimal design, Atkinson and Fedorov (1975).

mod assessment;
mod criteria;
mod data;
mod effects;
mod likelihood;
mod model;
mod pipeline;
mod prepare;
mod principles;
mod random_effects;
mod report;
mod screening;
mod second_opinion;
mod selection;

#[cfg(test)]
mod tests;

pub use data::diagnosis::{
    Alternative, Cause, Checked, ChosenAnew, Data, Diagnosis, Estimate, Field, FieldPoint, Gap, GapStep,
    LeftOut, Limit, Member, Ranked, SeenMarker, Signature, SignaturePoint, Track, TrackAxis, TrackPoint,
    Verdict, Where,
};
pub use data::progress::Progress;
pub use data::recording::{
    BoardSpec, Frame, MarkerSpec, MeasuredPoint, PointsFrame, Recording, SightSpec, Sighting, Target,
    Tolerance, Tolerances, Via,
};
pub use effects::about::{PlaceKind, WrittenTo};
pub use effects::everywhere::{MistakeInfo, mistakes};
pub use effects::own::{OwnAxis, OwnEffect, OwnParameter, OwnPlace, Quantities, quantities};
pub use effects::registry::{EffectInfo, effects};
pub use prepare::options::{DiagnoseOptions, OtherSession};
pub use screening::{Screening, screen_once};
pub use second_opinion::diagnose;
