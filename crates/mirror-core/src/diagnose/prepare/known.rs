//! The result of a first diagnosis that a second one uses: with its causes known, smaller gross mistakes can be
//! found.

use crate::diagnose::model::deformation::Deformation;

/// What a first diagnosis found.
#[derive(Debug, Clone)]
pub(crate) struct Known {
    /// What differs from the nominal model by the causes that have a name, and the small errors beside them, but for causes far larger than those.
    pub deformation: Deformation,
    /// Frames, by index, of which something was left out as false.
    pub false_frames: Vec<usize>,
    /// Whether something is unexplained without a whole mistake, or larger than small errors are: it needs no more than strong evidence then.
    pub sought: bool,
}
