//! One fit of a few parameters to a view's corners: shared by the planar pose and the maximum-likelihood plane.

use super::board::SeenCorner;
use super::loss::Loss;
use super::options::EstimatorOptions;
use crate::error::{Error, Result};
use crate::least_squares::{Damping, LeastSquares, Normal, inverse_information, minimise};
use nalgebra::{Const, DimMin, SMatrix, SVector, Vector2};

/// Median of the length of a two-dimensional standard normal vector, `√(2 ln 2)`.
const RAYLEIGH_MEDIAN: f64 = 1.177_410_022_515_474_7;
/// A residual scale below this (px) is rounding, not noise.
const SMALLEST_NOISE_PX: f64 = 1e-9;
/// Rounds of "scale from the median, then refit" where a robust loss has no noise given.
const SCALE_ROUNDS: usize = 3;

/// A predicted pixel and its Jacobian with respect to the P parameters.
pub(crate) struct Predicted<const P: usize> {
    pub pixel: Vector2<f64>,
    pub jacobian: SMatrix<f64, 2, P>,
}

/// The fitted state with the statistics of its residual.
pub(crate) struct CornerFit<const P: usize, S> {
    pub state: S,
    pub covariance: SMatrix<f64, P, P>,
    /// Root mean square of the residual's length over the corners (both axes together), px.
    pub rms_px: f64,
    /// Standard deviation of one axis that the covariance used, px.
    pub noise_px: f64,
}

/// What is fitted: a state, its prediction of a corner, and how a tangent moves it.
pub(crate) trait CornerModel<const P: usize> {
    type State: Clone;
    const WHAT: &'static str;
    fn predict(&self, state: &Self::State, corner: &SeenCorner) -> Result<Predicted<P>>;
    fn moved(&self, state: &Self::State, step: &SVector<f64, P>) -> Result<Self::State>;
}

fn accumulate<const P: usize, M: CornerModel<P>>(
    model: &M,
    corners: &[SeenCorner],
    state: &M::State,
    loss: Loss,
    noise_px: f64,
) -> Result<Normal<P>> {
    let mut normal = Normal::zero();
    for corner in corners {
        let predicted = model.predict(state, corner)?;
        let residual = predicted.pixel - corner.pixel;
        let weighed = loss.weigh(residual.norm_squared(), noise_px);
        normal.cost += weighed.cost;
        let (a, b) = (predicted.jacobian.row(0), predicted.jacobian.row(1));
        let (ra, rb) = (residual.x * weighed.weight, residual.y * weighed.weight);
        for i in 0..P {
            normal.gradient[i] += a[i] * ra + b[i] * rb;
            let (wa, wb) = (weighed.weight * a[i], weighed.weight * b[i]);
            for j in i..P {
                normal.information[(i, j)] += wa * a[j] + wb * b[j];
            }
        }
    }
    for i in 0..P {
        for j in 0..i {
            normal.information[(i, j)] = normal.information[(j, i)];
        }
    }
    Ok(normal)
}

fn median_noise<const P: usize, M: CornerModel<P>>(
    model: &M,
    corners: &[SeenCorner],
    state: &M::State,
) -> Result<f64> {
    let mut lengths = Vec::with_capacity(corners.len());
    for corner in corners {
        lengths.push((model.predict(state, corner)?.pixel - corner.pixel).norm());
    }
    lengths.sort_by(f64::total_cmp);
    // Parameters soak up part of the noise: the usual correction for degrees of freedom.
    let seen = 2.0 * corners.len() as f64;
    let left = (seen - P as f64).max(1.0);
    Ok((lengths[lengths.len() / 2] / RAYLEIGH_MEDIAN * (seen / left).sqrt()).max(SMALLEST_NOISE_PX))
}

/// A model, its corners, and how their residuals count.
struct Fit<'a, const P: usize, M> {
    model: &'a M,
    corners: &'a [SeenCorner],
    loss: Loss,
    noise_px: f64,
}

impl<const P: usize, M: CornerModel<P>> LeastSquares for Fit<'_, P, M>
where
    Const<P>: DimMin<Const<P>, Output = Const<P>>,
{
    type State = M::State;
    type Equations = Normal<P>;
    type Step = SVector<f64, P>;
    const WHAT: &'static str = M::WHAT;
    const DAMPING: Damping = Damping { least: 0.0, first: 1e-3, rise: 10.0, fall: 10.0 };
    const LAST_STEP_UNSEEN: bool = true;

    fn evaluate(&self, state: &M::State, equations: &mut Normal<P>) -> Result<f64> {
        *equations = accumulate(self.model, self.corners, state, self.loss, self.noise_px)?;
        Ok(equations.cost)
    }

    fn step(
        &self,
        _: &M::State,
        equations: &Normal<P>,
        damping: f64,
    ) -> Result<Option<(SVector<f64, P>, f64)>> {
        // Corners that leave a parameter open are no case for damping.
        equations.step(damping).map(Some).ok_or(Error::Undetermined { what: M::WHAT })
    }

    fn moved(&self, state: &M::State, step: &SVector<f64, P>) -> Result<M::State> {
        self.model.moved(state, step)
    }
}

/// Fits: the state and the noise of one axis, px (given, or estimated from the residual).
pub(crate) fn fit_state<const P: usize, M: CornerModel<P>>(
    model: &M,
    corners: &[SeenCorner],
    start: M::State,
    options: &EstimatorOptions,
) -> Result<(M::State, f64)>
where
    Const<P>: DimMin<Const<P>, Output = Const<P>>,
{
    let run = |start: M::State, loss: Loss, noise_px: f64| {
        let places = [Normal::zero(), Normal::zero()];
        minimise(&Fit { model, corners, loss, noise_px }, start, places, options.stop())
    };
    match (options.loss, options.noise_px) {
        (Loss::Squared, _) => {
            let minimum = run(start, Loss::Squared, 1.0)?;
            let left = (2.0 * corners.len() as f64 - P as f64).max(1.0);
            let noise = options.noise_px.unwrap_or((minimum.cost / left).sqrt());
            Ok((minimum.state, noise.max(SMALLEST_NOISE_PX)))
        }
        (loss, Some(noise_px)) => Ok((run(start, loss, noise_px)?.state, noise_px)),
        (loss, None) => {
            let mut state = start;
            let mut noise_px = median_noise(model, corners, &state)?;
            for _ in 0..SCALE_ROUNDS {
                state = run(state, loss, noise_px)?.state;
                noise_px = median_noise(model, corners, &state)?;
            }
            Ok((state, noise_px))
        }
    }
}

/// What the noise of one axis contributes to the covariance `variance (Σ JᵀJ)⁻¹` of a fitted state, px²: `σ²`, for a
/// robust loss `σ² E[ψ²]/E[ψ′]²` (Huber 1981).
pub(crate) fn effective_variance<const P: usize, M: CornerModel<P>>(
    model: &M,
    corners: &[SeenCorner],
    state: &M::State,
    options: &EstimatorOptions,
    noise_px: f64,
) -> Result<f64> {
    if options.loss == Loss::Squared {
        return Ok(noise_px * noise_px);
    }
    let (mut squares, mut slopes) = (0.0, 0.0);
    for corner in corners {
        let squared = (model.predict(state, corner)?.pixel - corner.pixel).norm_squared();
        let weighed = options.loss.weigh(squared, noise_px);
        squares += 0.5 * weighed.weight * weighed.weight * squared;
        slopes += weighed.slope;
    }
    let count = corners.len() as f64;
    let left = (count - 0.5 * P as f64).max(0.5);
    Ok((squares / left) / (slopes / count).powi(2))
}

/// The statistics of a fitted state.
pub(crate) fn finished<const P: usize, M: CornerModel<P>>(
    model: &M,
    corners: &[SeenCorner],
    state: M::State,
    options: &EstimatorOptions,
    noise_px: f64,
) -> Result<CornerFit<P, M::State>>
where
    Const<P>: DimMin<Const<P>, Output = Const<P>>,
{
    let normal = accumulate(model, corners, &state, Loss::Squared, noise_px)?;
    let rms_px = (normal.cost / corners.len() as f64).sqrt();
    let variance = effective_variance(model, corners, &state, options, noise_px)?;
    let covariance = inverse_information(M::WHAT, &normal.information)? * variance;
    Ok(CornerFit { state, covariance, rms_px, noise_px })
}
