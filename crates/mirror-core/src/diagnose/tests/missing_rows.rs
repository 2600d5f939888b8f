//! The warning for rows that are missing from the log.

use super::gap_world::{Plan, World};
use crate::diagnose::report::missing_rows::rows_are_missing;

#[test]
fn deleted_rows_are_told_and_other_ways_to_number_rows_are_not() {
    let world = World::new(4, false);
    let whole = world.record(&Plan { postures: 40, views: 2, ..Plan::default() });
    let without = |deleted: &dyn Fn(i64) -> bool| {
        let mut recording = whole.clone();
        recording.frames.retain(|f| !deleted(f.posture));
        recording
    };
    assert_eq!(rows_are_missing(&whole), None);
    // One deleted posture of forty is no reason for doubt.
    assert_eq!(rows_are_missing(&without(&|posture| posture == 7)), None);
    let mut thinned = without(&|posture| posture % 4 == 1);
    let told = rows_are_missing(&thinned).unwrap();
    assert!(told.contains("before 10 of 29 changes of the posture"), "{told}");
    thinned.ordered = false;
    assert_eq!(rows_are_missing(&thinned), None);
    // Numbers of a film's pictures, or of a robot that counts in tens.
    let mut by_tens = whole.clone();
    by_tens.frames.iter_mut().for_each(|f| f.number *= 10);
    assert_eq!(rows_are_missing(&by_tens), None);
    // Numbers as far apart as numbers can be.
    by_tens.frames[0].number = i64::MIN;
    by_tens.frames[1].number = i64::MAX;
    assert_eq!(rows_are_missing(&by_tens), None);
}
