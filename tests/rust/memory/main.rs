//! Memory: screening a long session takes no more than a short one. A program of its own, since it looks at the whole process.

// A test may panic: that is how it fails.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

#[allow(dead_code)]
#[path = "../gap_world/mod.rs"]
mod gap_world;
mod resident;

use gap_world::{Plan, World, Wrong};
use mirror_core::diagnose::screen_once;
use mirror_core::robot::Robot;

/// What eight times as many frames may take beside, bytes a frame: causes tabulated frame by frame and the deformation, not
/// their products.
const BYTES_A_FRAME: u64 = 5_000;

#[test]
fn screening_takes_bounded_memory() {
    let world = World::new(20, false);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let screened = |frames: usize| {
        let wrong = vec![Wrong::Offset(world.bone("r_shoulder_roll"), 0.03)];
        let recording = world.record(&Plan { postures: frames / 2, wrong, ..Plan::default() });
        let screening = screen_once(&robot, &recording).unwrap();
        let taken = resident::taken_by(|| screening.run().unwrap());
        let hypotheses = screening.hypotheses();
        if let Some(t) = &taken {
            println!("{frames} frames, {hypotheses} hypotheses: {:.1} MB", t.peak_bytes as f64 / 1e6);
        }
        taken
    };
    let (Some(short), Some(long)) = (screened(500), screened(4_000)) else {
        println!("skipped: the system does not tell a process' memory");
        return;
    };
    assert!(
        long.peak_bytes < short.peak_bytes + 3_500 * BYTES_A_FRAME,
        "{} to {} bytes",
        short.peak_bytes,
        long.peak_bytes
    );
}
