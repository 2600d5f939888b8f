//! The sim-to-real gap: where the model is wrong, which effect causes it, how far the gap shrinks once it is added.

mod adequacy;
mod atoms;
mod beside_geometry;
mod body;
mod colour;
mod deformation;
mod deviations;
mod diagnose;
mod effects;
mod fields;
mod fit;
mod floor;
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
mod odds;
mod outlying;
mod own;
mod pairing;
mod pairs;
mod panels;
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
mod seen;
mod sentence;
mod shift;
mod shrinkage;
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
pub use own::{OwnAxis, OwnEffect, OwnParameter, OwnPlace, Quantities, quantities};
pub use report::{
    Alternative, Cause, Checked, Diagnosis, Estimate, Field, FieldPoint, Gap, Member, Ranked, SeenMarker,
    Signature, SignaturePoint, Track, TrackAxis, TrackPoint, Where,
};
pub use screening::{Screening, screen_once};
