//! Which data were used, what was left out and why, and whether the rest is enough for a statement.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::data::diagnosis::Data;
use crate::diagnose::data::left_out::{LeftOut, Reason};
use crate::diagnose::data::recording::{Recording, Sighting, Target, Via};
use crate::diagnose::model::frame::{FEWEST_CORNERS, FrameWork, Task};
use crate::diagnose::model::problem::{Observation, Problem, Seen};
use crate::diagnose::principles::{FEWEST_OBSERVATIONS, FEWEST_POSTURES, MAJORITY, WORTH_NAMING};
use crate::error::Result;
use std::collections::{BTreeMap, BTreeSet};

/// The session in the steps from the given to the used data.
pub(crate) struct Sources<'a> {
    /// As it was given.
    pub given: &'a Recording,
    /// Arranged, before anything was left out by a model.
    pub arranged: &'a Problem,
    /// What was left out before the search, and why.
    pub left_out: &'a [LeftOut],
}

/// Counts what was given and used, and lists what was left out.
///
/// # Errors
/// Invalid parameters of camera or mirror.
pub(crate) fn data(sources: &Sources<'_>, findings: &Findings<'_>) -> Result<Data> {
    let (arranged, clean) = (sources.arranged, &findings.search.problem);
    let mut out = Data { left_out: sources.left_out.to_vec(), ..Data::default() };
    let listed: BTreeSet<(i64, String)> = out.left_out.iter().map(|l| (l.frame, l.target.clone())).collect();
    let deformation = findings.search.deformation(&findings.found.fit.model);
    let eye = arranged.eye(&deformation)?;
    let noise = findings.found.noise;
    let task = Task { gaussian: false, ..Task::of_residuals(arranged, &deformation, eye.as_ref(), noise) };
    let mut work = FrameWork::new(arranged);
    let (mut given, mut used) = (BTreeSet::new(), BTreeSet::new());
    for (f, frame) in sources.given.frames.iter().enumerate() {
        given.insert(frame.posture);
        out.frames_given += 1;
        out.points_given +=
            frame.sightings.iter().filter(|s| is_marker(s.target)).count() + frame.points.len();
        let mut tell = |target: &str, deviations: Option<f64>, why: Reason| {
            if !listed.contains(&(frame.number, target.to_owned())) {
                out.left_out.push(LeftOut {
                    frame: frame.number,
                    target: target.to_owned(),
                    deviations,
                    why,
                });
            }
        };
        let corner = |s: &&Sighting| matches!((s.target, s.via), (Target::Corner(_), Via::Mirror));
        let corners = frame.sightings.iter().filter(corner).count();
        let slipped = findings.slip.is_some_and(|s| (s.first..=s.last).contains(&f));
        let mirror = clean.boards.get(f).copied().flatten().is_some();
        let others = &arranged.frames[f].others;
        let known = work.evaluate(arranged, &task, f);
        if corners > 0 && !(mirror && known) && !slipped {
            let few = Reason::FewCorners { got: corners, needed: FEWEST_CORNERS };
            let no_mirror = Reason::NoMirror { beside_others: false };
            tell("board", None, if corners < FEWEST_CORNERS { few } else { no_mirror });
        }
        for corner in arranged.false_corners.iter().filter(|corner| corner.frame == f) {
            tell("board", Some(corner.deviations), Reason::CornerBeside { index: corner.index });
        }
        let names = &arranged.scene.marker_names;
        let residuals = if known { work.residuals_of(others) } else { vec![None; others.len()] };
        let mut kept = clean.frames[f].others.iter().filter(|o| o.marker().is_some()).peekable();
        let mut any = false;
        for (observation, residual) in others.iter().zip(residuals) {
            let Some(marker) = observation.marker() else { continue };
            let deviations = residual.map(|r| r.norm() / observation.marker_std(noise));
            let by_mirror = matches!(observation, Observation::Pixel { via: Via::Mirror, .. });
            let is_kept = kept.peek().is_some_and(|k| same(k, observation));
            if is_kept {
                kept.next();
            }
            // What the model cannot predict took no part in any fit.
            let in_sight = deviations.is_some();
            if is_kept && in_sight && (mirror || !by_mirror) {
                out.points_used += 1;
                any = true;
            } else if slipped {
                tell(&names[marker], None, Reason::OtherRow);
            } else if by_mirror && !mirror {
                tell(&names[marker], None, Reason::NoBoard);
            } else if !in_sight && matches!(observation, Observation::Pixel { .. }) {
                tell(&names[marker], None, Reason::OutOfSight);
            } else {
                tell(&names[marker], deviations, Reason::FarFromModel);
            }
        }
        if any {
            out.frames_used += 1;
            used.insert(frame.posture);
        }
    }
    (out.postures_given, out.postures_used) = (given.len(), used.len());
    out.left_out.sort_by(|a, b| (a.frame, &a.target).cmp(&(b.frame, &b.target)));
    Ok(out)
}

/// Whether there is too little evidence for a statement.
pub(crate) fn insufficient(data: &Data) -> bool {
    data.postures_used < FEWEST_POSTURES || data.points_used < FEWEST_OBSERVATIONS
}

/// Whether so many observations were left out as false that the agreement of the rest with the model says little: single
/// ones, or whole rows that no single joint corrects.
pub(crate) fn much_is_false(data: &Data) -> bool {
    data.false_count() as f64 > WORTH_NAMING * data.points_given as f64
        || rows_off(data) as f64 > WORTH_NAMING * data.frames_given as f64
}

/// Whether in more than a negligible share of the frames no flat mirror explains the board.
pub(crate) fn many_boards_are_false(data: &Data) -> bool {
    data.boards_without_mirror() as f64 > WORTH_NAMING * data.frames_given as f64
}

/// In how many frames no flat mirror explains the board, in words.
pub(crate) fn what_boards_are_false(data: &Data) -> String {
    format!(
        "in {} of {} frames no flat mirror explains the board's corners, and they were left out: the board counted from another corner, another grid, or a mirror \
         that is not flat there; look at these frames' pictures",
        data.boards_without_mirror(),
        data.frames_given
    )
}

/// The frames of what one joint's other position corrects, with that joint and whether the position is a larger one.
fn elsewhere(data: &Data) -> impl Iterator<Item = (i64, (&str, bool))> {
    data.left_out.iter().filter_map(|left| Some((left.frame, left.joint_elsewhere()?)))
}

/// The joint that is elsewhere in most of the postures that one joint corrects, always to the same side, and in how many:
/// a law of that joint, and no digits. None of fewer than three postures; `posture_of` a frame, by its number.
fn one_joint_elsewhere(data: &Data, posture_of: impl Fn(i64) -> i64) -> Option<(String, usize)> {
    let mut postures: BTreeMap<(&str, bool), BTreeSet<i64>> = BTreeMap::new();
    let mut all: BTreeSet<i64> = BTreeSet::new();
    for (frame, of) in elsewhere(data) {
        let posture = posture_of(frame);
        postures.entry(of).or_default().insert(posture);
        all.insert(posture);
    }
    let ((joint, _), its) = postures.into_iter().max_by_key(|(_, its)| its.len())?;
    let many = its.len() >= FEWEST_POSTURES && its.len() as f64 > MAJORITY * all.len() as f64;
    many.then(|| (joint.to_owned(), its.len()))
}

/// In how many frames nearly all that was seen is far from the model, and no single joint corrects it.
fn rows_off(data: &Data) -> usize {
    let off = data.left_out.iter().filter(|l| matches!(l.why, Reason::WholeRow(None)));
    off.map(|l| l.frame).collect::<BTreeSet<_>>().len()
}

/// The joint that is elsewhere in several postures, always to the same side, and that in words; none where no joint is.
pub(crate) fn what_is_elsewhere(data: &Data, problem: &Problem) -> Option<(String, String)> {
    let posture_of = |number: i64| {
        let frame = problem.frame_numbers.iter().position(|n| *n == number);
        frame.map_or(number, |frame| problem.posture[frame])
    };
    let (joint, postures) = one_joint_elsewhere(data, posture_of)?;
    let told = format!(
        "in {postures} of {} postures joint:{joint} is elsewhere than the row says, always to the same side, and they were left out: it stops before its target (a limit, a collision, \
         a cable), slips, or loses steps",
        data.postures_given
    );
    Some((joint, told))
}

/// How many rows were left out that other positions of joints correct, in words; none where no row was.
pub(crate) fn rows_elsewhere(data: &Data) -> Option<String> {
    let rows: BTreeSet<i64> = elsewhere(data).map(|(frame, _)| frame).collect();
    let joints: BTreeSet<&str> = elsewhere(data).map(|(_, (joint, _))| joint).collect();
    (!rows.is_empty()).then(|| {
        let joints: Vec<String> = joints.iter().map(|joint| format!("joint:{joint}")).collect();
        format!(
            "{} of {} rows were left out, to which another position of one joint would fit ({}): a typed digit, or a joint that did not get there",
            rows.len(),
            data.frames_given,
            joints.join(", ")
        )
    })
}

/// How many observations are false, in words.
pub(crate) fn what_is_false(data: &Data) -> String {
    if data.false_count() as f64 <= WORTH_NAMING * data.points_given as f64 {
        return format!(
            "In {} of {} frames nearly all that was seen is far from the model, no single joint corrects it, and they were left out; the rest agrees with the nominal model. \
             Look at what the robot did there.",
            rows_off(data),
            data.frames_given
        );
    }
    format!(
        "{} of {} observations of markers are far from any model and were left out; the rest agrees with the nominal model. Look at what is listed: names, rows, or something that moved.",
        data.false_count(),
        data.points_given
    )
}

/// What is missing, in counts and in the commonest reason.
pub(crate) fn what_is_missing(data: &Data) -> String {
    if !insufficient(data) {
        return format!(
            "No statement is possible: of {} frames with {} observations of markers no model that was found predicts any; boards and markers contradict each other \
             as the session describes them (the camera's link, the camera file, the board).",
            data.frames_given, data.points_given
        );
    }
    let mut counts: Vec<(&Reason, usize)> = Vec::new();
    for left in &data.left_out {
        match counts.iter_mut().find(|c| *c.0 == left.why) {
            Some(count) => count.1 += 1,
            None => counts.push((&left.why, 1)),
        }
    }
    counts.sort_by_key(|c| core::cmp::Reverse(c.1));
    let why = match counts.first() {
        Some((why, count)) => format!("; most often ({count} times): {why}"),
        None if data.points_given == 0 => "; no marker was seen or measured at all".to_owned(),
        None => String::new(),
    };
    format!(
        "Too little usable evidence for a statement: {} of {} postures and {} of {} observations of markers could be used, {FEWEST_POSTURES} postures and {FEWEST_OBSERVATIONS} observations are the least{why}.",
        data.postures_used, data.postures_given, data.points_used, data.points_given
    )
}

fn is_marker(target: Target) -> bool {
    matches!(target, Target::Marker(_))
}

pub(super) fn same(a: &Observation, b: &Observation) -> bool {
    match (a, b) {
        (
            Observation::Pixel { seen: Seen::Marker(m), via: v, pixel: p },
            Observation::Pixel { seen: Seen::Marker(n), via: w, pixel: q },
        ) => m == n && v == w && p == q,
        (Observation::Point { marker: m, position: p }, Observation::Point { marker: n, position: q }) => {
            m == n && p == q
        }
        _ => false,
    }
}
