//! Preparation: which data are not used, and gross mistakes that are undone.

pub(super) mod boards;
pub(super) mod false_observations;
pub(super) mod first_day;
pub(super) mod first_result;
pub(super) mod options;
pub(super) mod prepared;
pub(super) mod row_slip;
