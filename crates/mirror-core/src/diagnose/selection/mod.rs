//! Model selection: prior and posterior odds, the search and its moves, alternatives.

pub(super) mod alternatives;
pub(super) mod beside_slips;
pub(super) mod beyond;
mod candidates;
pub(super) mod law_remainder;
pub(super) mod lingering_noise;
pub(super) mod long_session;
pub(super) mod lost_column;
pub(super) mod near_ties;
pub(super) mod nonparametric;
pub(super) mod pairwise_start;
pub(super) mod posterior_odds;
pub(super) mod restless;
pub(super) mod search;
pub(super) mod simplify;
pub(super) mod with_setup;
pub(super) mod with_tolerances;
