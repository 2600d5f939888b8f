//! The most probable of several chains of mistakes and of none, with small errors allowed for.
//!
//! A mistake with a free parameter must gain so much over small errors that no slightly wrong law could have caused
//! it. For a mistake without a free parameter the question is which is more probable: that mistake, or a large error
//! that happens to have the same effect (a marker that is mounted exactly where a quarter turn of the last joint
//! brings it). Then prior odds decide, and the less probable one is reported as an alternative. That a marker happens
//! to be there is a coincidence, which random effects do not see: they displace all markers in both models. So where
//! the odds are close, markers are also in place in each model, one half of its prior for each.

use super::alternatives::Session;
use super::chain::{Chain, FRAMES, known_in, spread, unlike};
use super::coupled::coupled;
use super::friction_everywhere::{USUAL_WIDTH, friction_columns};
use super::lost::free_columns;
use super::misfit::Misfit;
use super::mistake::Mistake;
use super::posture_scatter;
use super::reported::reported;
use super::spoilt::node_of;
use super::undone::{Doubt, Undone, names};
use super::variant::Variant;
use super::verify::{Tolerant, smaller};
use crate::diagnose::data::diagnosis::{Alternative, Cause};
use crate::diagnose::likelihood::probability::against;
use crate::diagnose::model::elementary::Column;
use crate::diagnose::model::mistake_parameters::MistakeParameter;
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::{BEYOND_DOUBT, LEAST_LOG_ODDS, LOG_PRIOR_STRUCTURE, TEMPER, UNTHOUGHT_OF};
use crate::error::Result;

/// The mistakes that are undone, none where small errors are more probable.
pub(super) struct Choice {
    pub mistakes: Vec<Mistake>,
    pub probability: f64,
    /// The alternatives of these mistakes.
    pub instead: Vec<Alternative>,
    /// The causes whose alternatives these mistakes are, if none is undone.
    pub doubts: Vec<Doubt>,
}

impl Choice {
    /// No mistake.
    pub fn none() -> Self {
        Self { mistakes: Vec::new(), probability: 0.0, instead: Vec::new(), doubts: Vec::new() }
    }
}

/// The most probable of the chains and of none. `sought`: strong evidence is sufficient for a mistake.
///
/// # Errors
/// Invalid parameters of camera or mirror.
pub(super) fn chosen(
    session: &Undone,
    all: &Session<'_>,
    nominal: Chain,
    chains: Vec<Chain>,
    sought: bool,
    lines: &mut Vec<String>,
) -> Result<Choice> {
    let scored_on = spread(&all.postures, FRAMES, 1);
    let mut tried: Vec<Chain> = core::iter::once(nominal.clone()).chain(chains).collect();
    // Displaced mounts need further mistakes at the model's: the first of each chain may be enough beside small errors.
    let longer = tried.iter().filter(|chain| chain.mistakes.len() > 1);
    let first: Vec<Chain> = longer.map(|c| nominal.with(&c.mistakes[0], all, &scored_on)).collect();
    tried.extend(first);
    unlike(&mut tried, usize::MAX);
    let mut weighed = Weighed::new(session, tried, all)?;
    // A small cause may explain what a mistake with free parameters absorbs: the best chain is compared without
    // each of its mistakes.
    let (mut values, mut log_odds) = loop {
        let (values, log_odds) = weighed.log_odds(sought);
        let likeliest = |which: &dyn Fn(&Chain) -> bool| {
            let those = (1..log_odds.len()).filter(|&i| which(&weighed.chains[i]));
            those.max_by(|&a, &b| log_odds[a].total_cmp(&log_odds[b]))
        };
        let mut best: Vec<usize> = likeliest(&|_| true).into_iter().collect();
        // Free positions must not win because the named chain has a mistake too many.
        best.extend(likeliest(&|chain| !chain.has_no_word()).filter(|i| !best.contains(i)));
        let shorter = best.iter().flat_map(|&i| {
            let mistakes = weighed.chains[i].mistakes.len();
            (0..mistakes).filter(move |_| mistakes > 1).map(move |k| (i, k))
        });
        let shorter = shorter.map(|(i, k)| weighed.chains[i].without(k, &nominal, all, &scored_on));
        let mut further: Vec<Chain> =
            shorter.filter(|chain| !weighed.chains.iter().any(|tried| tried.is_like(chain))).collect();
        unlike(&mut further, usize::MAX);
        if further.is_empty() {
            break (values, log_odds);
        }
        for chain in further {
            weighed.add(chain)?;
        }
    };
    weighed.small_errors_from_afar(&mut values, &mut log_odds, sought)?;
    weighed.beside_friction(&mut values, &mut log_odds, sought)?;
    let coupling = weighed.beside_a_coupling(&mut values, &mut log_odds, sought)?;
    weighed.with_markers_in_place(&mut values, &mut log_odds)?;
    weighed.beside_scattered_postures(&mut log_odds)?;
    let best = best_of(&log_odds);
    let mistakes = weighed.with_delays(best);
    let Weighed { chains: tried, fits, .. } = weighed;
    for (chain, value) in tried.iter().zip(&values) {
        let names: Vec<&str> = chain.mistakes.iter().map(Mistake::effect).collect();
        lines.push(format!(
            "mistakes [{}]: loss {:.3}, log evidence {value:.1}",
            names.join(", "),
            chain.loss
        ));
    }
    let others: Vec<f64> =
        (0..tried.len()).filter(|&i| i != best).map(|i| log_odds[i] - log_odds[best]).collect();
    let probability = against(&others);
    let of = |i: usize| probability * (TEMPER * (log_odds[i] - log_odds[best])).exp();
    let small = coupling.or_else(|| fits[0].as_ref().and_then(Tolerant::largest));
    // A chain of one mistake that is not out of the question, as it would be reported.
    let alone = |i: usize| {
        let one = tried[i].mistakes.first().filter(|_| tried[i].mistakes.len() == 1);
        let causes = one.map(|m| reported(m, &session.robot, &session.recording, &session.problem, of(i)));
        let causes = causes.into_iter().flatten().filter(|c| c.probability >= UNTHOUGHT_OF);
        let told = |c: Cause| Alternative { effect: c.effect, at: c.at, probability: c.probability };
        causes.map(told).collect::<Vec<_>>()
    };
    if best == 0 {
        let mistakes = (1..tried.len()).flat_map(alone);
        let doubts = mistakes.filter_map(|mistake| Some(Doubt { of: small.clone()?, mistake }));
        return Ok(Choice { doubts: doubts.collect(), ..Choice::none() });
    }
    let mut instead: Vec<Alternative> = small
        .filter(|_| of(0) >= UNTHOUGHT_OF)
        .map(|(effect, at)| Alternative { effect, at, probability: of(0) })
        .into_iter()
        .collect();
    if mistakes.len() == 1 {
        instead.extend((1..tried.len()).filter(|&i| i != best).flat_map(alone));
        instead.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    }
    Ok(Choice { mistakes, probability, instead, doubts: Vec::new() })
}

/// Chains of mistakes, the first without any, each fitted with all small errors.
struct Weighed<'a> {
    session: &'a Undone,
    frames: Vec<usize>,
    chains: Vec<Chain>,
    /// None for an invalid chain.
    fits: Vec<Option<Tolerant>>,
}

/// How a problem is fitted on some frames: with further columns, beside small errors.
type FittedBy = fn(&Problem, &[usize], Noise, Vec<(Column, f64, f64)>) -> Result<Tolerant>;

impl<'a> Weighed<'a> {
    fn new(session: &'a Undone, chains: Vec<Chain>, all: &Session<'_>) -> Result<Self> {
        let frames = compared_on(all, &chains);
        let mut out = Self { session, frames, chains: Vec::new(), fits: Vec::new() };
        for chain in chains {
            out.add(chain)?;
        }
        Ok(out)
    }

    fn add(&mut self, chain: Chain) -> Result<()> {
        self.fits.push(self.fitted(&chain, Tolerant::fitted_with)?);
        self.chains.push(chain);
        Ok(())
    }

    /// A chain fitted with small errors; none for an invalid chain.
    fn fitted(&self, chain: &Chain, by: FittedBy) -> Result<Option<Tolerant>> {
        let problem = &self.session.problem;
        problem.cancel.check()?;
        let fitted = |p: Problem| by(&p, &self.frames, problem.noise, self.free(chain, &p));
        Ok(chain.problem(self.session, &self.frames).and_then(fitted).ok())
    }

    /// What is fitted of a chain besides small errors: free positions, and by what a delay is still off. No small error is like
    /// one, and its first estimate was made with all mounts as the model has them.
    fn free(&self, chain: &Chain, problem: &Problem) -> Vec<(Column, f64, f64)> {
        let mut free = free_columns(chain, problem, &self.frames);
        let delays = chain.mistakes.iter().flat_map(|m| self.delays(m, problem));
        free.extend(delays.map(|delay| (delay.column, delay.std, 0.0)));
        free
    }

    /// By what a delay is off, rows: one parameter for each column that is late.
    fn delays(&self, mistake: &Mistake, problem: &Problem) -> Vec<MistakeParameter> {
        if !matches!(mistake, Mistake::Late { .. }) {
            return Vec::new();
        }
        mistake.free_parameters(&self.session.recording, problem, &names(&self.session.robot))
    }

    /// The mistakes of a chain with their delays as fitted beside all small errors: what is added to them later is so small that
    /// its first order is enough. Of several columns the mean by inverse variances.
    fn with_delays(&self, which: usize) -> Vec<Mistake> {
        let mut mistakes = self.chains[which].mistakes.clone();
        let Some(fit) = &self.fits[which] else { return mistakes };
        let counts: Vec<usize> = mistakes.iter().map(|m| self.delays(m, fit.problem()).len()).collect();
        let further = fit.further();
        let mut at = further.len().saturating_sub(counts.iter().sum());
        for (mistake, count) in mistakes.iter_mut().zip(counts) {
            let own = &further[at..at + count];
            at += count;
            let weight: f64 = own.iter().map(|d| d.1.powi(-2)).sum();
            let more = own.iter().map(|d| d.0 * d.1.powi(-2)).sum::<f64>() / weight;
            if let Mistake::Late { rows, .. } = mistake
                && more.is_finite()
            {
                // Within the rows that it lies between, on its side of their middle: from there on the positions are found from
                // the log's other end.
                let (low, high) = (rows.floor(), rows.ceil());
                let middle = low + 0.5;
                *rows = if *rows > middle {
                    (*rows + more).clamp(middle + SOLVER.difference, high - SOLVER.difference)
                } else {
                    (*rows + more).clamp(low + SOLVER.difference, middle)
                };
            }
        }
        mistakes
    }

    /// Log evidence of a chain at a noise; of an invalid one −∞.
    fn log_evidence(&mut self, which: usize, noise: Noise) -> Result<f64> {
        self.fits[which].as_mut().map_or(Ok(f64::NEG_INFINITY), |fit| fit.log_evidence(noise))
    }

    /// The smallest noise that any chain leaves.
    fn noise(&self) -> Noise {
        let least = self.session.problem.noise;
        self.fits.iter().flatten().map(|f| f.noise).reduce(smaller).unwrap_or(least)
    }

    /// Weighs the chains that are close to the best also with all markers in place, where one of their mistakes has no
    /// number: `ln ½ (eᵃ + eᵇ)` of the two log evidences.
    fn with_markers_in_place(&self, values: &mut [f64], log_odds: &mut [f64]) -> Result<()> {
        let best = log_odds.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let close: Vec<usize> = (0..log_odds.len()).filter(|&i| log_odds[i] > best - BEYOND_DOUBT).collect();
        let has_one = |&i: &usize| self.chains[i].mistakes.iter().any(Mistake::has_no_number);
        if close.len() < 2 || !close.iter().any(has_one) {
            return Ok(());
        }
        let noise = self.noise();
        for i in close {
            let mut in_place = self.fitted(&self.chains[i], Tolerant::with_markers_in_place)?;
            let value = in_place.as_mut().and_then(|fit| fit.log_evidence(noise).ok());
            let gained = value.map_or(0.0, |value| half_each(value - values[i]));
            values[i] += gained;
            log_odds[i] += gained;
        }
        Ok(())
    }

    /// Where a mistake seems the most probable: fits small errors without any from a scale at which no marker seems false, if that explains more.
    fn small_errors_from_afar(
        &mut self,
        values: &mut Vec<f64>,
        log_odds: &mut Vec<f64>,
        sought: bool,
    ) -> Result<()> {
        if best_of(log_odds) == 0 {
            return Ok(());
        }
        let Some(mut far) = self.fitted(&self.chains[0], Tolerant::from_afar)? else { return Ok(()) };
        let noise = smaller(self.noise(), far.noise);
        let near = self.log_evidence(0, noise)?;
        if far.log_evidence(noise)? > near {
            self.fits[0] = Some(far);
            (*values, *log_odds) = self.log_odds(sought);
        }
        Ok(())
    }

    /// Where a delay of all joints seems the most probable: gives none of the mistakes friction in every joint beside all small errors,
    /// if that is more probable.
    fn beside_friction(
        &mut self,
        values: &mut Vec<f64>,
        log_odds: &mut Vec<f64>,
        sought: bool,
    ) -> Result<()> {
        let best = best_of(log_odds);
        if !matches!(self.chains[best].mistakes.as_slice(), [Mistake::Late { joint: None, .. }]) {
            return Ok(());
        }
        let problem = &self.session.problem;
        let columns = friction_columns(problem, &self.chains[0].variant);
        let free: Vec<_> = columns.into_iter().map(|column| (column, USUAL_WIDTH, 0.0)).collect();
        let mut friction = Tolerant::fitted_with(problem, &self.frames, problem.noise, free)?;
        let noise = smaller(self.noise(), friction.noise);
        let late = self.log_evidence(best, noise)?;
        if friction.log_evidence(noise)? > late + log_prior(&self.chains[best].mistakes, sought) {
            self.fits[0] = Some(friction);
            (*values, *log_odds) = self.log_odds(sought);
        }
        Ok(())
    }

    /// Where a mistake seems the most probable: gives none of them the likeliest coupling beside all small errors, if that is
    /// more probable, also than the mistake with a coupling of its own. Returns the coupling's name and place.
    fn beside_a_coupling(
        &mut self,
        values: &mut Vec<f64>,
        log_odds: &mut Vec<f64>,
        sought: bool,
    ) -> Result<Option<(String, String)>> {
        let best = best_of(log_odds);
        let least = self.session.problem.noise;
        let beside = |fit: &Option<Tolerant>| fit.as_ref().map_or(Ok(None), |fit| coupled(fit, least));
        if best == 0 {
            return Ok(None);
        }
        let Some(mut of_none) = beside(&self.fits[0])? else { return Ok(None) };
        let noise = smaller(self.noise(), of_none.fit.noise);
        let prior = log_prior(&self.chains[best].mistakes, sought);
        let rival = self.log_evidence(best, noise)?;
        let odds = of_none.fit.log_evidence(noise)? + of_none.log_prior;
        if odds <= rival + prior {
            return Ok(None);
        }
        if let Some(mut with_mistake) = beside(&self.fits[best])? {
            let noise = smaller(noise, with_mistake.fit.noise);
            let rival = with_mistake.fit.log_evidence(noise)? + with_mistake.log_prior + prior;
            if of_none.fit.log_evidence(noise)? + of_none.log_prior <= rival {
                return Ok(None);
            }
        }
        self.fits[0] = Some(of_none.fit);
        (*values, *log_odds) = self.log_odds(sought);
        values[0] += of_none.log_prior;
        log_odds[0] += of_none.log_prior;
        Ok(Some(of_none.told))
    }

    /// Where a joint seems to have another zero from a row on: that is out of the question if the joint's scatter from posture to
    /// posture may be the reason ([`posture_scatter`]).
    fn beside_scattered_postures(&self, log_odds: &mut [f64]) -> Result<()> {
        loop {
            let best = best_of(log_odds);
            let lost = self.chains[best].mistakes.iter().find_map(|mistake| match *mistake {
                Mistake::ZeroLost { joint, first, offset } => Some((joint, first, offset)),
                _ => None,
            });
            let (Some((joint, first, offset)), Some(fit)) = (lost, &self.fits[best]) else { return Ok(()) };
            let Some(node) = node_of(fit.problem(), joint) else { return Ok(()) };
            let change = offset * fit.problem().scene.body.nodes[node].command.1;
            if log_odds[best] == f64::NEG_INFINITY || posture_scatter::is_beyond(fit, node, (first, change))?
            {
                return Ok(());
            }
            log_odds[best] = f64::NEG_INFINITY;
        }
    }

    /// Log evidence of each chain at the smallest noise that any of them leaves, and the same with the mistakes' prior.
    fn log_odds(&mut self, sought: bool) -> (Vec<f64>, Vec<f64>) {
        let noise = self.noise();
        let evidence = |f: &mut Option<Tolerant>| f.as_mut().and_then(|f| f.log_evidence(noise).ok());
        let values: Vec<f64> =
            self.fits.iter_mut().map(|f| evidence(f).unwrap_or(f64::NEG_INFINITY)).collect();
        let prior = |chain: &Chain| log_prior(&chain.mistakes, sought);
        let mut log_odds: Vec<f64> =
            values.iter().zip(&self.chains).map(|(value, chain)| value + prior(chain)).collect();
        // Half of a limb's postures may count as false for a sign that only the other half has: where free positions
        // explain everything, what leaves a gross remainder is no alternative.
        if self.chains.iter().any(Chain::has_no_word) {
            let left: Vec<bool> = self.fits.iter().zip(&self.chains).map(leaves_gross).collect();
            if left.iter().zip(&self.chains).any(|(gross, chain)| !gross && chain.has_no_word()) {
                log_odds.iter_mut().zip(left).filter(|l| l.1).for_each(|l| *l.0 = f64::NEG_INFINITY);
            }
        }
        (values, log_odds)
    }
}

/// The most probable; the first, without a mistake, where there is none.
fn best_of(log_odds: &[f64]) -> usize {
    (0..log_odds.len()).max_by(|&a, &b| log_odds[a].total_cmp(&log_odds[b])).unwrap_or(0)
}

/// `ln ½ (1 + eᵈ)`.
fn half_each(difference: f64) -> f64 {
    difference.max(0.0) + (0.5 + 0.5 * (-difference.abs()).exp()).ln()
}

/// Whether a chain leaves something gross with all small errors as fitted.
fn leaves_gross((fit, chain): (&Option<Tolerant>, &Chain)) -> bool {
    let left = |fit: &Tolerant| {
        let misfit = Misfit::given(fit.problem(), &fit.deformation()).ok()?;
        // Its mistakes are undone in the problem; positions alone are its own.
        let variant = Variant::at(chain.variant.positions.clone(), fit.problem());
        let known = known_in(&chain.mistakes, variant.positions.len(), &fit.frames());
        Some(Chain::new(Vec::new(), variant, &misfit, &known))
    };
    fit.as_ref().and_then(left).is_none_or(|left| left.is_gross())
}

/// The frames on which chains are compared: spread over the session, and those in which one of the chains has names
/// exchanged. If these are few, the sample might contain none of them, and the mistake would gain nothing.
pub(super) fn compared_on(all: &Session<'_>, tried: &[Chain]) -> Vec<usize> {
    let mut frames = spread(&all.postures, FRAMES, 2);
    for mistake in tried.iter().flat_map(|chain| &chain.mistakes) {
        if let Mistake::MarkersSwapped { frames: exchanged, .. } = mistake {
            frames.extend(exchanged.iter().step_by(exchanged.len().div_ceil(FRAMES).max(1)));
        }
    }
    frames.sort_unstable();
    frames.dedup();
    frames
}

/// Log prior of mistakes against none: a mistake with free parameters can absorb part of the error of any slightly
/// wrong law, one without cannot.
fn log_prior(mistakes: &[Mistake], sought: bool) -> f64 {
    let of_one = |m: &Mistake| match () {
        () if sought => -LEAST_LOG_ODDS,
        () if m.has_no_number() => LOG_PRIOR_STRUCTURE,
        () => -BEYOND_DOUBT,
    };
    mistakes.iter().map(of_one).sum()
}
