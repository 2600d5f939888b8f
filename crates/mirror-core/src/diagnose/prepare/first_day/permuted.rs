//! Names of three markers or more that were exchanged in all frames: whole permutations, as a tracker's list that begins one marker
//! later has them.
//!
//! Each exchange of two names alone may leave more than a wrong zero does that turns a nearly symmetric tool onto itself. So the
//! whole permutation is compared with it: the one with the least loss, found by exchanges in the table of what each name's
//! observations lose as each marker.

use super::alternatives::Session;
use super::chain::Chain;
use super::mistake::Mistake;
use super::variant::{Variant, other_of};

/// The chain of exchanges that makes the best permutation of all names; none where that exchanges fewer than three.
pub(super) fn chain_of_names(session: &Session<'_>, chain: &Chain, frames: &[usize]) -> Option<Chain> {
    let names = best_names(&losses(session, &chain.variant, frames));
    if names.iter().enumerate().filter(|(name, marker)| name != *marker).count() < 3 {
        return None;
    }
    let mut at: Vec<usize> = (0..names.len()).collect();
    let (mut mistakes, mut variant) = (chain.mistakes.clone(), chain.variant.clone());
    for (name, &marker) in names.iter().enumerate() {
        let now = at[name];
        if now == marker {
            continue;
        }
        at.iter_mut().for_each(|m| *m = other_of((now, marker), *m));
        let markers = (now.min(marker), now.max(marker));
        // In all frames: the name may be of a marker that another exchange has moved there.
        let everywhere = (0..session.problem.frames.len()).collect();
        let exchange = Mistake::MarkersSwapped { markers, frames: everywhere, always: true };
        exchange.on_variant(&mut variant);
        mistakes.push(exchange);
    }
    Some(Chain::new(mistakes, variant, session.misfit, frames))
}

/// `[name][marker]`: the sum of the losses of a name's observations, were they that marker's.
fn losses(session: &Session<'_>, variant: &Variant, frames: &[usize]) -> Vec<Vec<f64>> {
    let markers = session.problem.marker_sites.len();
    let mut work = session.misfit.work();
    work.placed = session.misfit.placed(variant, frames);
    let mut out = vec![vec![0.0; markers]; markers];
    for turn in 0..markers {
        let mut turned = variant.clone();
        for &frame in frames {
            turned.labels[frame].iter_mut().for_each(|marker| *marker = (*marker + turn) % markers);
            session.misfit.of_frame(&mut work, &turned, frame, |marker, size_m| {
                // The last one is the board's.
                if marker < markers {
                    out[(marker + markers - turn) % markers][marker] += session.misfit.loss(size_m);
                }
            });
        }
    }
    out
}

/// A permutation that no exchange of two improves: the marker of each name.
pub(super) fn best_names(losses: &[Vec<f64>]) -> Vec<usize> {
    let mut names: Vec<usize> = (0..losses.len()).collect();
    let gain = |names: &[usize], a: usize, b: usize| {
        losses[a][names[a]] + losses[b][names[b]] - losses[a][names[b]] - losses[b][names[a]]
    };
    // Each exchange gains, so it ends; by rounding it might not.
    for _ in 0..losses.len().pow(2) {
        let pairs = (0..names.len()).flat_map(|b| (0..b).map(move |a| (a, b)));
        let best = pairs.map(|(a, b)| (gain(&names, a, b), a, b)).max_by(|x, y| x.0.total_cmp(&y.0));
        match best {
            Some((gained, a, b)) if gained > 0.0 => names.swap(a, b),
            _ => break,
        }
    }
    names
}
