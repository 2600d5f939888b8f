//! Model selection: prior and posterior odds, the search and its moves, alternatives.

pub(super) mod alternatives;
pub(super) mod beside_slips;
mod candidates;
pub(super) mod correlated_noise;
pub(super) mod erratic_joint;
pub(super) mod extended_models;
pub(super) mod law_remainder;
pub(super) mod linear_search;
mod linear_standings;
mod linear_start;
mod linear_use;
pub(super) mod long_session;
pub(super) mod lost_column;
pub(super) mod near_ties;
pub(super) mod nonparametric;
pub(super) mod pairwise_start;
pub(super) mod posterior_odds;
pub(super) mod reduced_equations;
pub(super) mod scattered_joints;
pub(super) mod search;
pub(super) mod simplify;
pub(super) mod standing;
pub(super) mod transmission_errors;
pub(super) mod with_setup;
pub(super) mod with_tolerances;
pub(super) mod zeros_of_link;
