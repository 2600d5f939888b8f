//! What was left out under the names that the session's file has: exchanged names are undone before a model judges an observation.

use crate::diagnose::data::diagnosis::{Cause, Data};
use crate::diagnose::data::left_out::{LeftOut, Reason};

/// Puts the names of what was left out with exchanged names undone back to those of the file; `mistakes` in the order in which
/// they were undone.
pub(crate) fn as_in_file(data: &mut Data, mistakes: &[Cause]) {
    let exchanges: Vec<Exchange<'_>> = mistakes.iter().filter_map(Exchange::of).collect();
    if exchanges.is_empty() {
        return;
    }
    for left in data.left_out.iter_mut().filter(|left| is_of_a_model(left)) {
        // The last one was undone on top of the others.
        for exchange in exchanges.iter().rev().filter(|e| e.is_in(left.frame)) {
            if let Some(other) = exchange.other(&left.target) {
                left.target = other.to_owned();
            }
        }
    }
    data.left_out.sort_by(|a, b| (a.frame, &a.target).cmp(&(b.frame, &b.target)));
}

/// Whether it was left out by what a model predicts for its name, or by its row: after names were put right.
fn is_of_a_model(left: &LeftOut) -> bool {
    matches!(
        left.why,
        Reason::FarFromModel
            | Reason::FarFromAll(_)
            | Reason::WholeRow(_)
            | Reason::OutOfSight
            | Reason::NoBoard
            | Reason::OtherRow
    )
}

/// Two markers' names that are exchanged, in these frames, or in all where none is told.
struct Exchange<'a> {
    markers: [&'a str; 2],
    frames: &'a [i64],
}

impl<'a> Exchange<'a> {
    fn of(mistake: &'a Cause) -> Option<Self> {
        let (a, b) = mistake.at.split_once("<->").filter(|_| mistake.effect == "markers_swapped")?;
        let markers = [a.strip_prefix("marker:")?, b.strip_prefix("marker:")?];
        Some(Self { markers, frames: &mistake.frames })
    }

    fn is_in(&self, frame: i64) -> bool {
        self.frames.is_empty() || self.frames.contains(&frame)
    }

    fn other(&self, name: &str) -> Option<&'a str> {
        let [a, b] = self.markers;
        if name == a { Some(b) } else { (name == b).then_some(a) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn swapped(a: &str, b: &str, frames: &[i64]) -> Cause {
        Cause {
            kind: "data".into(),
            effect: "markers_swapped".into(),
            at: format!("marker:{a}<->marker:{b}"),
            probability: 0.99,
            stability: None,
            alternatives: Vec::new(),
            parameters: Default::default(),
            words: String::new(),
            rms_shift: 1.0,
            frames: frames.to_vec(),
            members: Vec::new(),
        }
    }

    fn names(left_out: &[(i64, &str, Reason)], mistakes: &[Cause]) -> Vec<(i64, String)> {
        let of = |(frame, target, why): &(i64, &str, Reason)| LeftOut {
            frame: *frame,
            target: (*target).to_owned(),
            deviations: None,
            why: why.clone(),
        };
        let mut data = Data { left_out: left_out.iter().map(of).collect(), ..Data::default() };
        as_in_file(&mut data, mistakes);
        data.left_out.into_iter().map(|l| (l.frame, l.target)).collect()
    }

    #[test]
    fn what_is_left_out_has_the_name_that_its_row_has() {
        let far = || Reason::FarFromModel;
        let out = [(1, "a", far()), (2, "a", far()), (2, "c", far()), (3, "b", Reason::Repeated)];
        let told =
            |names: &[(i64, &str)]| names.iter().map(|(f, n)| (*f, (*n).to_owned())).collect::<Vec<_>>();
        // In one frame; and what was left out before any name was looked at keeps its own.
        assert_eq!(names(&out, &[swapped("a", "b", &[2])]), told(&[(1, "a"), (2, "b"), (2, "c"), (3, "b")]));
        // A cycle: a was written as b, and b then as c.
        let cycle = [swapped("b", "c", &[]), swapped("a", "b", &[])];
        assert_eq!(names(&out, &cycle), told(&[(1, "c"), (2, "b"), (2, "c"), (3, "b")]));
        assert_eq!(names(&out, &[]), told(&[(1, "a"), (2, "a"), (2, "c"), (3, "b")]));
    }
}
