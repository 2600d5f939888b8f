//! Triangulation: virtual rays of a marker to its position, with covariance.
//!
//! There are four methods with the same result type: [`midpoint`] (the paper's, and least squares for more than two
//! rays), [`lee_civera_mid2`] and [`unbiased`] (closed forms of two rays; the second has no bias in the mean) and
//! [`maximum_likelihood`] (in pixels, with the mirrors' covariances). All are in the camera frame: within a session
//! camera and board are fixed to each other, so it is the frame that the views share; each view has its own mirror.

mod batch;
mod likelihood;
mod mid2;
mod options;
mod parallax;
mod rays;
mod vectors;
mod views;

pub use batch::{PointBatch, Refused, TwoViews, point_pair_marker, point_pair_markers};
pub use likelihood::{MarkerView, maximum_likelihood};
pub use mid2::{lee_civera_mid2, unbiased};
pub use options::{PixelFit, Triangulated, TriangulationOptions, Triangulator};
pub use parallax::{line_angle_rad, widest_angle_rad};
pub use rays::{midpoint, midpoint_of_two};
pub use views::{MarkerObservation, triangulate_views};
