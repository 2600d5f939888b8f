//! Regions of posture space, held out in turn, so that an effect which fits only its own neighbourhood gains
//! nothing.

use crate::diagnose::likelihood::saturated::postures;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::Size;

/// Regions that are held out in turn.
pub(crate) const REGIONS: Size = 5;

/// The frames of each region, given the region of each frame.
pub(crate) fn frames_of(labels: &[usize]) -> Vec<Vec<usize>> {
    let mut out = vec![Vec::new(); labels.iter().max().map_or(0, |most| most + 1)];
    labels.iter().enumerate().for_each(|(frame, &region)| out[region].push(frame));
    out
}

/// Which frames are in a region, given the region of each frame.
pub(crate) fn only(labels: &[usize], region: usize) -> Vec<bool> {
    labels.iter().map(|label| *label == region).collect()
}

/// Which are in another one.
pub(crate) fn all_but(labels: &[usize], region: usize) -> Vec<bool> {
    labels.iter().map(|label| *label != region).collect()
}

/// The region of each frame: k-means on the standardised commanded positions of the moving joints, one row a
/// posture.
///
/// Start values are spread deterministically (each next start is the posture farthest from the previous ones:
/// Gonzalez 1985), so the same session always has the same regions. Few postures have fewer regions.
pub(crate) fn regions(problem: &Problem) -> Vec<usize> {
    let scene = &problem.scene;
    let groups = postures(problem);
    let moving: Vec<usize> = (0..scene.nodes()).filter(|&n| scene.relevant[n] && scene.moves(n)).collect();
    let count = REGIONS.min(groups.len() / 2).max(1);
    let mut rows: Vec<Vec<f64>> =
        groups.iter().map(|frames| moving.iter().map(|&n| scene.q(frames[0], n)).collect()).collect();
    for k in 0..moving.len() {
        let mean = rows.iter().map(|r| r[k]).sum::<f64>() / rows.len() as f64;
        let variance = rows.iter().map(|r| (r[k] - mean).powi(2)).sum::<f64>() / rows.len() as f64;
        let std = variance.sqrt().max(1e-9);
        rows.iter_mut().for_each(|r| r[k] = (r[k] - mean) / std);
    }
    let distance = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum::<f64>();
    let mut centers: Vec<Vec<f64>> = vec![rows[0].clone()];
    while centers.len() < count {
        let farthest = rows.iter().max_by(|a, b| {
            let near = |r: &[f64]| centers.iter().map(|c| distance(r, c)).fold(f64::INFINITY, f64::min);
            near(a).total_cmp(&near(b))
        });
        match farthest {
            Some(row) => centers.push(row.clone()),
            None => break,
        }
    }
    let mut labels = vec![0; rows.len()];
    for _ in 0..SOLVER.cluster_rounds {
        for (row, label) in rows.iter().zip(&mut labels) {
            *label = (0..centers.len())
                .min_by(|&a, &b| distance(row, &centers[a]).total_cmp(&distance(row, &centers[b])))
                .unwrap_or(0);
        }
        for (c, center) in centers.iter_mut().enumerate() {
            let members: Vec<&Vec<f64>> =
                rows.iter().zip(&labels).filter(|(_, l)| **l == c).map(|(r, _)| r).collect();
            if members.is_empty() {
                continue;
            }
            for (k, value) in center.iter_mut().enumerate() {
                *value = members.iter().map(|m| m[k]).sum::<f64>() / members.len() as f64;
            }
        }
    }
    let mut out = vec![0; scene.frames];
    for (frames, label) in groups.iter().zip(labels) {
        frames.iter().for_each(|&f| out[f] = label);
    }
    out
}
