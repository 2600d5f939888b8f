//! Gross mistakes of model or log, tried exactly before small errors are searched.
//!
//! Each is a discrete alternative (effects.md, "Gross mistakes"): an axis with the wrong sign, exchanged columns or
//! names, a column in another unit, late, or standing still, a camera file of another resolution, a mirrored
//! picture, a rotated board, a marker on another link. They are the mistakes of the first day with a robot: hence the folder's
//! name. In order ([`undone()`]):
//!
//! 1. [`hung`]: rows that repeat one measurement are left out; [`optics`]: boards that no small error makes
//!    possible, with the likeliest of other resolutions ([`resolutions`]); these mistakes are undone first;
//! 2. [`background`]: what stands still in the picture under a marker's name is left out;
//! 3. unless a single cause of a usual size explains everything ([`single_cause`]): [`alternatives`] of the body and of the
//!    log, scored at the nominal model by a robust loss ([`misfit`]), singly, and on top of the best few ([`chain`]); columns that
//!    no effect describes ([`lost`]) are among them;
//! 4. [`verify`]: the best few against small errors of every kind at once, by marginal likelihood ([`choice`]); the best chain
//!    is undone exactly ([`mistake`]), with names that are exchanged in a cycle ([`permuted`]);
//! 5. where something is left, a log that is late by less than a row ([`small_delay`]);
//! 6. gravity in other directions, by the springs that its loads would need ([`loads`]);
//! 7. slips and lost zeros during the session ([`changes`]), where something is left or a zero changes once ([`single_step`]);
//! 8. [`outlying`]: observations that the causes known so far cannot explain are left out.
//!
//! The usual search continues from there.

mod alternatives;
mod apart;
mod background;
mod by_frame;
mod chain;
mod changes;
mod choice;
mod coupled;
mod exchanges;
mod frame_beside;
mod free_numbers;
mod freed;
mod friction_everywhere;
mod hung;
mod hysteresis;
mod in_another_session;
mod kept_poses;
mod loads;
mod lost;
mod memory;
mod misfit;
mod mistake;
mod mounts;
mod optics;
mod other_position;
mod outlying;
mod permuted;
mod placed;
mod posture_scatter;
mod reported;
mod resolutions;
mod single_cause;
mod single_step;
mod small_delay;
mod spoilt;
mod still_log;
mod table;
#[cfg(test)]
mod tests;
mod there_and_back;
mod undone;
mod variant;
mod verify;
mod wandering;

use crate::diagnose::data::recording::{Frame, Recording, Target};
use crate::diagnose::likelihood::probability::tempered;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::prepare::first_result::FirstResult;
use crate::diagnose::prepare::row_slip;
use crate::diagnose::principles::{BEYOND_DOUBT, FEWEST_FRAMES, Size};
use crate::error::Result;
use crate::robot::Robot;
use alternatives::Session;
use chain::{BEAM, Chain, FRAMES, grown, least_fall, spread, unlike};
pub(crate) use memory::Memory;
use misfit::Misfit;
use mistake::Changes;
pub(crate) use mistake::{Mistake, ZERO_LOST, unit_near};
use permuted::chain_of_names;
pub(crate) use reported::REVERSED;
pub(crate) use resolutions::resolution_near;
pub(crate) use spoilt::{Lost, Step, column};
use undone::arranged_again;
pub(crate) use undone::{Doubt, Undone};
use variant::Variant;

/// Frames on which small errors are fitted together with a slip.
const FRAMES_OF_SLIPS: Size = 100;

/// What may be taken for a gross mistake.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Suspects {
    /// Rows that repeat a measurement.
    pub hung: bool,
    /// A column that is unrelated to its joint, and a joint's zero that is another one from a row on.
    pub spoilt: bool,
    /// Gravity in a direction under which a spring explains more than any single cause, however little more.
    pub loads_turned: bool,
}

impl Suspects {
    /// What a first diagnosis suspects.
    pub const AT_FIRST: Self = Self { hung: true, spoilt: true, loads_turned: false };
}

/// Finds and undoes gross mistakes; none where there is none. `known`: the result of a first diagnosis; with it,
/// mistakes are also found that are as small as usual errors (a late column of a joint that hardly moves). `memory`: the
/// results of earlier calls for the same session.
///
/// # Errors
/// Invalid parameters of camera or mirror.
pub(crate) fn undone(
    robot: &Robot,
    recording: &Recording,
    problem: &Problem,
    without: &[String],
    known: Option<&FirstResult>,
    suspects: Suspects,
    memory: &mut Memory,
) -> Result<Option<Undone>> {
    let mut out = Undone {
        robot: robot.clone(),
        recording: recording.clone(),
        problem: problem.clone(),
        told: Vec::new(),
        trace: Vec::new(),
        doubts: Vec::new(),
        left_out: Vec::new(),
        wrong_grids: None,
        all_boards: false,
        mistakes: Vec::new(),
        unsettled: false,
        lost: None,
        step: None,
        loads_may_be_turned: false,
    };
    let spoilt = suspects.spoilt;
    if suspects.hung {
        for mistake in hung::find(recording, problem) {
            out.undo(&mistake, tempered(BEYOND_DOUBT))?;
        }
    }
    // One of each kind: a picture may be mirrored and of another crop.
    let mut tried = without.to_vec();
    while let Some((mistake, odds)) =
        optics::find(&out.robot, &out.recording, &tried, known.is_some(), &problem.cancel)?
    {
        tried.push(mistake.effect().to_owned());
        out.undo(&mistake, tempered(odds))?;
    }
    problem.cancel.check()?;
    out.leave_out_background()?;
    // What a single cause of a usual size explains to the noise no gross mistake explains better, unless the boards that show one were
    // left out; who switches an effect off asks what else it could be.
    let usual = known.is_none()
        && without.is_empty()
        && !boards_may_hang_on_joints(&out)
        && memory.is_explained_as_usual(&out.problem, &out.mistakes)?;
    let choice = if usual { choice::Choice::none() } else { of_the_body(&mut out, without, known, spoilt)? };
    for mistake in &choice.mistakes {
        let first = out.told.len();
        if mistake.has_no_word() {
            // Change points are weighed against each other below.
            if matches!(mistake, Mistake::ColumnLost { .. })
                || change_point(&out, without, spoilt, memory)?.is_none()
            {
                out.set_apart(mistake)?;
            }
            continue;
        }
        out.undo(mistake, choice.probability)?;
        out.told[first..].iter_mut().for_each(|cause| cause.alternatives.clone_from(&choice.instead));
    }
    out.doubts = choice.doubts;
    // The errors of an unknown joint would look like springs.
    let mut explained = memory.is_explained(&out.problem, &out.mistakes)?;
    let late = |m: &Mistake| matches!(m, Mistake::Late { .. });
    // Rows that contain other rows' measurements are late by whole rows.
    if !explained
        && !out.unsettled
        && known.is_none()
        && out.lost.is_none()
        && !without.iter().any(|w| w == "joint_late")
        && !out.mistakes.iter().any(late)
        && let Some((mistake, odds)) = small_delay::find(&out.problem, &out.recording)?
    {
        out.undo(&mistake, tempered(odds))?;
        explained = memory.is_explained(&out.problem, &out.mistakes)?;
    }
    if out.lost.is_none()
        && !without.iter().any(|w| w == "gravity_direction")
        && let Some(turned) = memory.turned_gravity(&out.problem, &out.mistakes, explained)?
    {
        if turned.sure || suspects.loads_turned {
            out.undo(&turned.mistake, tempered(turned.log_odds))?;
        } else {
            out.loads_may_be_turned = true;
        }
    }
    // A drift leaves no gap beside a small step of the zero.
    let stepped = explained
        && spoilt
        && memory.stepped.remembered(&out.mistakes, || Ok(single_step::find(&out.problem)?.is_some()))?;
    if !out.unsettled && (!explained || stepped) {
        // Each round's is at a place that has not slipped yet, so the number of rounds is limited.
        while let Some((mistakes, odds)) = change_point(&out, without, spoilt, memory)? {
            let Some(first) = mistakes.first() else { break };
            if first.has_no_word() {
                if out.step.is_some() {
                    break;
                }
                out.set_apart(first)?;
                continue;
            }
            // A remainder at a place that has slipped already is the rest of that slip.
            if out.problem.slips.iter().any(|s| first.slips(s.what)) {
                break;
            }
            for mistake in &mistakes {
                out.undo(mistake, tempered(odds))?;
            }
        }
    }
    if !out.unsettled {
        out.leave_out_false(memory)?;
    }
    let nothing = out.lost.is_none()
        && out.step.is_none()
        && !out.loads_may_be_turned
        && out.told.is_empty()
        && out.trace.is_empty()
        && out.left_out.is_empty();
    Ok((!nothing).then_some(out))
}

/// Whether a deformation leaves errors of a size that mistakes have, of a session with its mistakes undone. False where
/// something slipped: the loss does not know of slips.
///
/// # Errors
/// Invalid parameters of camera or mirror.
pub(crate) fn leaves_gross(problem: &Problem, found: &Deformation, recording: &Recording) -> Result<bool> {
    if !problem.slips.is_empty() {
        return Ok(false);
    }
    let misfit = Misfit::given(problem, found)?;
    let frames = spread(&crate::diagnose::likelihood::saturated::postures(problem), FRAMES, 1);
    Ok(Chain::new(Vec::new(), Variant::of(recording, problem), &misfit, &frames).is_gross())
}

/// The rows of a slip and the way back.
fn there_and_back_in(mistakes: &[Mistake]) -> Option<core::ops::Range<usize>> {
    match mistakes {
        [Mistake::Slip { slip: there, .. }, Mistake::Slip { slip: back, .. }] => {
            Some(there.first..back.first)
        }
        _ => None,
    }
}

/// A slip, or a lost zero of a joint, during the session; a slip and the way back.
fn change_point(session: &Undone, without: &[String], zeros: bool, memory: &mut Memory) -> Result<Changes> {
    if without.iter().any(|w| w == "slip") {
        return Ok(None);
    }
    let rows = !without.iter().any(|w| w == "pairing");
    memory.slips[usize::from(zeros)][usize::from(rows)].remembered(&session.mistakes, || {
        let problem = &session.problem;
        let postures = crate::diagnose::likelihood::saturated::postures(problem);
        let clear = changes::find(problem, &spread(&postures, FRAMES_OF_SLIPS, 1), problem.noise, zeros)?;
        // Rows that contain other rows' measurements look like a place that slipped, and came back: they are looked for later.
        let run = clear.as_ref().and_then(|(mistakes, _)| there_and_back_in(mistakes));
        if let Some(run) = run.filter(|_| rows)
            && row_slip::accounts_for(problem, run)?
        {
            return Ok(None);
        }
        if clear.is_none() && zeros { single_step::find(problem) } else { Ok(clear) }
    })
}

/// The chain of mistakes of body and log that is more probable than small errors, and its probability.
fn of_the_body(
    session: &mut Undone,
    without: &[String],
    known: Option<&FirstResult>,
    spoilt: bool,
) -> Result<choice::Choice> {
    let mut lines = Vec::new();
    // Where no mirror explains a board, a joint between it and the camera may be elsewhere.
    let whole = if boards_may_hang_on_joints(session) {
        Some(arranged_again(&session.robot, &session.recording, &session.problem)?)
    } else {
        None
    };
    let mut choice = chain_of_the_body(session, whole.as_ref(), without, (known, spoilt), &mut lines)?;
    let all = choice.mistakes.len();
    // Slipped rows are found, and left out, by the stage that follows; the squares' size by the search.
    let of_rows = choice.mistakes.iter().any(|m| matches!(m, Mistake::Rows { .. }));
    if let Some(whole) = whole.filter(|_| of_rows) {
        // What the slipped rows show is needed to find them.
        session.problem = whole;
        session.wrong_grids = Some(Vec::new());
        session.all_boards = true;
    }
    choice.mistakes.retain(|m| !matches!(m, Mistake::Rows { .. } | Mistake::Squares { .. }));
    session.unsettled = choice.mistakes.len() < all;
    session.trace.append(&mut lines);
    Ok(choice)
}

/// Whether joints move the board before the camera, and boards that are in the recording were left out.
fn boards_may_hang_on_joints(session: &Undone) -> bool {
    let problem = &session.problem;
    let moved = problem.between_camera_and_board.iter().any(|&n| problem.scene.moves(n));
    let seen = |frame: &Frame| frame.sightings.iter().any(|s| matches!(s.target, Target::Corner(_)));
    let without = problem.frames.iter().zip(&session.recording.frames);
    moved
        && without.filter(|(arranged, frame)| arranged.corners.is_empty() && seen(frame)).count()
            >= FEWEST_FRAMES
}

/// `whole`: the problem with the boards that no mirror explains, where these count.
fn chain_of_the_body(
    session: &Undone,
    whole: Option<&Problem>,
    without: &[String],
    (known, spoilt): (Option<&FirstResult>, bool),
    lines: &mut Vec<String>,
) -> Result<choice::Choice> {
    let problem = whole.unwrap_or(&session.problem);
    let misfit = Misfit::new(problem)?;
    let misfit = if whole.is_some() { misfit.with_boards() } else { misfit };
    let log = &session.recording.columns;
    let all = Session::new(problem, &misfit, log);
    let mut frames = spread(&all.postures, FRAMES, 1);
    // What was left out shows a mistake of a few rows.
    frames.extend(known.iter().flat_map(|known| &known.false_frames));
    frames.sort_unstable();
    frames.dedup();
    let variant = Variant::of(&session.recording, problem);
    let nominal = Chain::new(Vec::new(), variant.clone(), &misfit, &frames);
    let mut chains = Vec::new();
    // Large mistakes were searched before anything was known; small ones are searched since causes are known.
    let closely = known.is_some();
    if nominal.is_gross() != closely {
        chains = grown(&all, &nominal, &frames, without, closely)?;
        let named = !without.iter().any(|w| w == "markers_swapped");
        let permuted = if named { chain_of_names(&all, &nominal, &frames) } else { None };
        // What is grown exchange by exchange may end with it, too.
        let best = chains.first().map_or(nominal.loss, |c| c.loss);
        chains.extend(permuted.filter(|c| c.loss < best - least_fall(closely)));
    }
    if spoilt && nominal.is_gross() {
        let mut shown = choice::compared_on(&all, &chains);
        shown.extend(&frames);
        shown.sort_unstable();
        shown.dedup();
        let least_fall = least_fall(closely);
        let searched =
            lost::Searched { frames: &frames, shown: &shown, least_fall, of_words: &chains, without };
        let mut of_no_word = lost::chains(&all, &nominal, &searched);
        if of_no_word.is_empty() {
            of_no_word = lost::chains_beside_mounts(session, &nominal, &searched)?;
        }
        // Beside mounts a mistake's number is estimated better.
        chains.retain(|c| !of_no_word.iter().any(|other| other.is_like(c)));
        chains.extend(of_no_word);
    }
    if let Some(known) = known {
        let beside = Misfit::beside(problem, &known.deformation, &variant)?;
        let nominal = Chain::new(Vec::new(), variant, &beside, &frames);
        let own = chains.split_off(chains.iter().position(Chain::has_no_word).unwrap_or(chains.len()));
        chains.extend(grown(&Session::new(problem, &beside, log), &nominal, &frames, without, true)?);
        unlike(&mut chains, 2 * BEAM);
        chains.extend(own);
    }
    if chains.is_empty() {
        return Ok(choice::Choice::none());
    }
    let sought = known.is_some_and(|known| known.sought);
    choice::chosen(session, &all, nominal, chains, sought, lines)
}
