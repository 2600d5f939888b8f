//! The next postures: where rivals remain, the few commanded postures that would separate them best.

use super::diagnose::Findings;
use super::report::Cause;
use crate::error::Result;
use std::collections::BTreeMap;

/// Postures that would tell rivals apart; none where there are no rivals.
///
/// # Errors
/// A camera or mirror that cannot be.
pub(crate) fn next_postures(
    _findings: &Findings<'_>,
    _causes: &[Cause],
) -> Result<Vec<BTreeMap<String, f64>>> {
    Ok(Vec::new())
}
