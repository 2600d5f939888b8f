//! Gauss–Newton with Levenberg's damping, of a fixed small number of unknowns, without allocation.

use crate::error::{Error, Result};
use nalgebra::{Const, DimMin, SMatrix, SVector};

/// Damping starts here when a full Gauss–Newton step fails, as a share of the information matrix's diagonal.
const FIRST_DAMPING: f64 = 1e-3;
/// Factor of the damping after a failed step; its inverse after a good one.
const DAMPING_FACTOR: f64 = 10.0;
/// Beyond this damping a step is so short that the cost cannot be lowered in floating point.
const LARGEST_DAMPING: f64 = 1e12;
/// A determinant this many times smaller than the product of the diagonal means no information in some direction.
const SINGULAR_RATIO: f64 = 1e-24;

/// The cost `Σ ρ(e)` with its gradient `Σ Jᵀ ψ(e)` and Gauss–Newton matrix `Σ w Jᵀ J`.
#[derive(Clone)]
pub(crate) struct Normal<const P: usize> {
    pub cost: f64,
    pub gradient: SVector<f64, P>,
    pub information: SMatrix<f64, P, P>,
}

impl<const P: usize> Normal<P> {
    pub fn zero() -> Self {
        Self { cost: 0.0, gradient: SVector::zeros(), information: SMatrix::zeros() }
    }
}

/// When to stop.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stop {
    pub steps: usize,
    /// On the predicted decrease of the cost, in its units.
    pub decrease: f64,
}

pub(crate) struct Minimum<S> {
    pub state: S,
    pub cost: f64,
}

/// Minimises a cost from a start; `evaluate` refuses states outside its domain, which counts as a failed step.
pub(crate) fn minimise<const P: usize, S: Clone>(
    what: &'static str,
    start: S,
    stop: Stop,
    evaluate: impl Fn(&S) -> Result<Normal<P>>,
    moved: impl Fn(&S, &SVector<f64, P>) -> Result<S>,
) -> Result<Minimum<S>>
where
    Const<P>: DimMin<Const<P>, Output = Const<P>>,
{
    let mut state = start;
    let mut normal = evaluate(&state)?;
    let mut damping = 0.0;
    let mut decrease = f64::INFINITY;
    for _ in 0..stop.steps {
        let mut damped = normal.information;
        for i in 0..P {
            damped[(i, i)] *= 1.0 + damping;
        }
        let step = -damped.cholesky().ok_or(Error::Undetermined { what })?.solve(&normal.gradient);
        decrease = -step.dot(&normal.gradient);
        if !decrease.is_finite() {
            return Err(Error::Undetermined { what });
        }
        let candidate = moved(&state, &step);
        if damping == 0.0 && decrease <= stop.decrease {
            // The last step is taken unseen: Gauss–Newton only comes nearer here.
            return Ok(Minimum { state: candidate?, cost: (normal.cost - decrease).max(0.0) });
        }
        match candidate.and_then(|c| evaluate(&c).map(|n| (c, n))) {
            Ok((c, n)) if n.cost <= normal.cost => {
                state = c;
                normal = n;
                damping = if damping > FIRST_DAMPING { damping / DAMPING_FACTOR } else { 0.0 };
            }
            _ if decrease <= stop.decrease || damping > LARGEST_DAMPING => {
                return Ok(Minimum { state, cost: normal.cost });
            }
            _ => damping = (damping * DAMPING_FACTOR).max(FIRST_DAMPING),
        }
    }
    Err(Error::NotConverged { what, steps: stop.steps, last_step: decrease, needed: stop.decrease })
}

/// The inverse of an information matrix.
///
/// # Errors
/// [`Error::Undetermined`] where it is singular to working precision.
pub(crate) fn inverse_information<const P: usize>(
    what: &'static str,
    information: &SMatrix<f64, P, P>,
) -> Result<SMatrix<f64, P, P>> {
    // Scaled to a unit diagonal first: radians and metres differ in size, not in worth.
    let scale = SVector::<f64, P>::from_fn(|i, _| information[(i, i)].sqrt());
    if !scale.iter().all(|s| *s > 0.0 && s.is_finite()) {
        return Err(Error::Undetermined { what });
    }
    let scaled = SMatrix::<f64, P, P>::from_fn(|i, j| information[(i, j)] / (scale[i] * scale[j]));
    let factor = scaled.cholesky().ok_or(Error::Undetermined { what })?;
    let determinant: f64 = (0..P).map(|i| factor.l_dirty()[(i, i)].powi(2)).product();
    if determinant < SINGULAR_RATIO {
        return Err(Error::Undetermined { what });
    }
    let inverse = factor.inverse();
    Ok(SMatrix::from_fn(|i, j| inverse[(i, j)] / (scale[i] * scale[j])))
}
