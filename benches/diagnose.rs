//! The diagnosis from arrays to JSON, against frames and against joints.
//!
//! `RAYON_NUM_THREADS=1 cargo bench --bench diagnose` for one core. The recordings are those of the tests: a humanoid with
//! two arms before a mirror, two views a posture, 6 markers and 35 corners a frame, one joint's zero off; `-- kinds` one of each kind of
//! what can be wrong.
//! `MIRROR_BENCH_LONG=1` adds the session of 10,000 frames.

// A bench may panic: that is how it says that its input is wrong.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

#[allow(dead_code)]
#[path = "../tests/rust/gap_world/mod.rs"]
mod gap_world;
#[path = "../tests/rust/memory/resident.rs"]
mod memory;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use gap_world::{Plan, World, Wrong};
use mirror_core::diagnose::{DiagnoseOptions, Recording, diagnose, screen_once};
use mirror_core::robot::Robot;
use std::hint::black_box;
use std::time::Duration;

fn session(frames: usize, an_arm: usize) -> (Robot, Recording) {
    let world = World::new(an_arm, false);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let wrong = vec![Wrong::Offset(world.bone("r_shoulder_roll"), 0.03)];
    let recording = world.record(&Plan { postures: frames / 2, wrong, ..Plan::default() });
    (robot, recording)
}

/// From the arrays to the JSON, a session.
fn bench_diagnose(c: &mut Criterion) {
    let mut group = c.benchmark_group("diagnose");
    group.sample_size(10).warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(3));
    let long = std::env::var_os("MIRROR_BENCH_LONG").is_some();
    let frames = [100, 200, 400, 1_000].into_iter().chain(long.then_some(LONG));
    let cases = frames.map(|f| (f, 7)).chain([4, 14, 20].map(|a| (200, a)));
    for (frames, an_arm) in cases {
        let (robot, recording) = session(frames, an_arm);
        group.throughput(Throughput::Elements(frames as u64));
        let id = BenchmarkId::new(format!("{}_joints", 2 * an_arm), frames);
        group.bench_function(id, |b| {
            b.iter(|| {
                let options = DiagnoseOptions::default();
                let diagnosis = diagnose(black_box(&robot), black_box(&recording), &options, &[]).unwrap();
                serde_json::to_string(&diagnosis).unwrap()
            });
        });
    }
    group.finish();
}

/// What is wrong with a session of 200 frames: the kinds of which each has its limit of time.
fn kinds(world: &World) -> Vec<(&'static str, Vec<Wrong>)> {
    let bone = |name: &str| world.bone(name);
    let play = Wrong::Backlash(bone("r_elbow"), 0.03, 0.02);
    let several = vec![
        Wrong::Offset(bone("r_shoulder_roll"), 0.03),
        Wrong::Ratio(bone("l_elbow"), 0.04),
        Wrong::Mount(1, [0.004, -0.003, 0.002]),
    ];
    // A slow wave, so that neighbours differ and nothing stands out.
    let small = |i: usize, k: usize| (1.7 * i as f64 + 2.3 * k as f64).sin();
    let everywhere = (0..world.bones.len())
        .flat_map(|n| {
            let shift = [0, 1, 2].map(|k| 1e-3 * small(n, k));
            let tilt = Wrong::Tilt(n, 5e-3 * small(n, 3), 5e-3 * small(n, 4));
            [Wrong::Offset(n, 5e-3 * small(n, 5)), tilt, Wrong::Length(Some(n), shift)]
        })
        .collect();
    let mounts = (0..world.markers.len()).map(|m| Wrong::Mount(m, [0, 1, 2].map(|k| 3e-3 * small(m, k))));
    let turned = |k: f64| [0.01 * k, -0.008, 0.006 * k, 0.003, -0.002 * k, 0.002];
    let by_hand = mounts
        .chain([Wrong::BoardMount(turned(1.0)), Wrong::CameraMount(turned(-1.0))])
        .chain([Wrong::Tilt(bone("r_shoulder_yaw"), 0.04, 0.02)])
        .collect();
    vec![
        ("nothing", Vec::new()),
        ("a_zero", vec![Wrong::Offset(bone("r_shoulder_roll"), 0.03)]),
        ("a_tilt", vec![Wrong::Tilt(bone("l_shoulder_yaw"), 0.04, 0.02)]),
        ("a_play", vec![play]),
        ("a_board", vec![Wrong::BoardScale(0.01)]),
        ("several", several),
        ("everywhere", everywhere),
        ("by_hand", by_hand),
    ]
}

/// A session of 200 frames of each kind.
fn bench_kinds(c: &mut Criterion) {
    let mut group = c.benchmark_group("kinds");
    group.sample_size(10).warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(3));
    let world = World::new(7, false);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    for (name, wrong) in kinds(&world) {
        let recording = world.record(&Plan { postures: 100, wrong, ..Plan::default() });
        group.bench_function(BenchmarkId::new(name, 200), |b| {
            b.iter(|| {
                let options = DiagnoseOptions::default();
                let diagnosis = diagnose(black_box(&robot), black_box(&recording), &options, &[]).unwrap();
                serde_json::to_string(&diagnosis).unwrap()
            });
        });
    }
    group.finish();
}

/// Frames of a long session.
const LONG: usize = 10_000;
/// Frames and joints an arm: frames alone, then joints alone, then both at their most.
const SCREENED: [(usize, usize); 10] = [
    (100, 7),
    (200, 7),
    (400, 7),
    (1_000, 7),
    (3_000, 7),
    (LONG, 7),
    (1_000, 4),
    (1_000, 14),
    (1_000, 20),
    (LONG, 20),
];

/// The score test of all hypotheses alone, the recording arranged and its mirrors fitted beforehand; elements are frames
/// times hypotheses. Prints how much memory one run over a long session takes beside what is there already.
fn bench_screen(c: &mut Criterion) {
    let mut group = c.benchmark_group("screen");
    group.sample_size(10).warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(2));
    for (frames, an_arm) in SCREENED {
        let (robot, recording) = session(frames, an_arm);
        let screening = screen_once(&robot, &recording).unwrap();
        let hypotheses = screening.hypotheses();
        group.throughput(Throughput::Elements((frames * hypotheses) as u64));
        let name = format!("{}_joints_{hypotheses}_hypotheses", 2 * an_arm);
        // What smaller runs left to the allocator would hide what these take.
        if frames >= LONG
            && let Some(took) = memory::taken_by(|| screening.run().unwrap())
        {
            println!("screen/{name}/{frames}: {:.1} MB of memory", took.peak_bytes as f64 / 1e6);
        }
        group.bench_function(BenchmarkId::new(name, frames), |b| {
            b.iter(|| black_box(&screening).run().unwrap());
        });
    }
    group.finish();
}

criterion_group!(benches, bench_screen, bench_diagnose, bench_kinds);
criterion_main!(benches);
