//! The sim-to-real gap: where the model is wrong, which effect causes it, how far the gap shrinks once it is added.

mod atoms;
mod body;
mod deformation;
mod diagnose;
mod effects;
mod fit;
mod frame;
mod hypothesis;
mod kinematics;
mod noise;
mod normal;
mod observations;
mod pose;
mod posture;
mod problem;
mod robust;
mod scene;
mod screen;
mod shift;
mod search;
mod signature;

pub use diagnose::{signature, trace};
pub use observations::{
    BoardSpec, Frame, MarkerSpec, MeasuredPoint, PointsFrame, Recording, SightSpec, Sighting, Target, Via,
};
