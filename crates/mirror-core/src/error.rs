//! The crate's one error type: each variant carries what was got and what was needed.

/// Everything that the core refuses, with what was got, what was needed and the fix.
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
        /// What was needed, in words.
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
        /// Why, and what was needed.
        reason: &'static str,
    },
    /// A pixel that no ray reaches: the lens model cannot be inverted there.
    #[error("pixel ({u:.3}, {v:.3}) px: {reason}")]
    NotUnprojectable {
        /// u, px.
        u: f64,
        /// v, px.
        v: f64,
        /// Why, and what was needed.
        reason: &'static str,
    },
    /// A robot model that cannot be used, or a link or joint that it does not have.
    #[error(transparent)]
    Robot(#[from] crate::robot::ModelFault),
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
