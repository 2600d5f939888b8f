//! What was left out as false lies together, or anywhere.

use super::gap_world::{Plan, World};
use crate::diagnose::assessment::came_back::came_back;
use crate::diagnose::assessment::false_together::lies_together;
use crate::diagnose::data::diagnosis::Data;
use crate::diagnose::data::left_out::{LeftOut, Reason};
use crate::diagnose::model::problem::Problem;
use crate::robot::Robot;

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

/// What is warned of where these observations (posture, view, marker) of a session of 30 postures in 3 views are left out.
fn warned(left_out: &[(usize, usize, &str)]) -> Option<String> {
    let world = World::new(4, false);
    let recording =
        world.record(&Plan { postures: 30, views: 3, noise_px: 0.05, seed: 1, wrong: Vec::new() });
    let mut problem = Problem::new(&Robot::from_urdf_str(&world.urdf()).unwrap(), &recording).unwrap();
    let of = |&(posture, view, marker): &(usize, usize, &str)| LeftOut {
        frame: recording.frames[3 * posture + view].number,
        target: marker.to_owned(),
        deviations: Some(20.0),
        why: Reason::FarFromModel,
    };
    for &(posture, view, name) in left_out {
        let marker = recording.markers.iter().position(|m| m.name == name);
        problem.frames[3 * posture + view].others.retain(|o| o.marker() != marker);
    }
    came_back(&problem, &Data { left_out: left_out.iter().map(of).collect(), ..Data::default() }, None)
}

fn all_views(postures: core::ops::Range<usize>, marker: &str) -> Vec<(usize, usize, &str)> {
    postures.flat_map(|p| (0..3).map(move |view| (p, view, marker))).collect()
}

#[test]
fn a_marker_that_is_touched_is_told_in_postures_whose_views_are_no_evidence_of_their_own() {
    let told = warned(&all_views(10..15, "l_hand")).unwrap();
    assert!(told.starts_with("l_hand was left out in 5 of the 5 postures from frame 30 to 42"), "{told}");
    // Two postures, six frames; and one view of three, which the others contradict.
    assert_eq!(warned(&all_views(10..12, "l_hand")), None);
    let one_view: Vec<_> = (10..16).map(|posture| (posture, 1, "l_hand")).collect();
    assert_eq!(warned(&one_view), None);
}

#[test]
fn a_marker_is_not_touched_where_its_arm_is_elsewhere() {
    let (hand, forearm) = (all_views(10..15, "l_hand"), all_views(10..15, "l_fore"));
    assert_eq!(warned(&[hand.clone(), forearm].concat()), None);
    // No joint moves the other arm with it.
    let told = warned(&[hand, all_views(10..15, "r_hand")].concat());
    assert!(told.is_some_and(|told| told.contains("_hand was left out")));
}
