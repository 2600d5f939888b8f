//! The loop of all non-linear least squares: Gauss–Newton, damped after Levenberg (1944) and Marquardt (1963) where
//! a full step fails.
//!
//! A problem defines its equations and how they are solved ([`LeastSquares`]); [`minimise`] decides when a step is
//! taken, when it is damped, and when the iteration ends. Problems with few unknowns have [`Normal`] equations,
//! without allocation; the joint estimate eliminates planes and markers from its own.

use crate::error::{Error, Result};
use nalgebra::{Const, DimMin, SMatrix, SVector};

/// Beyond this damping a step is so short that the cost cannot be lowered in floating point.
const LARGEST_DAMPING: f64 = 1e12;
/// A determinant this many times smaller than the product of the diagonal means no information in some direction.
const SINGULAR_RATIO: f64 = 1e-24;

/// How the damping, a share of the information matrix's diagonal, rises and falls. A full Gauss–Newton step has the least.
pub(crate) struct Damping {
    /// What every step has: 0, but where unknowns move together in a way that nothing shows.
    pub least: f64,
    /// After the first step that fails.
    pub first: f64,
    /// Factor after each further step that fails.
    pub rise: f64,
    /// Divisor after a good step.
    pub fall: f64,
}

/// When to stop.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stop {
    pub steps: usize,
    /// On the predicted decrease of the cost, in its units,
    pub decrease: f64,
    /// or as a share of the cost.
    pub share: f64,
}

/// A sum of squares to be minimised.
pub(crate) trait LeastSquares {
    type State;
    /// The linear equations at a state.
    type Equations;
    type Step;
    const WHAT: &'static str;
    const DAMPING: Damping;
    /// The last step, whose predicted gain is negligible, is taken without evaluating its equations again; the
    /// equations are then those of the state before it.
    const LAST_STEP_UNSEEN: bool;

    /// Writes the equations at a state and returns its cost; refuses states outside its domain, which counts as a failed step.
    fn evaluate(&self, state: &Self::State, equations: &mut Self::Equations) -> Result<f64>;
    /// The damped step and the decrease of the cost that it promises; None where more damping may help.
    fn step(
        &self,
        state: &Self::State,
        equations: &Self::Equations,
        damping: f64,
    ) -> Result<Option<(Self::Step, f64)>>;
    fn moved(&self, state: &Self::State, step: &Self::Step) -> Result<Self::State>;
    /// A second attempt for a state that is no better than `cost`: an improved state, with its equations and its
    /// cost.
    fn mended(
        &self,
        next: Self::State,
        lower: f64,
        _cost: f64,
        _equations: &mut Self::Equations,
    ) -> Result<(Self::State, f64)> {
        Ok((next, lower))
    }
}

pub(crate) struct Minimum<S, E> {
    pub state: S,
    pub equations: E,
    pub cost: f64,
    /// Steps taken.
    pub steps: usize,
    /// The predicted decrease of the cost that is left where the steps ran out.
    pub left: Option<f64>,
}

/// Minimises from a start; `equations` is two places for them.
///
/// # Errors
/// [`Error::Undetermined`] and [`Error::NotConverged`]; those of the start's evaluation, and of [`LeastSquares::step`].
pub(crate) fn minimise<L: LeastSquares>(
    problem: &L,
    start: L::State,
    equations: [L::Equations; 2],
    stop: Stop,
) -> Result<Minimum<L::State, L::Equations>> {
    let found = descend(problem, start, equations, stop)?;
    match found.left {
        None => Ok(found),
        Some(last_step) => {
            let (steps, needed) = (stop.steps, stop.decrease.max(stop.share * found.cost));
            Err(Error::NotConverged { what: L::WHAT, steps, last_step, needed })
        }
    }
}

/// As [`minimise`], but takes what the steps reached: a start for later, or a value that needs no last digits.
///
/// # Errors
/// [`Error::Undetermined`]; those of the start's evaluation, and of [`LeastSquares::step`].
pub(crate) fn descend<L: LeastSquares>(
    problem: &L,
    start: L::State,
    equations: [L::Equations; 2],
    stop: Stop,
) -> Result<Minimum<L::State, L::Equations>> {
    let undetermined = || Error::Undetermined { what: L::WHAT };
    let mut state = start;
    let [mut equations, mut trial] = equations;
    let mut cost = problem.evaluate(&state, &mut equations)?;
    let mut damping = L::DAMPING.least;
    let mut decrease = f64::INFINITY;
    let raised = |damping: f64| (damping * L::DAMPING.rise).max(L::DAMPING.first);
    for taken in 1..=stop.steps {
        let Some((step, promised)) = problem.step(&state, &equations, damping)? else {
            if damping > LARGEST_DAMPING {
                return Err(undetermined());
            }
            damping = raised(damping);
            continue;
        };
        decrease = promised;
        if !decrease.is_finite() {
            return Err(undetermined());
        }
        let last = decrease <= stop.decrease.max(stop.share * cost);
        let candidate = problem.moved(&state, &step);
        if L::LAST_STEP_UNSEEN && damping == L::DAMPING.least && last {
            return Ok(Minimum {
                state: candidate?,
                equations,
                cost: (cost - decrease).max(0.0),
                steps: taken,
                left: None,
            });
        }
        let better = candidate.and_then(|next| {
            let lower = problem.evaluate(&next, &mut trial)?;
            if lower <= cost { Ok((next, lower)) } else { problem.mended(next, lower, cost, &mut trial) }
        });
        match better {
            Ok((next, lower)) if lower <= cost => {
                (state, cost) = (next, lower);
                std::mem::swap(&mut equations, &mut trial);
                if damping == L::DAMPING.least && last {
                    return Ok(Minimum { state, equations, cost, steps: taken, left: None });
                }
                damping =
                    if damping > L::DAMPING.first { damping / L::DAMPING.fall } else { L::DAMPING.least };
            }
            // Nothing can be gained but rounding: this is the minimum.
            _ if last || damping > LARGEST_DAMPING => {
                return Ok(Minimum { state, equations, cost, steps: taken, left: None });
            }
            _ => damping = raised(damping),
        }
    }
    Ok(Minimum { state, equations, cost, steps: stop.steps, left: Some(decrease) })
}

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

    /// The damped step and the decrease of the cost that it promises.
    pub fn step(&self, damping: f64) -> Option<(SVector<f64, P>, f64)>
    where
        Const<P>: DimMin<Const<P>, Output = Const<P>>,
    {
        let mut damped = self.information;
        for i in 0..P {
            damped[(i, i)] *= 1.0 + damping;
        }
        let step = -damped.cholesky()?.solve(&self.gradient);
        Some((step, -step.dot(&self.gradient)))
    }
}

/// The inverse of an information matrix.
///
/// # Errors
/// [`Error::Undetermined`] where it is singular to working precision.
pub(crate) fn inverse_information<const P: usize>(
    what: &'static str,
    information: &SMatrix<f64, P, P>,
) -> Result<SMatrix<f64, P, P>> {
    let (inverse, determinant) = scaled_inverse(information).ok_or(Error::Undetermined { what })?;
    if determinant < SINGULAR_RATIO {
        return Err(Error::Undetermined { what });
    }
    Ok(inverse)
}

/// The inverse of an information matrix, scaled to a unit diagonal first (radians and metres have different
/// magnitudes), and the determinant of the scaled one; None where it is not positive definite.
pub(crate) fn scaled_inverse<const P: usize>(
    information: &SMatrix<f64, P, P>,
) -> Option<(SMatrix<f64, P, P>, f64)> {
    let scale = SVector::<f64, P>::from_fn(|i, _| information[(i, i)].sqrt());
    if !scale.iter().all(|s| *s > 0.0 && s.is_finite()) {
        return None;
    }
    let scaled = SMatrix::<f64, P, P>::from_fn(|i, j| information[(i, j)] / (scale[i] * scale[j]));
    let factor = scaled.cholesky()?;
    let determinant = (0..P).map(|i| factor.l_dirty()[(i, i)].powi(2)).product();
    let inverse = factor.inverse();
    Some((SMatrix::from_fn(|i, j| inverse[(i, j)] / (scale[i] * scale[j])), determinant))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Vector2};

    /// Rosenbrock's valley, `(1 − x)² + 100 (y − x²)²`: full steps along its curved floor go astray.
    struct Valley {
        /// 0 leaves y open.
        weight: f64,
    }

    impl LeastSquares for Valley {
        type State = Vector2<f64>;
        type Equations = Normal<2>;
        type Step = Vector2<f64>;
        const WHAT: &'static str = "valley";
        const DAMPING: Damping = Damping { least: 0.0, first: 1e-3, rise: 10.0, fall: 10.0 };
        const LAST_STEP_UNSEEN: bool = false;

        fn evaluate(&self, at: &Vector2<f64>, normal: &mut Normal<2>) -> Result<f64> {
            let residual = Vector2::new(1.0 - at.x, self.weight * (at.y - at.x * at.x));
            let jacobian = Matrix2::new(-1.0, 0.0, -2.0 * self.weight * at.x, self.weight);
            normal.gradient = jacobian.transpose() * residual;
            normal.information = jacobian.transpose() * jacobian;
            Ok(residual.norm_squared())
        }

        fn step(
            &self,
            _: &Vector2<f64>,
            normal: &Normal<2>,
            damping: f64,
        ) -> Result<Option<(Vector2<f64>, f64)>> {
            Ok(normal.step(damping))
        }

        fn moved(&self, at: &Vector2<f64>, step: &Vector2<f64>) -> Result<Vector2<f64>> {
            Ok(at + step)
        }
    }

    const START: [f64; 2] = [-1.2, 1.0];

    fn found(weight: f64, steps: usize) -> Result<Minimum<Vector2<f64>, Normal<2>>> {
        let places = [Normal::zero(), Normal::zero()];
        minimise(&Valley { weight }, START.into(), places, Stop { steps, decrease: 1e-20, share: 0.0 })
    }

    #[test]
    fn a_curved_valley_is_followed_to_its_end() {
        let found = found(10.0, 60).unwrap();
        assert!((found.state - Vector2::new(1.0, 1.0)).norm() < 1e-9, "{}", found.state);
        assert!(found.cost < 1e-18 && found.equations.gradient.norm() < 1e-8);
        // Full steps alone would jump across it in three.
        assert!((20..60).contains(&found.steps), "{}", found.steps);
    }

    #[test]
    fn too_few_steps_and_an_open_direction_are_said() {
        assert!(matches!(found(10.0, 3), Err(Error::NotConverged { what: "valley", steps: 3, .. })));
        assert!(matches!(found(0.0, 60), Err(Error::Undetermined { what: "valley" })));
    }

    #[test]
    fn what_few_steps_reach_is_better_than_the_start_and_a_share_ends_it_sooner() {
        let run = |steps, share| {
            let (valley, places) = (Valley { weight: 10.0 }, [Normal::zero(), Normal::zero()]);
            descend(&valley, START.into(), places, Stop { steps, decrease: 0.0, share }).unwrap()
        };
        let few = run(3, 0.0);
        assert!(few.left.is_some_and(|left| left > 0.0) && few.cost < 24.2, "{}", few.cost);
        // A step that promises less than all of the cost is the last one.
        let (to_the_end, sooner) = (run(60, 1e-9), run(60, 0.999_999));
        assert!(to_the_end.left.is_none() && to_the_end.cost < 1e-18);
        assert!(sooner.left.is_none() && sooner.steps < to_the_end.steps);
    }

    #[test]
    fn an_inverse_is_taken_of_radians_beside_metres() {
        let information = Matrix2::new(1e14, 3.0, 3.0, 1e-12);
        let inverse = inverse_information("pair", &information).unwrap();
        let exact = Matrix2::new(1e-12, -3.0, -3.0, 1e14) / 91.0;
        assert!(inverse.iter().zip(&exact).all(|(a, b)| (a / b - 1.0).abs() < 1e-9), "{inverse}");
        let singular = Matrix2::new(1.0, 1.0, 1.0, 1.0 + 1e-16);
        assert!(inverse_information("pair", &singular).is_err());
    }
}
