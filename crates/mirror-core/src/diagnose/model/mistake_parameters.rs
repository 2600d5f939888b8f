//! Free parameters of gross mistakes. They were estimated before any cause was known, so a zero by a right angle, a
//! ratio or a delay is slightly wrong. If they were fixed, that error would appear as a separate cause.

use crate::diagnose::model::elementary::Column;

/// What a mistake's number may still be off by, a parameter of every model of the session.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct MistakeParameter {
    pub column: Column,
    /// Prior's standard deviation.
    pub std: f64,
    /// The reported mistake: effect, place and parameter.
    pub effect: String,
    pub at: String,
    pub parameter: String,
    /// The derivative of the reported parameter by this one.
    pub unit: f64,
}
