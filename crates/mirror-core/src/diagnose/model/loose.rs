//! Numbers of whole mistakes that stay free: found before any cause was known, a zero by a right angle, a ratio or a delay is off by a little,
//! which would pass for a cause of its own.

use crate::diagnose::model::elementary::Column;

/// What a mistake's number may still be off by, a parameter of every model of the session.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Loose {
    pub column: Column,
    /// Prior's standard deviation.
    pub std: f64,
    /// The mistake as it is told: effect, place and parameter.
    pub effect: String,
    pub at: String,
    pub parameter: String,
    /// By how much the told parameter grows with this one.
    pub unit: f64,
}
