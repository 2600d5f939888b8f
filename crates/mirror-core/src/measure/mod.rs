//! A session measured by one mirror estimator: each view's mirror, then each posture's markers from all of its
//! views.
//!
//! [`crate::joint`] does the same with all views at once. This is the paper's way, view by view, for comparison and
//! for sessions whose camera–board transform is accurately known.

mod ladder;
mod options;

pub use ladder::{LadderMeasurement, MeasuredMarker, measure_ladder};
pub use options::MeasureOptions;
