//! Normal equations with all that is always free eliminated: what a search over sets of causes asks again and again has
//! as many unknowns as those causes.

use crate::diagnose::likelihood::factor::{cholesky, log_det};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Normal equations `M = I + S H S`, `b = S g`, in units of the priors' deviations.
pub(crate) type Equations = (DMatrix<f64>, DVector<f64>);
pub(crate) type Factor = Cholesky<f64, Dyn>;

/// The equations of the unknowns c that are left once those a that are always free are eliminated: `M_cc − M_ca M_aa⁻¹
/// M_ac`, `b_c − M_ca M_aa⁻¹ b_a` (Schur's complement).
pub(crate) struct Reduced {
    m: DMatrix<f64>,
    b: DVector<f64>,
    /// Where each unknown of the whole equations is here.
    at: Vec<Option<usize>>,
    /// Log evidence of what was eliminated, `½ b_aᵀ M_aa⁻¹ b_a − ½ ln |M_aa|`.
    of_eliminated: f64,
}

/// Some unknowns, the factor of their equations, and `L⁻¹ b`.
pub(crate) struct Base {
    unknowns: Vec<usize>,
    factor: Factor,
    solved: DVector<f64>,
}

/// What further unknowns add: by how much the log evidence rises, and their values in units of the priors' deviations.
pub(crate) struct Added {
    pub log_evidence: f64,
    pub values: DVector<f64>,
}

impl Reduced {
    /// With some unknowns eliminated; none where numbers overflow.
    pub fn of(equations: &Equations, eliminated: &[usize]) -> Option<Self> {
        let left: Vec<usize> = (0..equations.1.len()).filter(|i| !eliminated.contains(i)).collect();
        Self::onto(equations, &left, eliminated)
    }

    /// Of some unknowns, in their order, with some others eliminated and the rest held at 0; none where numbers overflow.
    pub fn onto((m, b): &Equations, left: &[usize], eliminated: &[usize]) -> Option<Self> {
        let mut at = vec![None; b.len()];
        left.iter().enumerate().for_each(|(k, &i)| at[i] = Some(k));
        let part = |rows: &[usize], columns: &[usize]| {
            DMatrix::from_fn(rows.len(), columns.len(), |i, j| m[(rows[i], columns[j])])
        };
        let of = |rows: &[usize]| DVector::from_fn(rows.len(), |i, _| b[rows[i]]);
        let factor = cholesky(part(eliminated, eliminated))?;
        let across = factor.l_dirty().solve_lower_triangular(&part(eliminated, left))?;
        let solved = factor.l_dirty().solve_lower_triangular(&of(eliminated))?;
        let of_eliminated = 0.5 * solved.norm_squared() - 0.5 * log_det(&factor);
        Some(Self {
            m: part(left, left) - across.tr_mul(&across),
            b: of(left) - across.tr_mul(&solved),
            at,
            of_eliminated,
        })
    }

    /// The equations that are left.
    pub fn equations(&self) -> (&DMatrix<f64>, &DVector<f64>) {
        (&self.m, &self.b)
    }

    /// The equations of some unknowns, by their indices in the whole equations; none where numbers overflow.
    pub fn base(&self, unknowns: impl Iterator<Item = usize>) -> Option<Base> {
        let unknowns: Vec<usize> = unknowns.map(|i| self.at[i]).collect::<Option<_>>()?;
        let among =
            DMatrix::from_fn(unknowns.len(), unknowns.len(), |i, j| self.m[(unknowns[i], unknowns[j])]);
        let factor = cholesky(among)?;
        let right = DVector::from_fn(unknowns.len(), |i, _| self.b[unknowns[i]]);
        let solved = factor.l_dirty().solve_lower_triangular(&right)?;
        Some(Base { unknowns, factor, solved })
    }

    /// Log evidence with some unknowns, up to a constant: `½ bᵀ M⁻¹ b − ½ ln |M|`.
    pub fn log_evidence(&self, base: &Base) -> f64 {
        self.of_eliminated + 0.5 * (base.solved.norm_squared() - log_det(&base.factor))
    }

    /// What further unknowns add to a base; none where numbers overflow.
    pub fn added(&self, base: &Base, own: impl Iterator<Item = usize>) -> Option<Added> {
        let own: Vec<usize> = own.map(|i| self.at[i]).collect::<Option<_>>()?;
        let across =
            DMatrix::from_fn(base.unknowns.len(), own.len(), |i, j| self.m[(base.unknowns[i], own[j])]);
        let across = base.factor.l_dirty().solve_lower_triangular(&across)?;
        let among = DMatrix::from_fn(own.len(), own.len(), |i, j| self.m[(own[i], own[j])]);
        let left = DVector::from_fn(own.len(), |i, _| self.b[own[i]]) - across.tr_mul(&base.solved);
        let factor = cholesky(among - across.tr_mul(&across))?;
        let values = factor.solve(&left);
        Some(Added { log_evidence: 0.5 * (left.dot(&values) - log_det(&factor)), values })
    }
}

#[cfg(test)]
#[allow(clippy::panic)]
mod tests {
    use super::*;

    /// Equations of six unknowns that depend on each other.
    fn equations() -> Equations {
        let half = DMatrix::from_fn(6, 6, |i, j| ((3 * i + 5 * j + i * j) as f64).sin());
        let b = DVector::from_fn(6, |i, _| (i as f64 - 1.7).cos() * 3.0);
        (DMatrix::identity(6, 6) + half.tr_mul(&half), b)
    }

    /// `½ bᵀ M⁻¹ b − ½ ln |M|` of some of the unknowns, by inverse and determinant.
    fn directly((m, b): &Equations, of: &[usize]) -> f64 {
        let m = DMatrix::from_fn(of.len(), of.len(), |i, j| m[(of[i], of[j])]);
        let b = DVector::from_fn(of.len(), |i, _| b[of[i]]);
        let Some(inverse) = m.clone().try_inverse() else { panic!("positive") };
        0.5 * b.dot(&(inverse * &b)) - 0.5 * m.determinant().ln()
    }

    #[test]
    fn evidence_is_that_of_the_whole_equations() {
        let equations = equations();
        let Some(reduced) = Reduced::of(&equations, &[1, 4]) else { panic!("positive") };
        let Some(base) = reduced.base([0, 5].into_iter()) else { panic!("positive") };
        assert!((reduced.log_evidence(&base) - directly(&equations, &[0, 1, 4, 5])).abs() < 1e-9);
        let Some(added) = reduced.added(&base, [2, 3].into_iter()) else { panic!("positive") };
        let gain = directly(&equations, &[0, 1, 2, 3, 4, 5]) - directly(&equations, &[0, 1, 4, 5]);
        assert!((added.log_evidence - gain).abs() < 1e-9);
        let Some(best) = equations.0.clone().lu().solve(&equations.1) else { panic!("regular") };
        assert!((added.values[0] - best[2]).abs() < 1e-9 && (added.values[1] - best[3]).abs() < 1e-9);
    }

    #[test]
    fn onto_some_unknowns_the_rest_is_held_at_zero() {
        let (m, b) = equations();
        let Some(onto) = Reduced::onto(&(m.clone(), b.clone()), &[3, 1], &[0, 5]) else { panic!("positive") };
        let (left, right) = onto.equations();
        let Some(values) = left.clone().lu().solve(right) else { panic!("regular") };
        let of = [0, 1, 3, 5];
        let among = DMatrix::from_fn(4, 4, |i, j| m[(of[i], of[j])]);
        let Some(whole) = among.lu().solve(&DVector::from_fn(4, |i, _| b[of[i]])) else { panic!("regular") };
        assert!((values[0] - whole[2]).abs() < 1e-9 && (values[1] - whole[1]).abs() < 1e-9);
        assert!(onto.base([4].into_iter()).is_none());
    }

    #[test]
    fn what_is_eliminated_cannot_be_asked_for() {
        let Some(reduced) = Reduced::of(&equations(), &[1, 4]) else { panic!("positive") };
        assert!(reduced.base([1].into_iter()).is_none());
    }
}
