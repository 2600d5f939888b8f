//! The rig: camera, board and the transform between them.

use super::board::Board;
use super::optics::MirrorOptics;
use crate::camera::Camera;
use crate::error::{Error, Result, is_symmetric};
use nalgebra::{Isometry3, Matrix6};

/// What does not change between the views of a session: the camera, the board and how they are fixed to each other.
///
/// ```
/// use mirror_core::camera::{Camera, Distortion};
/// use mirror_core::mirror::{Board, Rig};
/// use nalgebra::{Isometry3, Vector2};
///
/// let camera = Camera::new((800, 600), Vector2::new(693.0, 693.0), Vector2::new(399.5, 299.5), Distortion::None)?;
/// let rig = Rig::new(camera, Board::new((7, 5), 0.014)?, Isometry3::translation(0.0, 0.075, 0.0));
/// assert!(rig.optics.is_ideal());
/// # Ok::<(), mirror_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Rig {
    /// The camera.
    pub camera: Camera,
    /// The board.
    pub board: Board,
    /// Where the board is, `camera_from_board`.
    pub camera_from_board: Isometry3<f64>,
    /// Its covariance: 6×6 in the pose tangent of [`crate::geometry::rotation`]. `None`: taken as exact.
    pub camera_from_board_covariance: Option<Matrix6<f64>>,
    /// The mirror's known glass and curvature. Maximum likelihood uses them; the paper's estimators take every
    /// mirror as ideal, and their planes absorb the difference.
    pub optics: MirrorOptics,
}

impl Rig {
    /// A rig with an ideal mirror whose camera–board transform is taken as exact.
    pub fn new(camera: Camera, board: Board, camera_from_board: Isometry3<f64>) -> Self {
        Self {
            camera,
            board,
            camera_from_board,
            optics: MirrorOptics::IDEAL,
            camera_from_board_covariance: None,
        }
    }

    /// The same rig before a mirror with known glass or curvature.
    pub fn with_optics(mut self, optics: MirrorOptics) -> Self {
        self.optics = optics;
        self
    }

    /// The same rig with the covariance of its camera–board transform (6×6, pose tangent, rotation first).
    ///
    /// # Errors
    /// [`Error::OutOfRange`] where the matrix is not symmetric and positive semi-definite.
    pub fn with_covariance(mut self, covariance: Matrix6<f64>) -> Result<Self> {
        let size = covariance.amax();
        let smallest = if size.is_finite() { covariance.symmetric_eigenvalues().min() } else { f64::NAN };
        // Rounding makes eigenvalues of a semi-definite matrix slightly negative.
        if !(is_symmetric(&covariance) && smallest >= -1e-9 * size) {
            return Err(Error::OutOfRange {
                what: "smallest eigenvalue of the camera-board covariance".into(),
                got: smallest,
                needed: "a finite, symmetric, positive semi-definite 6×6 matrix".into(),
            });
        }
        self.camera_from_board_covariance = Some(covariance);
        Ok(self)
    }
}
