//! Chains of mistakes: a session with several mistakes undone. The best few chains grow from none, one mistake after
//! another.

use super::alternatives::Session;
use super::misfit::{GROSS, LEAST_FALL, Misfit};
use super::mistake::Mistake;
use super::mounts;
use super::undone::{Undone, arranged_again};
use super::variant::Variant;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::model::work_budget::MUCH;
use crate::diagnose::principles::{A_GAP, Size, Threshold};
use crate::error::Result;
use crate::statistics::GOLDEN_SECTION;
use rayon::prelude::*;

/// Frames on which alternatives are scored, and on which they are verified.
pub(super) const FRAMES: Size = 64;
/// How many of the best chains of mistakes are gone on from and verified.
pub(super) const BEAM: Size = 4;
/// The same for the marker that is farthest off: one of several may be on another link.
const GROSS_OF_ONE: Threshold = 2.0 * GROSS;
/// The share that makes a gap, by which the mean loss must fall too.
const LEAST_SHARE: Threshold = A_GAP - 1.0;
/// A chain of mistakes with the session as it would be.
#[derive(Clone)]
pub(super) struct Chain {
    pub mistakes: Vec<Mistake>,
    pub variant: Variant,
    pub loss: f64,
    /// The same in the rows in which its mistakes leave no position unknown, and that of the marker which has the largest
    /// there: what it leaves.
    left: (f64, f64),
}

impl Chain {
    pub fn new(mistakes: Vec<Mistake>, variant: Variant, misfit: &Misfit<'_>, frames: &[usize]) -> Self {
        Self::below(mistakes, variant, misfit, frames, f64::INFINITY)
    }

    /// The same, with an infinite loss unless it is below a limit.
    fn below(
        mistakes: Vec<Mistake>,
        variant: Variant,
        misfit: &Misfit<'_>,
        frames: &[usize],
        limit: f64,
    ) -> Self {
        let all = misfit.mean_losses_below(&variant, frames, limit);
        let known = known_in(&mistakes, variant.positions.len(), frames);
        let fewer = all.0.is_finite() && known.len() < frames.len();
        let left = if fewer { misfit.mean_losses(&variant, &known) } else { all };
        Self { mistakes, variant, loss: all.0, left }
    }

    /// With one more mistake, which may be one with the last.
    pub fn with(&self, mistake: &Mistake, session: &Session<'_>, frames: &[usize]) -> Self {
        self.with_below(mistake, session, frames, f64::INFINITY)
    }

    /// The same, with an infinite loss unless it is below a limit.
    fn with_below(&self, mistake: &Mistake, session: &Session<'_>, frames: &[usize], limit: f64) -> Self {
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
        Self::below(mistakes, variant, session.misfit, frames, limit)
    }

    /// The same chain by another loss.
    pub fn at(&self, misfit: &Misfit<'_>, frames: &[usize]) -> Self {
        Self::new(self.mistakes.clone(), self.variant.clone(), misfit, frames)
    }

    /// The same mistakes except one, from a chain that has none.
    pub fn without(&self, which: usize, none: &Self, session: &Session<'_>, frames: &[usize]) -> Self {
        let others = self.mistakes.iter().enumerate().filter(|(i, _)| *i != which);
        others.fold(none.clone(), |chain, (_, mistake)| chain.with(mistake, session, frames))
    }

    /// Whether both have the same mistakes, apart from their parameters.
    pub fn is_like(&self, other: &Self) -> bool {
        self.mistakes.len() == other.mistakes.len()
            && self.mistakes.iter().all(|m| other.mistakes.iter().any(|o| o.is_like(m)))
    }

    /// Whether it has a mistake without a public name.
    pub fn has_no_word(&self) -> bool {
        self.mistakes.iter().any(Mistake::has_no_word)
    }

    /// Whether something is left that is more than small errors, of one marker alone too.
    pub fn is_gross(&self) -> bool {
        self.left.0 > GROSS || self.left.1 > GROSS_OF_ONE
    }
}

/// The frames, of some of a session's rows, in which a delay leaves every position known; a late column's last ones are in
/// no row of the log, whatever is seen there. All of them if none would be left.
pub(super) fn known_in(mistakes: &[Mistake], rows: usize, frames: &[usize]) -> Vec<usize> {
    let late = mistakes.iter().filter(|m| matches!(m, Mistake::Late { .. }));
    let unknown: Vec<usize> = late.flat_map(|m| m.not_known(rows)).map(|(frame, _)| frame).collect();
    let known: Vec<usize> = frames.iter().copied().filter(|f| !unknown.contains(f)).collect();
    if known.is_empty() { frames.to_vec() } else { known }
}

/// By this the mean loss must fall with each mistake: in a closer look by less.
pub(super) fn least_fall(closely: bool) -> f64 {
    if closely { 0.25 * LEAST_FALL } else { LEAST_FALL }
}

/// The best few chains of mistakes, grown from none.
pub(super) fn grown(
    all: &Session<'_>,
    nominal: &Chain,
    frames: &[usize],
    without: &[String],
    closely: bool,
) -> Result<Vec<Chain>> {
    let problem = all.problem;
    let least_fall = least_fall(closely);
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
        let costly = problem.budget.share() > MUCH;
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
pub(super) fn extended(
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
    mistakes.extend(session.of_points(&chain.variant));
    // If half of the markers or more are displaced, their common observer is wrong.
    let elsewhere = chain.mistakes.iter().filter(|m| matches!(m, Mistake::MarkerParent { .. })).count();
    if 2 * (elsewhere + 1) < session.problem.marker_sites.len().max(3) {
        mistakes.extend(mounts::elsewhere(session.problem, session.misfit, &chain.variant, frames));
    }
    mistakes.retain(|m| !without.iter().any(|w| w == m.effect()));
    let with = |mistake: &Mistake| chain.with(mistake, session, frames);
    let least = (chain.loss * (1.0 - LEAST_SHARE)).min(chain.loss - least_fall);
    let enough = chain.loss - 0.5 * least_fall;
    let mut out: Vec<(&Mistake, Chain)> = mistakes
        .par_iter()
        .map(|m| (m, chain.with_below(m, session, frames, enough)))
        .filter(|(_, c)| c.loss < enough)
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

/// Keeps the first few chains that differ by more than their parameters.
pub(super) fn unlike(chains: &mut Vec<Chain>, count: usize) {
    let mut kept: Vec<Chain> = Vec::new();
    for chain in chains.drain(..) {
        if kept.len() < count && !kept.iter().any(|other| chain.is_like(other)) {
            kept.push(chain);
        }
    }
    *chains = kept;
}

impl Chain {
    /// The arranged problem with the chain's mistakes undone. The unknown frame of measured points starts from some frames:
    /// free positions are known in these only.
    pub fn problem(&self, session: &Undone, frames: &[usize]) -> Result<Problem> {
        let (mut robot, mut recording) = (session.robot.clone(), session.recording.clone());
        for mistake in &self.mistakes {
            match mistake {
                // Compared with its best alternative, not with its rows left out: fewer rows always fit better.
                Mistake::LogFrozen { .. }
                | Mistake::Late { .. }
                | Mistake::Rows { .. }
                | Mistake::ColumnLost { .. } => {}
                _ => mistake.undo(&mut robot, &session.problem, &mut recording)?,
            }
        }
        for (frame, row) in recording.frames.iter_mut().zip(self.variant.positions.iter()) {
            frame.commanded = row.to_vec();
        }
        let mut problem = arranged_again(&robot, &recording, &session.problem)?;
        problem.noise = session.problem.noise;
        if self.has_no_word()
            && let Some(placed) = Misfit::new(&session.problem)?.placed(&self.variant, frames)
        {
            problem.unknown_frame = Some(placed.pose);
        }
        for mistake in &self.mistakes {
            mistake.on_problem(&mut problem)?;
        }
        Ok(problem)
    }
}

/// About so many frames spread over the session, up to so many of each posture.
pub(super) fn spread(postures: &[Vec<usize>], count: usize, views: usize) -> Vec<usize> {
    let wanted = (count / views).max(1);
    let step = postures.len().div_ceil(wanted).max(1);
    // One of each few, varied by the golden ratio, and with another view: the sample must not be in phase with a
    // session's own period (rows for which a posture is held), otherwise rows that are off by a view or two look
    // alike.
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
