//! A session measured by one estimator of the ladder: each view's mirror, then each posture's markers by all views of it.
//!
//! [`crate::joint`] does the same with all views at once; this is the way of the paper, view by view, for comparison
//! and where the camera–board transform is trusted.

mod ladder;
mod options;

pub use ladder::{LadderMeasurement, MeasuredMarker, measure_ladder};
pub use options::MeasureOptions;
