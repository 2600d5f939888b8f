//! Whether pictures are what they claim to be: the board's reflections against the model, and against the usual
//! mistakes.
//!
//! A board at a known place in front of the camera has three degrees of freedom in a mirror (the plane) and shows six (its
//! pose): the other three are a test. The reflections of a correct session fit a mirror to the noise. If they do not, each
//! usual mistake is tried exactly: pictures mirrored or rotated by a driver, a board mounted or counted the other way round,
//! a camera file of another resolution, another board.
//!
//! | step | file |
//! | --- | --- |
//! | a reading: what was done to pictures, labels, board and camera, and that done back | `reading.rs` |
//! | the usual mistakes, with their words and their correction | `usual_mistakes.rs` |
//! | the views: pixels, and where the model places board and markers | `views.rs` |
//! | how well a reading explains the views | `fit.rs` |
//! | the best factor of the squares, of the resolution, of the focal length | `factors.rs` |
//! | which mistake is named, and the sentence | `judge.rs` |
//!
//! # The equations
//! A reading r says which pixels were meant, `u = P_r(ũ)`, which corner a label means, and which poses:
//! `camera_from_board = C_r · camera_from_board as modelled · B_r`, with the camera and the board scaled by its factor. In each
//! view the mirror's foot point f minimises the corners' reprojection error, `ρ_r² = min_f (1/N) Σ |u_i − π(x_i; f)|²`
//! ([`crate::mirror::MirrorEstimator::MaximumLikelihood`]). The residual of a reading is the median of ρ over the views, and
//! the median distance of the markers from where the model's are seen in these mirrors. A mistake is named only if it makes
//! the product of both many times smaller than they are as the session stands.
//!
//! # Units and frames
//! Pixels in px, lengths in m, points in the camera's optical frame. A residual is infinite where a reading explains fewer
//! than half of the views; nothing is NaN.
//!
//! # Errors
//! Numbers that make no camera or board at a factor that is tried, no view, an array of another length, and
//! [`crate::Error::Cancelled`]. A view that cannot be used (fewer than four corners, all on one line, half a pair) is not an
//! error: no reading explains it.
//!
//! ```
//! use mirror_core::camera::{Camera, Distortion};
//! use mirror_core::mirror::{Board, MirrorOptics};
//! use mirror_core::view_check::{View, ViewCheckOptions, Views, check_views};
//! use nalgebra::{Isometry3, Vector2, Vector3};
//!
//! let camera = Camera::new((1400, 1200), Vector2::new(693.0, 693.0), Vector2::new(699.5, 599.5), Distortion::None)?;
//! let board = Board::new((7, 5), 0.014)?;
//! let turn = Vector3::y() * std::f64::consts::PI;
//! let camera_from_board = Isometry3::new(Vector3::new(0.03, 0.075, 0.01), turn);
//! // A mirror 0.3 m before the camera, seen by a driver that mirrors its pictures left-right.
//! let mut corners_px = Vec::new();
//! for corner in board.corners_in_board() {
//!     let p = camera_from_board * corner;
//!     let depth = 0.6 - p.z;
//!     let (u, v) = (699.5 + 693.0 * p.x / depth, 599.5 + 693.0 * p.y / depth);
//!     corners_px.extend([1399.0 - u, v]);
//! }
//! let view = View { camera_from_board, corners_px, markers: Vec::new() };
//! let views = Views::new(camera, board, MirrorOptics::IDEAL, vec![view])?;
//! let checked = check_views(&views, &ViewCheckOptions { noise_px: 0.2, ..ViewCheckOptions::default() })?;
//! assert!(checked.mistake.is_some_and(|said| said.contains("the pictures are mirrored left-right")));
//! # Ok::<(), mirror_core::Error>(())
//! ```

mod factors;
mod fit;
mod judge;
mod reading;
#[cfg(test)]
mod tests;
mod usual_mistakes;
mod views;

pub use fit::Fit;
pub use judge::{ViewCheck, ViewCheckOptions, check_views};
pub use reading::{Labels, Pictures, Reading, Scale};
pub use usual_mistakes::usual_mistakes;
pub use views::{SeenMarker, View, Views};
