//! A marker that was touched and came back: left out as false in most of a run of postures, and no other one with it.
//!
//! The run is that of [`super::false_together`], of postures: their views show the same body, so that they are no evidence of
//! their own. Where other markers that a joint moves together with it are left out in the same postures, nothing touched a marker:
//! what carries all of them is elsewhere (a play that is on its other side).

use crate::diagnose::assessment::false_together::{Run, run_of};
use crate::diagnose::assessment::left_out_together::{Posture, given_postures};
use crate::diagnose::data::diagnosis::Data;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::principles::{LOG_PRIOR_STRUCTURE, MAJORITY};
use std::collections::BTreeSet;

/// A run of the postures of a marker, and which of them are off.
struct OfMarker<'a> {
    marker: &'a str,
    postures: &'a [Posture],
    is_off: Vec<bool>,
    run: Run,
}

/// The warning if a marker was left out in most of a run of postures: it moved, and came back. None where that is `told` of the
/// marker already. `data` with the names that `problem` has.
pub(crate) fn came_back(problem: &Problem, data: &Data, told: Option<&str>) -> Option<String> {
    let given = given_postures(data, problem);
    let count = postures_of_markers(problem, data);
    let of_marker = given.iter().map(|(marker, postures)| {
        // What is elsewhere is so in all views; a false detection falls on any one.
        let is_off: Vec<bool> = postures.iter().map(|p| p.off as f64 > MAJORITY * p.seen as f64).collect();
        (*marker, postures.as_slice(), is_off)
    });
    let of_marker: Vec<(&str, &[Posture], Vec<bool>)> = of_marker.collect();
    let all = of_marker.iter().flat_map(|(.., is_off)| is_off).filter(|off| **off).count();
    let p = all as f64 / count.max(1) as f64;
    if all == 0 || p >= MAJORITY {
        return None;
    }
    let runs = of_marker.into_iter().filter_map(|(marker, postures, is_off)| {
        let run = run_of(&is_off, p)?;
        Some(OfMarker { marker, postures, is_off, run })
    });
    let found = runs.max_by(|a, b| a.run.gain.total_cmp(&b.run.gain))?;
    let own: Vec<&Posture> = found.off_in_run().collect();
    let is_told = told == Some(found.marker) || are_off_together(problem, data, &found);
    if found.run.gain <= -LOG_PRIOR_STRUCTURE || is_told {
        return None;
    }
    let number = |at: usize| found.postures.get(at).map_or(0, |p| problem.frame_numbers[p.row]);
    Some(format!(
        "{} was left out in {} of the {} postures from frame {} to {} that show it: something touched it there, or was taken for it; look at these frames, and fasten it",
        found.marker,
        own.len(),
        found.run.last + 1 - found.run.first,
        number(found.run.first),
        number(found.run.last)
    ))
}

impl OfMarker<'_> {
    fn off_in_run(&self) -> impl Iterator<Item = &Posture> {
        let its = self.run.first..=self.run.last;
        let postures = self.postures.iter().zip(&self.is_off).enumerate();
        postures.filter(move |(at, (_, off))| **off && its.contains(at)).map(|(_, (posture, _))| posture)
    }
}

/// How many postures show a marker, over all markers.
fn postures_of_markers(problem: &Problem, data: &Data) -> usize {
    let seen = problem.frames.iter().zip(&problem.posture);
    let mut out: BTreeSet<(usize, i64)> = seen
        .flat_map(|(frame, posture)| frame.others.iter().filter_map(|o| Some((o.marker()?, *posture))))
        .collect();
    out.extend(left_out_in(problem, data));
    out.len()
}

/// The markers that were left out as false, each with its posture.
fn left_out_in<'a>(problem: &'a Problem, data: &'a Data) -> impl Iterator<Item = (usize, i64)> + 'a {
    data.left_out.iter().filter(|left| left.is_false()).filter_map(|left| {
        let marker = problem.scene.marker_names.iter().position(|name| *name == left.target)?;
        let row = problem.frame_numbers.iter().position(|number| *number == left.frame)?;
        Some((marker, problem.posture[row]))
    })
}

/// Whether in most of these postures another marker was left out that some joint moves together with this one.
fn are_off_together(problem: &Problem, data: &Data, found: &OfMarker<'_>) -> bool {
    let names = &problem.scene.marker_names;
    let Some(own) = names.iter().position(|name| name == found.marker) else { return false };
    let moved_with = |other: usize| other != own && have_a_joint_in_common(problem, own, other);
    let others: BTreeSet<i64> =
        left_out_in(problem, data).filter(|(marker, _)| moved_with(*marker)).map(|(_, p)| p).collect();
    let (mut all, mut together) = (0, 0);
    for posture in found.off_in_run() {
        all += 1;
        together += usize::from(others.contains(&problem.posture[posture.row]));
    }
    together as f64 > MAJORITY * f64::from(all)
}

fn have_a_joint_in_common(problem: &Problem, a: usize, b: usize) -> bool {
    let nodes = &problem.scene.body.nodes;
    let of = |marker: usize| problem.marker_sites[marker].node.map(|node| &nodes[node].ancestors);
    let (Some(a), Some(b)) = (of(a), of(b)) else { return false };
    (0..nodes.len()).any(|n| problem.scene.moves(n) && a[n] && b[n])
}
