//! Observations of one marker that were left out as false, but share a law: all of them lie where one joint is beyond a
//! position, or in one run of rows.
//!
//! A digit, a label or a false detection falls on any posture. Where k of n postures are off by chance, all of them are
//! among the m that are highest (or lowest) in one joint with the probability `C(m, k) / C(n, k)`, and within m
//! neighbours in their order with `Σ_l (n − l + 1) C(l − 2, k − 2) / C(n, k)`, l from k to m: hypergeometric, times the number of
//! joints, of their two ends, and of markers that could have shown it (Bonferroni). What is too improbable by chance
//! is an error of the robot that few postures show: a cable that pulls, a slack that is taken up, a collision.

use crate::diagnose::data::depends_on::DependsOn;
use crate::diagnose::data::diagnosis::Data;
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::principles::{FEWEST_POSTURES, Grid, LEAST_LOG_ODDS, LOG_PRIOR_FREE, MAJORITY};
use std::collections::BTreeMap;

/// The postures of a marker that were left out, and what they have in common.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct LeftOutTogether {
    pub marker: String,
    /// What all of them have in common.
    pub depends_on: DependsOn,
    /// In words.
    pub told: String,
}

/// What is common to the postures that are off.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Common {
    /// The joint is at least at this position (`side` 1), or at most (−1).
    Beyond { node: NodeId, position: f64, side: f64 },
    /// From one posture to another, in the order of the rows.
    Between(usize, usize),
}

/// The likeliest such law of one marker's left-out observations; none where chance explains all of them.
pub(crate) fn left_out_together(data: &Data, problem: &Problem) -> Option<LeftOutTogether> {
    let given = given_postures(data, problem);
    let scene = &problem.scene;
    let joints: Vec<NodeId> = (0..scene.nodes())
        .filter(|&n| scene.relevant[n] && scene.moves(n) && scene.body.nodes[n].follows.is_none())
        .collect();
    let tests = (given.len() * SHARES.len()) as f64;
    let laws = given.iter().flat_map(|(marker, postures)| {
        let columns: Vec<(NodeId, Vec<f64>)> =
            joints.iter().map(|&n| (n, postures.iter().map(|p| scene.q(p.row, n)).collect())).collect();
        SHARES.iter().filter_map(move |share| {
            let is_off: Vec<bool> = postures.iter().map(|p| p.off as f64 > share * p.seen as f64).collect();
            let (log_p, common) = likeliest(&is_off, &columns, scene.ordered)?;
            Some((log_p + tests.ln(), *marker, is_off, common))
        })
    });
    let (log_p, marker, is_off, common) = laws.min_by(|a, b| a.0.total_cmp(&b.0))?;
    (-log_p + LOG_PRIOR_FREE > LEAST_LOG_ODDS).then(|| {
        let (depends_on, place) = match common {
            Common::Beyond { node, position, side } => {
                let node = &scene.body.nodes[node];
                let (joint, unit) = (&node.joint, if node.prismatic { "m" } else { "rad" });
                let beyond = if side > 0.0 { "at least" } else { "at most" };
                (DependsOn::PositionOf(joint.clone()), format!("where joint:{joint} is {beyond} {position:.3} {unit}"))
            }
            Common::Between(first, last) => {
                let number = |k: usize| problem.frame_numbers[given[marker][k].row];
                (DependsOn::Time, format!("from frame {} to {}", number(first), number(last)))
            }
        };
        let told = format!(
            "in {} of {} postures marker:{marker} is elsewhere than the model says, and was left out; all of these lie {place}, which is no chance: something acts there (a \
             cable, a contact, a slack, a part that came loose)",
            is_off.iter().filter(|off| **off).count(),
            is_off.len()
        );
        LeftOutTogether { marker: marker.to_owned(), depends_on, told }
    })
}

/// A posture counts as off where more than this share of what was seen of the marker was left out: any, or more than a third. A small
/// displacement is left out in some views only; a false detection may fall on any one view.
const SHARES: [Grid; 2] = [0.0, 1.0 / 3.0];

/// A posture in which a marker was given: its first row, how many observations there are of it, and how many were left out.
#[derive(Clone, Copy)]
pub(super) struct Posture {
    pub row: usize,
    pub seen: usize,
    pub off: usize,
}

/// The postures of each marker of which some observations were left out, in the order of their rows.
pub(super) fn given_postures<'a>(data: &'a Data, problem: &Problem) -> BTreeMap<&'a str, Vec<Posture>> {
    let row_of: BTreeMap<i64, usize> =
        problem.frame_numbers.iter().enumerate().map(|(row, number)| (*number, row)).collect();
    let mut left_out: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for left in data.left_out.iter().filter(|left| left.is_false()) {
        left_out.entry(&left.target).or_default().extend(row_of.get(&left.frame));
    }
    let mut out = BTreeMap::new();
    for (marker, rows) in left_out {
        let Some(own) = problem.scene.marker_names.iter().position(|name| name == marker) else { continue };
        let shows = |row: &usize| problem.frames[*row].others.iter().any(|o| o.marker() == Some(own));
        let kept = (0..problem.frames.len()).filter(shows).map(|row| (row, 0));
        let mut postures: BTreeMap<i64, Posture> = BTreeMap::new();
        for (row, off) in kept.chain(rows.into_iter().map(|row| (row, 1))) {
            let posture = postures.entry(problem.posture[row]).or_insert(Posture { row, seen: 0, off: 0 });
            posture.row = posture.row.min(row);
            posture.seen += 1;
            posture.off += off;
        }
        let mut postures: Vec<Posture> = postures.into_values().collect();
        postures.sort_unstable_by_key(|p| p.row);
        out.insert(marker, postures);
    }
    out
}

/// The law that is least probable by chance, with the log of that probability over all that could have been; none where few
/// postures are off, or most of them.
fn likeliest(is_off: &[bool], columns: &[(NodeId, Vec<f64>)], ordered: bool) -> Option<(f64, Common)> {
    let (n, k) = (is_off.len(), is_off.iter().filter(|off| **off).count());
    if k < FEWEST_POSTURES || k as f64 > MAJORITY * n as f64 {
        return None;
    }
    let mut laws: Vec<(f64, Common)> = Vec::new();
    let ends = (2 * columns.len()).max(1) as f64;
    for (node, column) in columns {
        for side in [1.0, -1.0] {
            let off = column.iter().zip(is_off).filter(|(_, off)| **off).map(|(q, _)| side * q);
            let least = off.fold(f64::INFINITY, f64::min);
            let m = column.iter().filter(|q| side * **q >= least).count();
            let common = Common::Beyond { node: *node, position: side * least, side };
            laws.push((log_share(m, n, k) + ends.ln(), common));
        }
    }
    let first = is_off.iter().position(|off| *off)?;
    let last = is_off.iter().rposition(|off| *off)?;
    if ordered {
        laws.push((share_of_runs(last - first + 1, n, k).ln(), Common::Between(first, last)));
    }
    // One more test than the joints' ends.
    let both = if ordered { 2.0_f64.ln() } else { 0.0 };
    laws.into_iter().map(|(p, common)| (p + both, common)).min_by(|a, b| a.0.total_cmp(&b.0))
}

/// `ln C(m, k) / C(n, k)`: that k of n, drawn by chance, are all among m.
fn log_share(m: usize, n: usize, k: usize) -> f64 {
    (0..k).map(|i| ((m - i) as f64 / (n - i) as f64).ln()).sum()
}

/// The probability that k of n in a row, drawn by chance, are all within m neighbours: summed over how many l neighbours they take, both
/// ends among them, `Σ_l (n − l + 1) C(l − 2, k − 2) / C(n, k)`.
fn share_of_runs(m: usize, n: usize, k: usize) -> f64 {
    let both_ends = |l: usize| (k * (k - 1)) as f64 / (l * (l - 1)) as f64;
    (k..=m).map(|l| (n - l + 1) as f64 * both_ends(l) * log_share(l, n, k).exp()).sum()
}

#[cfg(test)]
mod tests {
    use super::{Common, likeliest, log_share, share_of_runs};
    use rand::{Rng, SeedableRng};

    const JOINTS: usize = 7;

    fn columns(rng: &mut impl Rng, rows: usize) -> Vec<(usize, Vec<f64>)> {
        (0..JOINTS).map(|n| (n, (0..rows).map(|_| rng.random_range(-1.0..1.0)).collect())).collect()
    }

    #[test]
    fn the_share_is_that_of_all_draws() {
        // Of C(5, 2) = 10 pairs, C(3, 2) = 3 are among three.
        assert!((log_share(3, 5, 2).exp() - 0.3).abs() < 1e-12);
        assert_eq!(log_share(5, 5, 3), 0.0);
        // Of the ten pairs four are neighbours, three more leave one out, and all are within the five.
        let within = [2, 3, 5].map(|m| share_of_runs(m, 5, 2));
        assert!(within.iter().zip([0.4, 0.7, 1.0]).all(|(a, b)| (a - b).abs() < 1e-12), "{within:?}");
    }

    #[test]
    fn what_falls_on_any_posture_is_as_improbable_as_it_is_told() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        let (mut below, draws) = ([0.0; 2], 4000);
        for _ in 0..draws {
            let mut is_off: Vec<bool> = (0..60).map(|row| row < 5).collect();
            for row in (1..60).rev() {
                is_off.swap(row, rng.random_range(0..=row));
            }
            let found = likeliest(&is_off, &columns(&mut rng, 60), true);
            let log_p = found.map_or(f64::NAN, |(log_p, _)| log_p);
            assert!(log_p.is_finite());
            for (count, p) in below.iter_mut().zip([0.1_f64, 0.01]) {
                *count += f64::from(u8::from(log_p < p.ln()));
            }
        }
        // Bonferroni: no more often than told; and not far less, or the test would be blind.
        let share = below.map(|count| count / f64::from(draws));
        assert!(share[0] < 0.12 && share[0] > 0.02 && share[1] < 0.016, "{share:?}");
    }

    #[test]
    fn postures_beyond_a_position_and_in_a_run_are_found() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(6);
        let columns = columns(&mut rng, 80);
        let beyond: Vec<bool> = columns[3].1.iter().map(|q| *q < -0.8).collect();
        let found = likeliest(&beyond, &columns, true);
        let is_low =
            |law: Common| matches!(law, Common::Beyond { node: 3, position, side: -1.0 } if position < -0.8);
        assert!(found.is_some_and(|f| f.0 < -12.0 && is_low(f.1)), "{found:?}");
        let run: Vec<bool> = (0..80).map(|row| (20..28).contains(&row)).collect();
        let found = likeliest(&run, &columns, true);
        assert!(found.is_some_and(|f| f.0 < -12.0 && f.1 == Common::Between(20, 27)), "{found:?}");
    }
}
