//! The crate's examples run: each compares what it prints with its own truth.

#[path = "../../crates/mirror-core/examples/correction_loop.rs"]
mod correction_loop;
#[path = "../../crates/mirror-core/examples/diagnosis.rs"]
mod diagnosis;
#[path = "../../crates/mirror-core/examples/marker_from_two_views.rs"]
mod marker_from_two_views;
#[path = "../../crates/mirror-core/examples/mirror_from_corners.rs"]
mod mirror_from_corners;

#[test]
fn every_example_runs_and_finds_its_truth() {
    mirror_from_corners::main().unwrap();
    marker_from_two_views::main().unwrap();
    correction_loop::main().unwrap();
    diagnosis::main().unwrap();
}
