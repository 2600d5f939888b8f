//! Assessment of the result: noise floor, gap closed, uncertainty, stability, next postures.

pub(super) mod came_back;
pub(super) mod design;
pub(super) mod evidence;
mod false_there;
pub(super) mod false_together;
pub(super) mod findings;
pub(super) mod further_cause;
pub(super) mod gap_closed;
mod its_ground;
pub(super) mod left_out_together;
pub(super) mod limits;
pub(super) mod names_in_file;
pub(super) mod nested;
pub(super) mod noise_floor;
pub(super) mod other_session;
pub(super) mod posture_draws;
pub(super) mod resample_deviations;
pub(super) mod resampled;
pub(super) mod stability;
pub(super) mod survivors;
pub(super) mod uncertainty;
pub(super) mod weighed;
pub(super) mod zero_lost;
