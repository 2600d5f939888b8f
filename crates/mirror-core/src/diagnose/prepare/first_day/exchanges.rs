//! Exchanges of columns, one after the other, as few as have the same effect.
//!
//! Exchanges are permutations: five of neighbours may carry two columns to each other's places and all others back. A chain of mistakes grows by one
//! exchange at a time, so that a single swapped pair can come out of it as five. A permutation of n columns in c cycles takes n − c exchanges.

use super::variant::other_of;

/// The column of a joint's positions after exchanges of pairs of columns, one after the other.
pub(super) fn source(pairs: &[(usize, usize)], joint: usize) -> usize {
    pairs.iter().rev().fold(joint, |at, &pair| other_of(pair, at))
}

/// The fewest exchanges with the effect of these.
pub(super) fn fewest(pairs: &[(usize, usize)]) -> Vec<(usize, usize)> {
    let count = pairs.iter().map(|&(a, b)| a.max(b) + 1).max().unwrap_or(0);
    let mut now: Vec<usize> = (0..count).collect();
    let mut out = Vec::new();
    for place in 0..count {
        let wanted = source(pairs, place);
        let from = now.iter().position(|column| *column == wanted);
        if let Some(from) = from.filter(|from| *from != place) {
            now.swap(place, from);
            out.push((place, from));
        }
    }
    out
}
