//! Whole mistakes of model or log, tried exactly before small errors are searched.
//!
//! Each is a discrete alternative (effects.md, "Mistakes of a first day"): an axis that turns the other way, exchanged columns
//! or names, a column in another unit, late, or standing still, the camera of another resolution, a mirrored picture, a turned
//! board, a marker on another link. In order:
//!
//! 1. [`optics`]: what no small error makes possible for the boards, undone first;
//! 2. [`alternatives`] of the body and of the log, scored at the nominal model by a loss that gross errors do not rule
//!    ([`misfit`]), singly, and on top of the best few;
//! 3. [`verify`]: the best few against small errors of every kind at once, by marginal likelihood;
//! 4. gravity in other directions, by the springs that its loads would need ([`loads`]);
//! 5. what slips in the middle of the session ([`changes`]);
//! 6. what wins is undone exactly ([`mistake`]), and the usual search goes on from there.

mod alternatives;
mod changes;
mod choice;
mod free_numbers;
mod loads;
mod misfit;
mod mistake;
mod mounts;
mod optics;
mod outlying;
#[cfg(test)]
mod tests;
mod told;
mod variant;
mod verify;

use crate::diagnose::data::diagnosis::{Cause, LeftOut};
use crate::diagnose::data::recording::Recording;
use crate::diagnose::likelihood::probability::tempered;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::model::work_budget::A_STAGE;
use crate::diagnose::prepare::boards::leave_out_wrong_grids;
use crate::diagnose::prepare::known::Known;
use crate::diagnose::principles::{A_GAP, Size, Threshold};
use crate::error::Result;
use crate::robot::Robot;
use crate::statistics::GOLDEN_SECTION;
use alternatives::Session;
pub(crate) use changes::settle_slip;
pub(crate) use choice::Doubt;
use misfit::{LEAST_FALL, Misfit};
pub(crate) use mistake::Mistake;
use rayon::prelude::*;
pub(crate) use told::told;
use variant::Variant;

/// Frames on which alternatives are scored, and on which they are verified.
const FRAMES: Size = 64;
/// How many of the best chains of mistakes are gone on from and verified.
const BEAM: Size = 4;
/// A mean loss below this is that of small errors: nothing is gross.
const GROSS: Threshold = 0.12;
/// The same for the marker that is farthest off: one of several may sit on another link.
const GROSS_OF_ONE: Threshold = 2.0 * GROSS;
/// The share that makes a gap, by which the mean loss must fall too.
const LEAST_SHARE: Threshold = A_GAP - 1.0;
/// Frames on which small errors are fitted beside a slip.
const FRAMES_OF_SLIPS: Size = 100;

/// The session with its mistakes undone.
pub(crate) struct Undone {
    pub robot: Robot,
    pub recording: Recording,
    pub problem: Problem,
    pub told: Vec<Cause>,
    /// How it went, a line a step.
    pub trace: Vec<String>,
    /// Mistakes that could stand for a small error, where the data do not decide.
    pub doubts: Vec<Doubt>,
    /// Single observations that are false.
    pub left_out: Vec<LeftOut>,
    /// Whether rows hold other rows' measurement, or the board's squares are of another size, of which later stages take care: until
    /// then they would pass for slips and false observations.
    unsettled: bool,
}

/// A chain of mistakes with the session as it would be.
#[derive(Clone)]
struct Chain {
    mistakes: Vec<Mistake>,
    variant: Variant,
    loss: f64,
    /// The mean loss of the marker that has the largest.
    worst: f64,
}

impl Chain {
    fn new(mistakes: Vec<Mistake>, variant: Variant, misfit: &Misfit<'_>, frames: &[usize]) -> Self {
        let (loss, worst) = misfit.mean_losses(&variant, frames);
        Self { mistakes, variant, loss, worst }
    }

    /// With one more mistake, which may be one with the last.
    fn with(&self, mistake: &Mistake, session: &Session<'_>, frames: &[usize]) -> Self {
        let mut mistake = mistake.clone();
        let mut variant = self.variant.clone();
        if let Mistake::LogFrozen { joint, first, last } = &mut mistake {
            variant = session.freed(&self.variant, *joint, *first, *last);
            *first = session.begun(&self.variant, &variant, *first, *last);
        } else {
            mistake.on_variant(&mut variant);
        }
        let mut mistakes = self.mistakes.clone();
        match mistakes.last().and_then(|last| last.together(&mistake)) {
            Some(one) => *mistakes.last_mut().unwrap_or(&mut mistake) = one,
            None => mistakes.push(mistake),
        }
        Self::new(mistakes, variant, session.misfit, frames)
    }

    /// The same mistakes but for one, from a chain that has none.
    fn without(&self, which: usize, none: &Self, session: &Session<'_>, frames: &[usize]) -> Self {
        let others = self.mistakes.iter().enumerate().filter(|(i, _)| *i != which);
        others.fold(none.clone(), |chain, (_, mistake)| chain.with(mistake, session, frames))
    }

    /// Whether both have the same mistakes but for their numbers.
    fn is_like(&self, other: &Self) -> bool {
        self.mistakes.len() == other.mistakes.len()
            && self.mistakes.iter().all(|m| other.mistakes.iter().any(|o| o.is_like(m)))
    }

    /// Whether something is left that is more than small errors, of one marker alone too.
    fn is_gross(&self) -> bool {
        self.loss > GROSS || self.worst > GROSS_OF_ONE
    }
}

/// Finds and undoes whole mistakes; none where there is none. `known`: what a first diagnosis found; beside that mistakes are looked for too that do no more than small errors do (a late column of a joint that hardly moves).
///
/// # Errors
/// Invalid parameters of camera or mirror.
pub(crate) fn undone(
    robot: &Robot,
    recording: &Recording,
    problem: &Problem,
    without: &[String],
    known: Option<&Known>,
) -> Result<Option<Undone>> {
    let mut out = Undone {
        robot: robot.clone(),
        recording: recording.clone(),
        problem: problem.clone(),
        told: Vec::new(),
        trace: Vec::new(),
        doubts: Vec::new(),
        left_out: Vec::new(),
        unsettled: false,
    };
    // One of each kind: a picture may be mirrored and of another crop.
    let mut tried = without.to_vec();
    while let Some((mistake, odds)) =
        optics::find(&out.robot, &out.recording, &tried, known.is_some(), &problem.cancel)?
    {
        tried.push(mistake.effect().to_owned());
        out.undo(&mistake, tempered(odds))?;
    }
    problem.cancel.check()?;
    let choice = of_the_body(&mut out, without, known)?;
    for mistake in &choice.mistakes {
        let first = out.told.len();
        out.undo(mistake, choice.probability)?;
        out.told[first..].iter_mut().for_each(|cause| cause.alternatives.clone_from(&choice.instead));
    }
    out.doubts = choice.doubts;
    if !without.iter().any(|w| w == "gravity_direction")
        && let Some((mistake, odds)) = loads::turned_gravity(&out.problem)?
    {
        out.undo(&mistake, tempered(odds))?;
    }
    if !out.unsettled && !without.iter().any(|w| w == "slip") {
        // Each round's is at a place that has not slipped yet: there are but so many.
        loop {
            let postures = crate::diagnose::likelihood::saturated::postures(&out.problem);
            let frames = spread(&postures, FRAMES_OF_SLIPS, 1);
            let Some((mistake, odds)) = changes::find(&out.problem, &frames, out.problem.noise)? else {
                break;
            };
            // What is left at a place that has slipped already is the rest of that slip.
            if out.problem.slips.iter().any(|s| mistake.slips(s.what)) {
                break;
            }
            out.undo(&mistake, tempered(odds))?;
        }
    }
    if !out.unsettled {
        out.leave_out_false()?;
    }
    let nothing = out.told.is_empty() && out.trace.is_empty() && out.left_out.is_empty();
    Ok((!nothing).then_some(out))
}

impl Undone {
    /// Leaves out what no small error explains: digits, labels, rows whose joints were elsewhere.
    fn leave_out_false(&mut self) -> Result<()> {
        let names = names(&self.robot);
        let found = outlying::find(&self.problem, &self.recording, &names, self.problem.noise)?;
        for outlying::False { frame, indices, told } in found {
            outlying::remove(&mut self.recording.frames[frame], &indices);
            let mut at = 0;
            self.problem.frames[frame].others.retain(|_| {
                at += 1;
                !indices.contains(&(at - 1))
            });
            self.left_out.extend(told);
        }
        Ok(())
    }

    fn undo(&mut self, mistake: &Mistake, probability: f64) -> Result<()> {
        self.told.extend(told(mistake, &self.robot, &self.recording, &self.problem, probability));
        let mut loose = core::mem::take(&mut self.problem.loose);
        loose.extend(mistake.loose(&self.recording, &self.problem, &names(&self.robot)));
        mistake.undo(&mut self.robot, &self.problem, &mut self.recording)?;
        let slips = core::mem::take(&mut self.problem.slips);
        self.problem = arranged_again(&self.robot, &self.recording, &self.problem)?;
        leave_out_wrong_grids(&mut self.problem);
        self.problem.slips = slips;
        self.problem.loose = loose;
        if !self.problem.slips.is_empty() {
            self.problem.fit_boards()?;
        }
        mistake.on_problem(&mut self.problem)
    }
}

/// A changed robot and recording arranged as before: with the markers where they were found to be, and the same token and limit of work.
fn arranged_again(robot: &Robot, recording: &Recording, before: &Problem) -> Result<Problem> {
    let mut problem = Problem::new(robot, recording)?;
    problem.marker_sites.clone_from(&before.marker_sites);
    problem.marker_mounts.clone_from(&before.marker_mounts);
    problem.scene.mount_known.clone_from(&before.scene.mount_known);
    // A marker on another link is moved by other joints than the model says.
    problem.markers_moved();
    (problem.cancel, problem.budget) = (before.cancel.clone(), before.budget.clone());
    Ok(problem)
}

fn names(robot: &Robot) -> Vec<String> {
    robot.position_names().map(str::to_owned).collect()
}

/// The chain of mistakes of body and log that is likelier than small errors, and its probability.
fn of_the_body(session: &mut Undone, without: &[String], known: Option<&Known>) -> Result<choice::Choice> {
    let mut lines = Vec::new();
    let mut choice = chain_of_the_body(session, without, known, &mut lines)?;
    let all = choice.mistakes.len();
    // Slipped rows are found, and left out, by the stage that follows; the squares' size by the search.
    choice.mistakes.retain(|m| !matches!(m, Mistake::Rows { .. } | Mistake::Squares { .. }));
    session.unsettled = choice.mistakes.len() < all;
    session.trace.append(&mut lines);
    Ok(choice)
}

fn chain_of_the_body(
    session: &Undone,
    without: &[String],
    known: Option<&Known>,
    lines: &mut Vec<String>,
) -> Result<choice::Choice> {
    let problem = &session.problem;
    let misfit = Misfit::new(problem)?;
    let all = Session::new(problem, &misfit);
    let mut frames = spread(&all.postures, FRAMES, 1);
    // What was left out shows a mistake of a few rows.
    frames.extend(known.iter().flat_map(|known| &known.false_frames));
    frames.sort_unstable();
    frames.dedup();
    let variant = Variant::of(&session.recording, problem);
    let nominal = Chain::new(Vec::new(), variant.clone(), &misfit, &frames);
    let mut chains = Vec::new();
    // What is gross was looked at before anything was known.
    if nominal.is_gross() != known.is_some() {
        chains = grown(&all, &nominal, &frames, without, known.is_some())?;
    }
    if let Some(known) = known {
        let beside = Misfit::beside(problem, &known.deformation, &variant)?;
        let nominal = Chain::new(Vec::new(), variant, &beside, &frames);
        chains.extend(grown(&Session::new(problem, &beside), &nominal, &frames, without, true)?);
        unlike(&mut chains, 2 * BEAM);
    }
    if chains.is_empty() {
        return Ok(choice::Choice::none());
    }
    let sought = known.is_some_and(|known| known.sought);
    choice::chosen(session, &all, nominal, chains, sought, lines)
}

/// The best few chains of mistakes, grown from none.
fn grown(
    all: &Session<'_>,
    nominal: &Chain,
    frames: &[usize],
    without: &[String],
    closely: bool,
) -> Result<Vec<Chain>> {
    let problem = all.problem;
    let least_fall = if closely { 0.25 * LEAST_FALL } else { LEAST_FALL };
    let mut chains = Vec::new();
    let mut level = vec![nominal.clone()];
    loop {
        let mut next: Vec<Chain> = Vec::new();
        for chain in &level {
            next.extend(extended(all, frames, chain, without, least_fall));
        }
        // What was passed over after a stop has numbers that mean nothing.
        problem.cancel.check()?;
        // Where nothing fits each further one is as costly as it is vain.
        let costly = problem.budget.share() > A_STAGE;
        next.sort_by(|a, b| a.loss.total_cmp(&b.loss));
        unlike(&mut next, BEAM);
        let best = level.first().map_or(f64::INFINITY, |c| c.loss);
        if next.first().is_none_or(|n| n.loss > best * (1.0 - LEAST_SHARE)) {
            break;
        }
        chains.extend(next.iter().cloned());
        level = next;
        if !(level[0].is_gross() || closely) || costly {
            break;
        }
    }
    chains.sort_by(|a, b| {
        let cost = |c: &Chain| c.loss + least_fall * c.mistakes.len() as f64;
        cost(a).total_cmp(&cost(b))
    });
    unlike(&mut chains, BEAM);
    Ok(chains)
}

/// A chain with each further mistake that makes it clearly better; the best few.
fn extended(
    session: &Session<'_>,
    frames: &[usize],
    chain: &Chain,
    without: &[String],
    least_fall: f64,
) -> Vec<Chain> {
    let mut mistakes = session.of_joints(&chain.variant, chain.mistakes.is_empty());
    mistakes.extend(session.of_labels(&chain.variant));
    mistakes.extend(session.of_rows(&chain.variant));
    mistakes.extend(session.of_stops(&chain.variant));
    mistakes.extend(session.of_squares(&chain.variant));
    // Where as many as half of the markers are elsewhere it is what all of them are seen with that is wrong.
    let elsewhere = chain.mistakes.iter().filter(|m| matches!(m, Mistake::MarkerParent { .. })).count();
    if 2 * (elsewhere + 1) < session.problem.marker_sites.len().max(3) {
        mistakes.extend(mounts::elsewhere(session.problem, session.misfit, &chain.variant, frames));
    }
    mistakes.retain(|m| !without.iter().any(|w| w == m.effect()));
    let with = |mistake: &Mistake| chain.with(mistake, session, frames);
    let least = (chain.loss * (1.0 - LEAST_SHARE)).min(chain.loss - least_fall);
    let mut out: Vec<(&Mistake, Chain)> = mistakes
        .par_iter()
        .map(|m| (m, with(m)))
        .filter(|(_, c)| c.loss < chain.loss - 0.5 * least_fall)
        .collect();
    out.sort_by(|a, b| a.1.loss.total_cmp(&b.1.loss));
    out.truncate(2 * BEAM);
    let mut out: Vec<Chain> = out
        .into_iter()
        .map(|(mistake, c)| {
            let refined = session.refined(mistake, &chain.variant, frames);
            if refined == *mistake { c } else { with(&refined) }
        })
        .filter(|c| c.loss < least)
        .collect();
    out.sort_by(|a, b| a.loss.total_cmp(&b.loss));
    out.truncate(BEAM);
    out
}

/// Keeps the first few chains of which none is another's but for its numbers.
fn unlike(chains: &mut Vec<Chain>, count: usize) {
    let mut kept: Vec<Chain> = Vec::new();
    for chain in chains.drain(..) {
        if kept.len() < count && !kept.iter().any(|other| chain.is_like(other)) {
            kept.push(chain);
        }
    }
    *chains = kept;
}

impl Chain {
    /// The arranged problem with the chain's mistakes undone.
    fn problem(&self, session: &Undone) -> Result<Problem> {
        let (mut robot, mut recording) = (session.robot.clone(), session.recording.clone());
        for mistake in &self.mistakes {
            match mistake {
                // Compared with what is best for it, not with its rows left out: fewer rows always fit better.
                Mistake::LogFrozen { .. } | Mistake::Late { .. } | Mistake::Rows { .. } => {}
                _ => mistake.undo(&mut robot, &session.problem, &mut recording)?,
            }
        }
        for (frame, row) in recording.frames.iter_mut().zip(&self.variant.positions) {
            frame.commanded.clone_from(row);
        }
        let mut problem = arranged_again(&robot, &recording, &session.problem)?;
        problem.noise = session.problem.noise;
        for mistake in &self.mistakes {
            mistake.on_problem(&mut problem)?;
        }
        Ok(problem)
    }
}

/// About so many frames spread over the session, up to so many of each posture.
fn spread(postures: &[Vec<usize>], count: usize, views: usize) -> Vec<usize> {
    let wanted = (count / views).max(1);
    let step = postures.len().div_ceil(wanted).max(1);
    // One of each few, another one in turn by the golden ratio, and another view of it: a session's own rhythm (rows for which a posture
    // is held) must not be met, or rows that are off by a view or two look alike.
    let turn = |i: usize, count: usize| ((i as f64 * GOLDEN_SECTION).fract() * count as f64) as usize;
    let mut out: Vec<usize> = postures
        .chunks(step)
        .enumerate()
        .map(|(i, few)| (i, &few[turn(i, few.len())]))
        .flat_map(|(i, p)| (0..views.min(p.len())).map(move |k| p[(i + k) % p.len()]))
        .collect();
    out.sort_unstable();
    out
}
