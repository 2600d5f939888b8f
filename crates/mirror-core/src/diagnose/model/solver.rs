//! Options of the solvers: steps and tolerances. None of them decides anything: with more steps or finer tolerances
//! results move by less than their noise.

/// A motion (rad, m), torque (N m), droop (rad/(N m)) or distance (m) below this is none.
pub(crate) const NEGLIGIBLE: f64 = 1e-6;

/// Steps and tolerances of all solvers of the diagnosis.
pub(crate) struct Solver {
    /// Gauss–Newton steps for a board's plane: it converges quadratically, but a small board that is seen obliquely needs some steps, damped
    /// ones among them, along the direction that its corners hardly show.
    pub board_steps: usize,
    /// Share of a board's χ² below which a further step's gain does not matter.
    pub board_gain: f64,
    /// Steps, and the number of corners used, where the plane need only be known to a share of the markers'
    /// distances.
    pub rough_board_steps: usize,
    pub rough_corners: usize,
    /// Steps of a plane from the board's optimum to that of the whole frame, which is close. One that gains less than
    /// this (in −2 log likelihood) is the last: what a further one would gain is of second order.
    pub plane_steps: usize,
    pub plane_gain: f64,
    /// The offset of a ball's outline, a part of a pixel, is computed again where the plane has moved by this share of
    /// its distance: by no more does it change.
    pub plane_moved: f64,
    /// A plane from nearby is good where the next step would gain less than this (in −2 log likelihood),
    pub last_plane_gain: f64,
    /// and is not near if it would gain more than this, or after this many steps, or if a smaller share of the
    /// board's corners has weight: from there good corners look false, have no weight, and would never correct the
    /// plane.
    pub nearby_gain: f64,
    pub nearby_steps: usize,
    pub least_corners_counted: f64,
    /// A condensed column with less than this share (squared) outside the earlier ones depends on them numerically:
    /// rounding is a share of about 1e-15 of the columns' squares.
    pub dependent: f64,
    /// A step of a model's fit that gains less than this (in −2 log likelihood) is taken without another
    /// evaluation: the rest is of second order, and log evidence need not be known better than to a hundredth.
    pub last_gain: f64,
    /// A step that gains less and makes the cost larger is not tried again with more damping.
    pub least_retried: f64,
    /// The linear model predicts the gain of a fit to within this factor: a fit that would not be sufficient with
    /// it is given up.
    pub most_hoped: f64,
    /// Gauss–Newton steps of a candidate, and of the model that is kept.
    pub candidate_steps: usize,
    pub final_steps: usize,
    /// Steps of a fit that only follows a change of noise or spreads.
    pub loose_steps: usize,
    /// Steps of a model from which a cause was taken.
    pub without_steps: usize,
    /// Steps where little moves: between two estimates of the spreads, and of the nuisances alone.
    pub few_steps: usize,
    /// Iterations between loads and postures: each leaves the share by which the droop changes the load.
    pub load_steps: usize,
    /// Iterations between two quantities that depend on each other: values and scales, noise and causes,
    /// displacement and small errors.
    pub rounds: usize,
    /// Steps of the scales at one linear model; by no more than this factor each.
    pub spread_steps: usize,
    pub largest_spread_step: f64,
    /// Spreads that changed by less than this (log) are settled.
    pub spreads_settled: f64,
    /// Rounds of the clustering of postures.
    pub cluster_rounds: usize,
    /// A variance of the noise that changed by less than this share is settled.
    pub noise_settled: f64,
    /// Step of differences, rad and m.
    pub difference: f64,
}

pub(crate) const SOLVER: Solver = Solver {
    board_steps: 40,
    board_gain: 1e-4,
    rough_board_steps: 5,
    rough_corners: 16,
    plane_steps: 2,
    plane_gain: 0.1,
    plane_moved: 0.01,
    last_plane_gain: 0.01,
    nearby_gain: 30.0,
    nearby_steps: 4,
    least_corners_counted: 0.8,
    dependent: 1e-15,
    last_gain: 0.02,
    least_retried: 0.1,
    most_hoped: 3.0,
    candidate_steps: 4,
    final_steps: 12,
    loose_steps: 6,
    without_steps: 8,
    few_steps: 3,
    load_steps: 2,
    rounds: 3,
    spread_steps: 25,
    largest_spread_step: 3.0,
    spreads_settled: 0.05,
    cluster_rounds: 25,
    noise_settled: 0.01,
    difference: 1e-5,
};
