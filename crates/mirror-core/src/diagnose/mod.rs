//! The diagnosis of the gap between a robot's model and the robot: where the model is wrong, which effect causes it,
//! and how far the gap shrinks when the effect is corrected.
//!
//! In: a robot's model and a [`Recording`] (commanded postures, and where the board's corners and the markers were
//! seen or measured). Out: a [`Diagnosis`].
//!
//! How to read the code: `second_opinion` has the entry point [`diagnose()`]. It calls `pipeline.rs`, which runs the
//! stages. Each stage is a folder. A stage uses only itself and the stages above it in this table; a test enforces
//! that (`tests/rust/architecture.rs`).
//!
//! | stage | what it does | equation |
//! | --- | --- | --- |
//! | `principles` | the thresholds and priors that all stages share, each with its meaning and source | |
//! | `data` | the recording, and the diagnosis as it is written | |
//! | `model` | forward model: predicted pixels or points for a deformation δ of robot, camera, board and mirror; each frame's mirror plane f is eliminated (variable projection) | `r(δ) = z − h(δ, f̂(δ))`; `⟨x, y⟩ = x·y − (L⁻¹Dᵀx)·(L⁻¹Dᵀy)`, `D = ∂h/∂f`, `LLᵀ = DᵀD` |
//! | `effects` | the vocabulary: an effect at a place is a set of columns of elementary changes, with priors `p ~ N(0, s²)` | `δ = Σ p_k x_k(place, frame)` |
//! | `likelihood` | noise and scatter of the joints estimated from the data, Gauss–Newton fit with its Laplace evidence, score test of all hypotheses at once | `log E = −½ (r² + (p/s)² + log det(I + S H S))` |
//! | `prepare` | options; observations that are not used: slipped rows, false observations; gross mistakes of model or log, which are undone | |
//! | `criteria` | cross-validation over regions of posture space; lack of fit against free markers | `gap = rms(ẑ_free − z_model)` on postures that were not fitted |
//! | `random_effects` | Gaussian random effects: discrepancy of each law, geometric tolerances with an estimated scale, free forms | `p ~ N(0, σ²)`, σ by maximal evidence |
//! | `selection` | posterior odds of models; the search that adds, exchanges, merges and drops causes; pairs that cancel; alternatives | `log P(M) = log E + Σ log π(effect, place)` |
//! | `assessment` | noise floor, gap closed, uncertainty of parameters, stability, postures that would separate the alternatives, other sessions | `closed = (before − after)/(before − floor)` |
//! | `report` | verdict, sentence, signatures, plots | `δ_posture = ⟨x, r⟩/⟨x, x⟩` |
//! | `pipeline` | runs the stages on one recording | |
//! | `second_opinion` | runs the pipeline again with other assumptions where the first result gives reason for doubt, and chooses one of the two | |
//! | `planning` | which postures show most, and what they will show, before a session is recorded | `½ log det(S + M Σ Mᵀ)` |
//! | `screening` | the score test alone, for benches and a quick look at a session | |
//!
//! A cause is reported if its posterior odds against the same error at a tolerated size exceed the threshold (a
//! spike-and-slab prior). What no effect explains is reported as a place, with the variables on which it depends,
//! from free-form errors.
//!
//! What is held out: postures are grouped into regions. For each region the parameters are fitted on the other
//! regions and predict it. The selection of the model is not held out: false observations, slips and causes are
//! searched on all postures, and the same regions decide whether a cause stays and between a few models. Only
//! another session ([`OtherSession`]) takes part in neither.
//!
//! Sources: variable projection, Golub and Pereyra (1973); score test, Rao (1948); evidence framework, MacKay
//! (1992); lack of fit, as in regression with repeated measurements; T-optimal design, Atkinson and Fedorov (1975).

mod assessment;
mod criteria;
mod data;
mod effects;
mod likelihood;
mod model;
mod pipeline;
mod planning;
mod prepare;
mod principles;
mod random_effects;
mod report;
mod screening;
mod second_opinion;
mod selection;

#[cfg(test)]
mod tests;

pub use data::checked::{Checked, Ground, LeftOutThere};
pub use data::depends_on::DependsOn;
pub use data::diagnosis::{
    Alternative, Cause, ChosenAnew, Data, Diagnosis, Estimate, Field, FieldPoint, Gap, GapStep, Limit,
    Member, Ranked, SeenMarker, Signature, SignaturePoint, Track, TrackAxis, TrackPoint, Verdict, Where,
};
pub use data::left_out::{Elsewhere, LeftOut, Reason};
pub use data::progress::Progress;
pub use data::recording::{
    BoardSpec, Frame, MarkerSpec, MeasuredPoint, PointsFrame, Recording, SightSpec, Sighting, Target,
    Tolerance, Tolerances, Via,
};
pub use effects::about::{PlaceKind, WrittenTo};
pub use effects::everywhere::{MistakeInfo, mistakes};
pub use effects::own::{OwnAxis, OwnEffect, OwnParameter, OwnPlace, Quantities, quantities};
pub use effects::registry::{EffectInfo, effects};
pub use model::link_bends::{LinkBend, link_bends};
pub use planning::{Foreseen, PlannedSession, Pool, Twin};
pub use prepare::options::{DiagnoseOptions, OtherSession};
pub use screening::{Screening, screen_once};
pub use second_opinion::diagnose;
