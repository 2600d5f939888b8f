//! The quantities on which decisions of the diagnosis depend, each with its meaning and its source.
//!
//! Thresholds on odds, probabilities and counts are defined here, or are derived from these where they are used. The
//! type of a constant states its kind, so that decisions can be distinguished from computation. A test
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

/// Minimum log posterior odds of a reported cause: 20 to 1, usual for strong evidence (Kass and Raftery 1995). The
/// same holds for a displaced mount and for an outlier among the small errors.
pub(crate) const LEAST_LOG_ODDS: Threshold = 3.0;
/// Log odds beyond doubt, even with the usual errors of laws: what a gross mistake must gain over small errors
/// everywhere, and how far a model must fall behind another so that no refinement can reverse the order.
pub(crate) const BEYOND_DOUBT: Threshold = 30.0;
/// Exponent of the power posterior: laws are never exact, so the data contain less evidence than the likelihood
/// says (Holmes and Walker 2017). Estimated on sessions whose laws differ from the model's: with it probabilities
/// are calibrated.
pub(crate) const TEMPER: Prior = 0.35;
/// Probability reserved for unmodelled causes: no cause is reported as more probable than one less this, and an alternative that is less
/// probable than this is not reported.
pub(crate) const UNTHOUGHT_OF: Threshold = 0.01;

/// The log prior over models: a second cause at one joint (what looks like two causes is often one law that the
/// vocabulary lacks),
pub(crate) const LOG_PRIOR_SAME_PLACE: Prior = -4.0;
/// a third one there,
pub(crate) const LOG_PRIOR_CROWD: Prior = -BEYOND_DOUBT;
/// a free-form error in place of a law,
pub(crate) const LOG_PRIOR_FREE: Prior = -6.0;
/// models without a single place or law, against single causes: small errors everywhere, free-form errors, an
/// independent joint error in each posture, displaced mounts. They can absorb a part of almost any remainder.
pub(crate) const LOG_PRIOR_STRUCTURE: Prior = -10.0;

/// Fewer postures than this show no dependence on posture: two points lie on every line.
pub(crate) const FEWEST_POSTURES: Count = 3;
/// Fewer observations than this of one thing do not show where it is: three numbers with a margin.
pub(crate) const FEWEST_OBSERVATIONS: Count = 8;
/// A run of fewer frames is no run: two postures of three views each.
pub(crate) const FEWEST_FRAMES: Count = 2 * FEWEST_POSTURES;
/// The held-out gap with many small errors, a slip or exchanged rows must be smaller than without by this factor.
pub(crate) const LEAST_HELD_OUT_RATIO: Threshold = 0.98;
/// The same for one cause together with others, each of which is only a part of the gap.
pub(crate) const LEAST_HELD_OUT_GAIN: Threshold = 0.002;
/// A share that counts as nearly all: of the frames, of the observations in a frame, of a gap or of a noise that a
/// model leaves.
pub(crate) const NEARLY_ALL: Threshold = 0.75;
/// More than this share is most of it: of observations, of a group's squares, of an evidence, of a gap.
pub(crate) const MAJORITY: Threshold = 0.5;
/// So many deviations away is no chance, however many observations there are: an observation is false, a remainder significant.
pub(crate) const FAR_DEVIATIONS: Threshold = 6.0;
/// A number is there from this many of its standard deviations on: one in 400 by chance.
pub(crate) const SURE_DEVIATIONS: Threshold = 3.0;
/// Residuals this many times their noise are a gap: a quarter of the noise's variance more.
pub(crate) const A_GAP: Threshold = 1.12;
/// A value this many times its scatter is an outlier: a gap compared with its noise floor, an error compared with
/// others of its kind.
pub(crate) const ABOVE_SCATTER: Threshold = 1.5;
/// A probability below this, one in twenty, is negligible: such alternatives are neither named with a cause nor
/// worth an experiment, and an error larger than a limit would be missed in no more sessions. A larger share of
/// false observations is reported.
pub(crate) const WORTH_NAMING: Threshold = 0.05;
/// From this many causes on, they may together imitate something else: one law that the vocabulary lacks, a pair
/// that nearly cancels, displaced mounts, small errors everywhere.
pub(crate) const SEVERAL_CAUSES: Count = 3;
/// A variance from fewer rows is known to no better than a quarter.
pub(crate) const FEWEST_REDUNDANT_ROWS: Threshold = 40.0;
