//! The crate's one error type: each variant contains what was given and what was required.

use nalgebra::SMatrix;

/// All errors of the core, with what was given, what was required and the fix.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A number that must be finite is not.
    #[error("{what}: got {got}, needed a finite number")]
    NotFinite {
        /// Which quantity.
        what: String,
        /// Its value, as printed.
        got: f64,
    },
    /// A number outside the range that makes sense.
    #[error("{what}: got {got}, needed {needed}")]
    OutOfRange {
        /// Which quantity.
        what: String,
        /// Its value.
        got: f64,
        /// What was required, in words.
        needed: String,
    },
    /// Two arguments whose lengths must agree do not.
    #[error("{what}: got {got}, needed {needed}")]
    LengthMismatch {
        /// Which argument.
        what: String,
        /// The length that was got.
        got: usize,
        /// The length that was needed.
        needed: usize,
    },
    /// Too little data for the request.
    #[error("{what}: got {got}, needed at least {needed}")]
    TooFew {
        /// Of what.
        what: String,
        /// How many there are.
        got: usize,
        /// How many are needed.
        needed: usize,
    },
    /// A vector that must have a direction is (nearly) zero.
    #[error("{what}: got a vector of length {length:e}, needed one with a direction")]
    NoDirection {
        /// Which vector.
        what: String,
        /// Its length.
        length: f64,
    },
    /// A point that the camera cannot see: behind it, or beyond where its lens model is one-to-one.
    #[error("point ({x:.6}, {y:.6}, {z:.6}) m in the camera frame: {reason}")]
    NotProjectable {
        /// x, m.
        x: f64,
        /// y, m.
        y: f64,
        /// z, m.
        z: f64,
        /// Why, and what was required.
        reason: &'static str,
    },
    /// A pixel that no ray reaches: the lens model cannot be inverted there.
    #[error("pixel ({u:.3}, {v:.3}) px: {reason}")]
    NotUnprojectable {
        /// u, px.
        u: f64,
        /// v, px.
        v: f64,
        /// Why, and what was required.
        reason: &'static str,
    },
    /// A robot model that cannot be used, or a link or joint that it does not have.
    #[error(transparent)]
    Robot(#[from] crate::robot::ModelFault),
    /// A corner index that the board does not have.
    #[error("board corner {index}: needed 0 to {} on a board of {nx}×{ny} inner corners", nx * ny - 1)]
    CornerOutsideBoard {
        /// The index that was got.
        index: usize,
        /// Inner corners along x.
        nx: usize,
        /// Inner corners along y.
        ny: usize,
    },
    /// A corner that was given twice.
    #[error("board corner {index}: given twice in one view, needed each corner at most once")]
    CornerTwice {
        /// The index that was got.
        index: usize,
    },
    /// Corners that do not determine a pose.
    #[error("board corners: got {got} {arrangement}, needed at least 4, no three of them on one line")]
    CornersDegenerate {
        /// How many corners.
        got: usize,
        /// How they lie.
        arrangement: &'static str,
    },
    /// An iteration that did not settle.
    #[error("{what}: not settled after {steps} steps (last step {last_step:e}, needed at most {needed:e})")]
    NotConverged {
        /// What was sought.
        what: &'static str,
        /// Steps taken.
        steps: usize,
        /// Size of the last step, in the units of the stopping rule.
        last_step: f64,
        /// The stopping rule.
        needed: f64,
    },
    /// An information matrix that cannot be inverted: the data do not determine the unknowns.
    #[error("{what}: the data do not determine it (its information matrix is singular)")]
    Undetermined {
        /// What was sought.
        what: &'static str,
    },
    /// A name that is not one of the valid ones.
    #[error("{what} \"{got}\": needed one of {valid}")]
    UnknownName {
        /// What is named.
        what: &'static str,
        /// The name that was got.
        got: String,
        /// The valid names.
        valid: String,
    },
    /// A name that is empty or belongs to something else already.
    #[error("{what}: got the name \"{got}\", which is empty or taken already; needed one of its own")]
    NameTaken {
        /// What is named.
        what: &'static str,
        /// The name that was got.
        got: String,
    },
    /// A mirror that camera and board are not both in front of.
    #[error(
        "mirror: got it {offset_m:.4} m before the camera and {board_m:.4} m before the board, needed both above 0; \
         check the corner labels and the camera-board transform"
    )]
    MirrorBehind {
        /// Distance of the mirror from the camera along the normal, m.
        offset_m: f64,
        /// Distance of the mirror from the board's centre along the normal, m.
        board_m: f64,
    },
    /// Views of one posture between which the camera moved against the board.
    #[error(
        "posture {posture}: the camera moved against the board between its views (by {by:.2e}, as the model says), needed a still head; \
         give views with another head position a posture number of their own"
    )]
    HeadMoved {
        /// The posture's number.
        posture: i64,
        /// The largest change of an element of the camera–board matrix.
        by: f64,
    },
    /// Rays too close to parallel to meet in a point.
    #[error(
        "parallax: got {:.3}° between the widest pair of rays, needed at least {:.3}°; take views that differ more",
        got_rad.to_degrees(), needed_rad.to_degrees()
    )]
    TooLittleParallax {
        /// The widest angle between two of the rays, rad.
        got_rad: f64,
        /// The least angle that is accepted, rad.
        needed_rad: f64,
    },
    /// A triangulated point that lies where no real marker can be seen in this mirror.
    #[error(
        "view {view}: the point ({x:.4}, {y:.4}, {z:.4}) m lies {place}; a pixel or a mirror plane is wrong"
    )]
    WrongSide {
        /// Which view, from 0.
        view: usize,
        /// x, m.
        x: f64,
        /// y, m.
        y: f64,
        /// z, m.
        z: f64,
        /// Where it lies.
        place: &'static str,
    },
    /// A view whose own best fit leaves too much: a wrong grid, a bent board, or another camera's file.
    #[error(
        "residual against a flat board: got {got_px:.2} px RMS, needed at most {needed_px:.2} px; \
         the grid is wrong (shifted by a row?), the board is bent, or the camera file is another camera's"
    )]
    ViewOverGate {
        /// Root mean square length of the residuals, px.
        got_px: f64,
        /// The gate, px.
        needed_px: f64,
    },
    /// What one of many views was refused for.
    #[error("view {view}: {source}")]
    InView {
        /// Which view, from 0.
        view: usize,
        /// What it was refused for.
        source: Box<Error>,
    },
    /// A computation that was stopped from outside, by its [`crate::Cancel`].
    #[error("stopped before the end, as was asked")]
    Cancelled,
    /// A picture that could not be made.
    #[error("{what}: {why}")]
    Picture {
        /// What was being done.
        what: String,
        /// Why it failed.
        why: String,
    },
}

impl Error {
    /// The same of the caller's rows: `rows[k]` is the row that was given as view k.
    pub fn of_rows(self, rows: &[usize]) -> Self {
        match self {
            Self::InView { view, source } => {
                Self::InView { view: rows.get(view).copied().unwrap_or(view), source }
            }
            other => other,
        }
    }
}

/// The crate's result.
pub type Result<T> = core::result::Result<T, Error>;

/// Refuses a number that is not finite.
pub(crate) fn finite(what: &str, value: f64) -> Result<f64> {
    if value.is_finite() { Ok(value) } else { Err(Error::NotFinite { what: what.to_owned(), got: value }) }
}

/// Refuses a number that is not finite and above zero.
pub(crate) fn positive(what: &str, value: f64) -> Result<f64> {
    if finite(what, value)? > 0.0 {
        Ok(value)
    } else {
        Err(Error::OutOfRange { what: what.to_owned(), got: value, needed: "a number above 0".to_owned() })
    }
}

/// Refuses a number that is not finite, and one below zero.
pub(crate) fn not_negative(what: &str, value: f64) -> Result<f64> {
    if finite(what, value)? >= 0.0 {
        return Ok(value);
    }
    Err(Error::OutOfRange { what: what.to_owned(), got: value, needed: "0 or above".to_owned() })
}

/// Whether a covariance is finite and symmetric but for rounding: factorisations read one triangle of it.
pub(crate) fn is_symmetric<const N: usize>(covariance: &SMatrix<f64, N, N>) -> bool {
    let size = covariance.amax();
    size.is_finite() && (covariance - covariance.transpose()).amax() <= 1e-9 * size
}
