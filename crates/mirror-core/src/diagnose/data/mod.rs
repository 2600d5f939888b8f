//! What goes in (a recording) and what comes out (a diagnosis).

pub(super) mod diagnosis;
pub(super) mod progress;
pub(super) mod recording;
