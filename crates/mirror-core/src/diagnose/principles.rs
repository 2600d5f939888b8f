//! The quantities on which decisions of the diagnosis depend, each with its meaning and its source.
//!
//! Thresholds on odds, probabilities and counts are defined here, or are derived from these where they are used. The
//! type of a constant states its kind, so that decisions can be told from computation. A test
//! (`tests/rust/architecture.rs`) counts the thresholds and finds constants without a kind. Numerical tolerances and
//! steps of solvers are in [`super::model::solver`], limits of work in [`super::model::work_budget`].

/// A number on which a decision turns.
pub(crate) type Threshold = f64;
/// The same for a count: the fewest or the most of something.
pub(crate) type Count = usize;
/// A part of the statistical model: a prior's standard deviation or log probability, a common size of an error, a share of false observations.
pub(crate) type Prior = f64;
/// Keeps a computation away from where its numbers mean nothing, or ends it where more steps change nothing that is reported.
pub(crate) type Guard = f64;
/// Where and how finely values are tried.
pub(crate) type Grid = f64;
/// How much is computed or reported: knots, resamples, candidates, lines of a list.
pub(crate) type Size = usize;

/// A cause is told from these log posterior odds on: 20 to 1, as is usual for strong evidence (Kass and Raftery 1995). The same holds for
/// a displaced mount and for a small error that stands out of the others.
pub(crate) const LEAST_LOG_ODDS: Threshold = 3.0;
/// Log odds from which the data leave no doubt, even if the laws are wrong by as much as laws are: what a whole mistake must
/// gain over small errors everywhere, and by how much a model falls so far behind another that no refinement brings it back.
pub(crate) const BEYOND_DOUBT: Threshold = 30.0;
/// Evidence is taken to this power: laws are never exact, so that data carry less evidence than the likelihood says (power posterior, Holmes and Walker
/// 2017). Found on sessions whose laws differ from the model's: probabilities are then as often right as they say.
pub(crate) const TEMPER: Prior = 0.35;
/// Probability reserved for unmodelled causes: no cause is reported as more probable than one less this, and an alternative that is less
/// probable than this is not reported.
pub(crate) const UNTHOUGHT_OF: Threshold = 0.01;

/// The prior over models, log: a second cause at one joint (what looks like two is rather a law that the vocabulary has not),
pub(crate) const LOG_PRIOR_SAME_PLACE: Prior = -4.0;
/// a third one there,
pub(crate) const LOG_PRIOR_CROWD: Prior = -BEYOND_DOUBT;
/// a free-form error in the place of a law,
pub(crate) const LOG_PRIOR_FREE: Prior = -6.0;
/// what has no single place or no law against single causes: small errors everywhere, free-form errors, a joint that rests elsewhere each time, a set-up
/// that is not where the model has it. With these free there is hardly a remainder that they could not take a part of.
pub(crate) const LOG_PRIOR_STRUCTURE: Prior = -10.0;

/// Fewer postures than this show no dependence on posture: two points lie on every line.
pub(crate) const FEWEST_POSTURES: Count = 3;
/// Fewer observations than this of one thing do not show where it is: three numbers with a margin.
pub(crate) const FEWEST_OBSERVATIONS: Count = 8;
/// A run of fewer frames is no run: two postures of three views each.
pub(crate) const FEWEST_FRAMES: Count = 2 * FEWEST_POSTURES;
/// The held-out gap with many small errors, a slip or exchanged rows must be smaller than without by this factor.
pub(crate) const LEAST_HELD_OUT_RATIO: Threshold = 0.98;
/// The same for one cause beside the others, of which each is a part of the gap.
pub(crate) const LEAST_HELD_OUT_GAIN: Threshold = 0.002;
/// A share that is nearly all: of the frames, of what was seen in one, of a gap or of a noise that a model leaves.
pub(crate) const NEARLY_ALL: Threshold = 0.75;
/// More than this share is most of it: of observations, of a group's squares, of an evidence, of a gap.
pub(crate) const MAJORITY: Threshold = 0.5;
/// So many deviations away is no chance, however many observations there are: an observation is false, a remainder significant.
pub(crate) const FAR_DEVIATIONS: Threshold = 6.0;
/// A number is there from this many of its standard deviations on: one in 400 by chance.
pub(crate) const SURE_DEVIATIONS: Threshold = 3.0;
/// Residuals this many times their noise are a gap: a quarter of the noise's variance more.
pub(crate) const A_GAP: Threshold = 1.12;
/// What is this many times the scatter around it stands out of it: a gap out of its noise floor, an error out of those of its kind.
pub(crate) const ABOVE_SCATTER: Threshold = 1.5;
/// What is less probable than this, one in twenty, is left aside: such rivals are neither named beside a cause nor worth an experiment, and
/// an error larger than a limit would be missed in no more sessions. A larger share of false observations is reported.
pub(crate) const WORTH_NAMING: Threshold = 0.05;
/// So many causes at once may be something else that they imitate together: one law that the vocabulary has not, a pair that nearly cancels, a
/// set-up that sits elsewhere, small errors everywhere.
pub(crate) const SEVERAL_CAUSES: Count = 3;
/// A variance that rests on fewer rows is known to no better than a quarter.
pub(crate) const FEWEST_REDUNDANT_ROWS: Threshold = 40.0;
