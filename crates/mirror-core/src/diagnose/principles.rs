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
/// Evidence is taken to this power: laws are never exact, so that data carry less evidence than the likelihood says (power posterior, Holmes and Walker
/// 2017). Found on sessions whose laws differ from the model's: probabilities are then as often right as they say.
pub(crate) const TEMPER: f64 = 0.35;
/// Probability reserved for unmodelled causes: no cause is reported as more probable than one less this, and an alternative that is less
/// probable than this is not reported.
pub(crate) const UNTHOUGHT_OF: f64 = 0.01;

/// The prior over models, log: a second cause at one joint (what looks like two is rather a law that the vocabulary has not),
pub(crate) const LOG_PRIOR_SAME_PLACE: f64 = -4.0;
/// a third one there,
pub(crate) const LOG_PRIOR_CROWD: f64 = -BEYOND_DOUBT;
/// a free-form error in the place of a law,
pub(crate) const LOG_PRIOR_FREE: f64 = -6.0;
/// what has no single place or no law against single causes: small errors everywhere, free-form errors, a joint that rests elsewhere each time, a set-up
/// that is not where the model has it. With these free there is hardly a remainder that they could not take a part of.
pub(crate) const LOG_PRIOR_STRUCTURE: f64 = -10.0;

/// Fewer postures than this show no dependence on posture: two points lie on every line.
pub(crate) const FEWEST_POSTURES: usize = 3;
/// Fewer observations than this of one thing do not show where it is: three numbers with a margin.
pub(crate) const FEWEST_OBSERVATIONS: usize = 8;
/// A run of fewer frames is no run: two postures of three views each.
pub(crate) const FEWEST_FRAMES: usize = 2 * FEWEST_POSTURES;
/// The held-out gap with many small errors, a slip or exchanged rows must be smaller than without by this factor.
pub(crate) const LEAST_HELD_OUT_RATIO: f64 = 0.98;
/// The same for one cause beside the others, of which each is a part of the gap.
pub(crate) const LEAST_HELD_OUT_GAIN: f64 = 0.002;
/// A share that is nearly all: of the frames, of what was seen in one, of a gap or of a noise that a model leaves.
pub(crate) const NEARLY_ALL: f64 = 0.75;
/// More than this share is most of it: of observations, of a group's squares, of an evidence, of a gap.
pub(crate) const MAJORITY: f64 = 0.5;
/// So many deviations away is no chance, however many observations there are: an observation is false, a remainder significant.
pub(crate) const FAR_DEVIATIONS: f64 = 6.0;
/// A number is there from this many of its standard deviations on: one in 400 by chance.
pub(crate) const SURE_DEVIATIONS: f64 = 3.0;
/// Residuals this many times their noise are a gap: a quarter of the noise's variance more.
pub(crate) const A_GAP: f64 = 1.12;
/// What is this many times the scatter around it stands out of it: a gap out of its noise floor, an error out of those of its kind.
pub(crate) const ABOVE_SCATTER: f64 = 1.5;
/// What is less probable than this, one in twenty, is left aside: such rivals are neither named beside a cause nor worth an experiment, and
/// an error larger than a limit would be missed in no more sessions.
pub(crate) const WORTH_NAMING: f64 = 0.05;
/// So many causes at once may be something else that they imitate together: one law that the vocabulary has not, a pair that nearly cancels, a
/// set-up that sits elsewhere, small errors everywhere.
pub(crate) const SEVERAL_CAUSES: usize = 3;
/// A variance that rests on fewer rows is known to no better than a quarter.
pub(crate) const FEWEST_REDUNDANT_ROWS: f64 = 40.0;
