//! The result of a first diagnosis that a second one uses: with its causes known, smaller gross mistakes can be
//! found.

use crate::diagnose::model::deformation::Deformation;

/// What a first diagnosis found.
#[derive(Debug, Clone)]
pub(crate) struct FirstResult {
    /// The deformation by the named causes and the small errors, without causes far larger than those.
    pub deformation: Deformation,
    /// Frames, by index, of which something was left out as false.
    pub false_frames: Vec<usize>,
    /// Whether something is unexplained without a gross mistake, or is larger than small errors are: then strong
    /// evidence is sufficient for a mistake.
    pub sought: bool,
}
