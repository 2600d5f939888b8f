//! By how much the values of causes, mounts and small errors differ between resamples of the postures.
//!
//! A fit's covariance is right where the model is. Where something is left that no cause explains, or where another set of causes is
//! selected from other postures, estimates scatter by more: their standard deviation over the resamples of [`super::stability`], with
//! the search repeated in each, is then the larger of the two. What is the same in all postures it does not see.
//!
//! Source: bagged and block bootstraps, Efron (1979), Künsch (1989).

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::assessment::stability::{RESAMPLES, resamples};
use crate::diagnose::assessment::uncertainty::Deviations;
use crate::diagnose::likelihood::score_test::Score;
use crate::diagnose::selection::standing::Standing;
use crate::error::Result;

/// Raises the deviations of what was found to those over the resamples, where these are larger.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn at_least_over_resamples(
    deviations: &mut Deviations,
    findings: &mut Findings<'_>,
    standings: &[Option<Standing>],
    ranking: &[Score],
) -> Result<()> {
    let model = &findings.found.fit.model;
    if model.terms.is_empty() && model.group.is_empty() {
        return Ok(());
    }
    let hypotheses: Vec<usize> = model.terms.iter().map(|t| t.hypothesis).collect();
    let resampled = resamples(findings, standings, ranking)?;
    let whole = &resampled.whole;
    let values: Vec<(&[usize], Vec<f64>)> = resampled
        .sets
        .iter()
        .filter_map(|weighed| Some((&weighed.set[..], whole.values_at_own_scales(weighed)?)))
        .collect();
    for (k, std) in deviations.group.iter_mut().enumerate() {
        let over = values.iter().map(|(_, values)| values[whole.first_group + k]);
        *std = std.max(deviation(over).unwrap_or(0.0));
    }
    for (stds, hypothesis) in deviations.stds.iter_mut().zip(hypotheses) {
        let Some(own) = whole.candidates.iter().position(|c| c.hypothesis == hypothesis) else { continue };
        for (std, column) in stds.iter_mut().zip(whole.candidates[own].columns.clone()) {
            let with_it = values.iter().filter(|(set, _)| set.contains(&own));
            *std = std.max(deviation(with_it.map(|(_, values)| values[column])).unwrap_or(0.0));
        }
    }
    findings.resampled = Some(resampled);
    Ok(())
}

/// The standard deviation of values over the resamples; none of fewer than half of these.
fn deviation(values: impl Iterator<Item = f64>) -> Option<f64> {
    let values: Vec<f64> = values.collect();
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (count - 1.0);
    (2 * values.len() >= RESAMPLES).then_some(variance.sqrt())
}
