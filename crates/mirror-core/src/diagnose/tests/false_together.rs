//! What was left out as false lies together, or anywhere.

use super::gap_world::{Plan, World};
use crate::diagnose::assessment::false_together::lies_together;
use crate::diagnose::data::diagnosis::Data;
use crate::diagnose::data::left_out::{LeftOut, Reason};

/// Whether these observations (frame, marker) of a session of 60 frames and six markers lie together.
fn together(left_out: &[(usize, usize)]) -> bool {
    let world = World::new(4, false);
    let recording =
        world.record(&Plan { postures: 30, views: 2, noise_px: 0.05, seed: 1, wrong: Vec::new() });
    let of = |&(frame, marker): &(usize, usize)| LeftOut {
        frame: recording.frames[frame].number,
        target: recording.markers[marker].name.clone(),
        deviations: Some(20.0),
        why: Reason::FarFromModel,
    };
    lies_together(&recording, &Data { left_out: left_out.iter().map(of).collect(), ..Data::default() })
}

#[test]
fn blunders_anywhere_are_chance_and_a_run_or_pairs_are_not() {
    let anywhere: Vec<(usize, usize)> = (0..9).map(|k| (7 * k % 60, (5 * k + k / 3) % 6)).collect();
    assert!(!together(&anywhere) && !together(&[]));
    let a_run: Vec<(usize, usize)> = (20..29).map(|frame| (frame, 3)).collect();
    assert!(together(&a_run));
    let pairs: Vec<(usize, usize)> = (0..6).flat_map(|k| [(11 * k % 60, 1), (11 * k % 60, 4)]).collect();
    assert!(together(&pairs) && !together(&pairs[..2]));
}
