//! Input (a recording) and output (a diagnosis).

pub(super) mod checked;
pub(super) mod depends_on;
pub(super) mod diagnosis;
pub(super) mod left_out;
pub(super) mod progress;
pub(super) mod recording;
