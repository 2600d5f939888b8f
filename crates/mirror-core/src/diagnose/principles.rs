//! What decisions of the diagnosis rest on: a few quantities, each with its meaning and where it comes from.
//!
//! Thresholds on odds, probabilities and counts are these or follow from them where they are used. Numerical tolerances and steps of
//! solvers are none of them ([`super::model::solver`]).

/// A cause is told from these log posterior odds on: 20 to 1, as is usual for strong evidence (Kass and Raftery 1995). The same holds for
/// a displaced mount and for a small error that stands out of the others.
pub(crate) const LEAST_LOG_ODDS: f64 = 3.0;
/// Log odds from which the data leave no doubt, even if the laws are wrong by as much as laws are: what a whole mistake must
/// gain over small errors everywhere, and by how much a model falls so far behind another that no refinement brings it back.
pub(crate) const BEYOND_DOUBT: f64 = 30.0;
/// Evidence is taken to this power: laws are never exact, so that data speak less than they seem to (power posterior, Holmes and Walker
/// 2017). Found on sessions whose laws differ from the model's: probabilities are then as often right as they say.
pub(crate) const TEMPER: f64 = 0.35;
/// What is kept back for a cause that nobody thought of: nothing is told as more probable than the rest, and a rival that is less probable
/// than this is not worth a word.
pub(crate) const UNTHOUGHT_OF: f64 = 0.01;

/// The prior over models, log: a second cause at one joint (what looks like two is rather a law that the vocabulary has not),
pub(crate) const LOG_PRIOR_SAME_PLACE: f64 = -4.0;
/// a third one there,
pub(crate) const LOG_PRIOR_CROWD: f64 = -40.0;
/// a free-form error in the place of a law,
pub(crate) const LOG_PRIOR_FREE: f64 = -6.0;
/// small errors everywhere against single causes,
pub(crate) const LOG_PRIOR_GEOMETRY: f64 = -10.0;
/// a displaced set-up against one that was mounted by a machine: with it free there is hardly a remainder that it could not take a part
/// of.
pub(crate) const LOG_PRIOR_SETUP: f64 = -12.0;

/// Fewer postures than this show no dependence on posture: two points lie on every line.
pub(crate) const FEWEST_POSTURES: usize = 3;
/// A run of fewer frames is no run: two postures of three views each.
pub(crate) const FEWEST_FRAMES: usize = 2 * FEWEST_POSTURES;
/// The held-out gap with many small errors, a slip or exchanged rows must be smaller than without by this factor.
pub(crate) const LEAST_HELD_OUT_RATIO: f64 = 0.98;
/// A share of the frames that is all of them.
pub(crate) const NEARLY_ALL: f64 = 0.75;
/// A variance that rests on fewer rows is known to no better than a quarter.
pub(crate) const FEWEST_REDUNDANT_ROWS: f64 = 40.0;
