//! Whether members of a group are displaced: the Bayes factor of their values under their scale against zero, as the
//! ratio of the posterior's and the prior's densities at zero (Savage and Dickey), `log BF = ½ μᵀ Σ⁻¹ μ + ½ log |Σ|
//! − Σ log s_k`.

use crate::diagnose::effects::Place;
use crate::diagnose::likelihood::factor::log_det;
use crate::diagnose::likelihood::fit::Fit;
use crate::diagnose::principles::LEAST_LOG_ODDS;
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::random_effects::small_errors::single_effect;
use nalgebra::{DMatrix, DVector};

/// The group's columns of one effect at one place, each with the parameter's name.
pub(crate) fn members_of(setup: &Geometry, effect: &str, place: Place) -> Vec<(usize, String)> {
    let columns = setup.group.columns.iter().enumerate();
    columns
        .filter_map(|(k, c)| single_effect(c).filter(|e| (e.0, e.1) == (effect, place)).map(|e| (k, e.2)))
        .collect()
}

/// Whether all mounts by hand are displaced: hands never place a part exactly as modelled.
pub(crate) fn all_displaced(setup: &Geometry, fit: &Fit) -> bool {
    setup.mounts().all(|(effect, place)| {
        let columns: Vec<usize> = members_of(setup, effect, place).iter().map(|m| m.0).collect();
        log_bayes(setup, fit, &columns) > LEAST_LOG_ODDS
    })
}

/// Log Bayes factor of some of the group's values under their spreads against zero.
pub(crate) fn log_bayes(setup: &Geometry, fit: &Fit, columns: &[usize]) -> f64 {
    log_bayes_of(setup, fit, columns, &[])
}

/// The same where the values are less certain than the fit says: `stds` are those of all of the group's values. A deviation above the
/// spread of its kind would be no information, and none is taken for larger than that.
pub(crate) fn log_bayes_of(setup: &Geometry, fit: &Fit, columns: &[usize], stds: &[f64]) -> f64 {
    let first = fit.model.nuisances.len();
    let spread = |k: usize| setup.group.prior_std[k];
    let own = |k: usize| fit.covariance[(first + k, first + k)].max(0.0).sqrt();
    let wider = |k: usize| -> f64 {
        let most = spread(k) / own(k);
        stds.get(k).map_or(1.0, |std| (std / own(k)).min(most).max(1.0))
    };
    // In units of the spreads: the prior is standard normal.
    let covariance = DMatrix::from_fn(columns.len(), columns.len(), |i, j| {
        let (a, b) = (columns[i], columns[j]);
        fit.covariance[(first + a, first + b)] * wider(a) * wider(b) / (spread(a) * spread(b))
    });
    let values = DVector::from_fn(columns.len(), |i, _| fit.model.group[columns[i]] / spread(columns[i]));
    let Some(factor) = covariance.cholesky() else { return 0.0 };
    let log_det = log_det(&factor);
    0.5 * values.dot(&factor.solve(&values)) + 0.5 * log_det
}
