//! The sim-to-real gap: where the model is wrong, which effect causes it, how far the gap shrinks once it is added.

mod assessment;
mod criteria;
mod data;
mod effects;
mod likelihood;
mod model;
mod pipeline;
mod prepare;
mod random_effects;
mod report;
mod screening;
mod selection;

#[cfg(test)]
mod tests;

pub use data::diagnosis::{
    Alternative, Cause, Checked, Diagnosis, Estimate, Field, FieldPoint, Gap, Member, Ranked, SeenMarker,
    Signature, SignaturePoint, Track, TrackAxis, TrackPoint, Verdict, Where,
};
pub use data::recording::{
    BoardSpec, Frame, MarkerSpec, MeasuredPoint, PointsFrame, Recording, SightSpec, Sighting, Target, Via,
};
pub use effects::about::{PlaceKind, WrittenTo};
pub use effects::own::{OwnAxis, OwnEffect, OwnParameter, OwnPlace, Quantities, quantities};
pub use effects::registry::{EffectInfo, effects};
pub use pipeline::diagnose;
pub use prepare::options::{DiagnoseOptions, OtherSession};
pub use screening::{Screening, screen_once};
