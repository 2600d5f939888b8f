//! Lengths that are all off by one factor: the scale of the measured points would do the same.
//!
//! A tracker whose scale is off by f sees a robot all of whose lengths `l` are longer by `f l`. The vocabulary has no word for it, and
//! it is told as several links. With their errors `v ± s` the factor is `f = Σ l·v/s² / Σ l·l/s²`, and it is told where it is far from
//! none, and no `v − f l` is. Lengths along one axis, of which the postures show only the sum, are not told.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::effects::Place;
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::elementary::Atom;
use crate::diagnose::model::scene::Scene;
use crate::diagnose::principles::FAR_DEVIATIONS;
use nalgebra::Vector3;

/// One number of a link's length: its nominal value, by what it is off, and the standard deviation of that, m.
struct Length {
    link: Option<NodeId>,
    nominal_m: f64,
    off_m: f64,
    std_m: f64,
}

/// The factor by which all lengths of several links are off, with its standard deviation; none where they are not in proportion, or
/// pictures show the robot.
fn factor(lengths: &[Length]) -> Option<(f64, f64)> {
    let sum = |of: &dyn Fn(&Length) -> f64| lengths.iter().map(|l| of(l) / l.std_m.powi(2)).sum::<f64>();
    let information = sum(&|l| l.nominal_m.powi(2));
    let by = sum(&|l| l.nominal_m * l.off_m) / information;
    let in_proportion = |l: &Length| (l.off_m - by * l.nominal_m).abs() <= FAR_DEVIATIONS * l.std_m;
    let std = information.sqrt().recip();
    let is_long = |l: &&Length| (l.nominal_m * by).abs() > FAR_DEVIATIONS * l.std_m;
    let mut links: Vec<Option<NodeId>> = lengths.iter().filter(is_long).map(|l| l.link).collect();
    links.dedup();
    // Written so that NaN is none.
    let sure = links.len() > 1 && by.abs() > FAR_DEVIATIONS * std;
    (sure && lengths.iter().all(in_proportion)).then_some((by, std))
}

/// The warning that lengths are off by one factor.
pub(crate) fn one_scale(findings: &Findings<'_>) -> Option<String> {
    let (search, fit) = (&findings.search, &findings.found.fit);
    let scene = &search.problem.scene;
    if search.problem.camera.is_some() {
        return None;
    }
    let mut lengths = Vec::new();
    let mut add = |link: Option<NodeId>, k: usize, off_m: f64, std_m: f64| {
        if let Some(nominal) = nominal_length(scene, link).filter(|_| std_m > 0.0) {
            lengths.push(Length { link, nominal_m: nominal[k], off_m, std_m });
        }
    };
    let first = fit.model.nuisances.len();
    for (k, (column, value)) in search.group.columns.iter().zip(&fit.model.group).enumerate() {
        if let Atom::LinkShift(link, axis) = column.atom {
            add(link, axis, *value, fit.covariance[(first + k, first + k)].max(0.0).sqrt());
        }
    }
    for (i, term) in fit.model.terms.iter().enumerate() {
        let place = search.catalogue.hypotheses[term.hypothesis].place;
        if let (Place::Link(link), "link_length") = (place, search.catalogue.effect(term.hypothesis).name()) {
            let of_term = term.parameters.iter().zip(fit.stds(i)).enumerate();
            of_term.for_each(|(axis, (value, std))| add(link, axis, *value, std));
        }
    }
    let (by, std) = factor(&lengths)?;
    Some(format!(
        "the links' lengths are all off by one factor, {:+.3} ± {:.3} %: a wrong scale of the measured points would do the same; measure a distance that is known \
         before lengths are changed",
        by * 100.0,
        std * 100.0
    ))
}

/// From a link's joint to the next one, in the link's frame, m; none of a link that carries several joints or none.
fn nominal_length(scene: &Scene, link: Option<NodeId>) -> Option<Vector3<f64>> {
    let mut carried = scene.body.nodes.iter().filter(|node| node.parent == link);
    let next = carried.next()?;
    let along = |k: usize| scene.body.length_axis(link, k).dot(&next.parent_from_joint.t);
    carried.next().is_none().then(|| Vector3::from_fn(|k, _| along(k)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lengths(off: impl Fn(f64) -> f64) -> Vec<Length> {
        let nominal = [0.61, -0.02, 0.12, 0.57, 0.01, 0.16];
        let of = |(i, nominal_m): (usize, &f64)| Length {
            link: Some(i / 3),
            nominal_m: *nominal_m,
            off_m: off(*nominal_m) + 1e-5 * (7.0 * i as f64).sin(),
            std_m: 1e-5,
        };
        nominal.iter().enumerate().map(of).collect()
    }

    #[test]
    fn lengths_in_proportion_have_a_factor_and_others_none() {
        let found = factor(&lengths(|l| 0.003 * l));
        assert!(found.is_some_and(|(by, std)| (by - 0.003).abs() < 4.0 * std && std < 1e-4));
        assert!(factor(&lengths(|l| 2e-3 * (40.0 * l).sin())).is_none());
        assert!(factor(&lengths(|_| 0.0)).is_none());
        let one = lengths(|l| if l == 0.61 { 0.002 } else { 0.0 });
        assert!(factor(&one).is_none(), "one link alone is a link");
        let two = lengths(|l| if l > 0.5 { 0.05 } else { 0.0 });
        assert!(factor(&two).is_none(), "two links of another version are longer by the same");
    }
}
