//! The sim-to-real gap: where the model is wrong, which effect causes it, how far the gap shrinks once it is added.

mod adequacy;
mod atoms;
mod body;
mod deformation;
mod diagnose;
mod effects;
mod fit;
mod frame;
mod free_optics;
mod freeform;
mod group;
mod heldout;
mod hypothesis;
mod kinematics;
mod next;
mod noise;
mod normal;
mod observations;
mod pairing;
mod pose;
mod posture;
mod problem;
mod regions;
mod report;
mod rivals;
mod robust;
mod scene;
mod screen;
mod screening;
mod search;
mod shift;
mod signature;
mod slack;
mod unexplained;
mod words;

#[cfg(test)]
mod tests;

pub use diagnose::{DiagnoseOptions, OtherSession, diagnose};
pub use observations::{
    BoardSpec, Frame, MarkerSpec, MeasuredPoint, PointsFrame, Recording, SightSpec, Sighting, Target, Via,
};
pub use report::{
    Alternative, Cause, Checked, Diagnosis, Estimate, Gap, Ranked, Signature, SignaturePoint, Where,
};
pub use screening::{Screening, screen_once};
