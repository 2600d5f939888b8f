//! One correction step, from marker errors to joint changes: `cargo bench --bench correct`.
//!
//! Inputs differ from call to call, so that nothing is hoisted out of the loop.

// A bench may panic: that is how it says that its input is wrong.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use criterion::{Criterion, criterion_group, criterion_main};
use mirror_core::correct::{Damping, StepOptions, StepProblem, StepWorkspace, correction_step};
use nalgebra::{DMatrix, Matrix3, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::hint::black_box;
use std::time::Duration;

/// Different inputs that a bench goes through in turn.
const INPUTS: usize = 256;

struct Input {
    jacobian: DMatrix<f64>,
    error_m: Vec<Vector3<f64>>,
    covariance_m2: Vec<Matrix3<f64>>,
    positions: Vec<f64>,
    lower: Vec<f64>,
    upper: Vec<f64>,
    free: Vec<bool>,
}

fn inputs(markers: usize, joints: usize, room: f64) -> Vec<Input> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    (0..INPUTS)
        .map(|_| {
            let positions: Vec<f64> = (0..joints).map(|_| rng.random_range(-1.0..1.0)).collect();
            Input {
                jacobian: DMatrix::from_fn(3 * markers, joints, |_, _| rng.random_range(-0.15..0.15)),
                error_m: (0..markers)
                    .map(|_| Vector3::from_fn(|_, _| rng.random_range(-0.01..0.01)))
                    .collect(),
                covariance_m2: (0..markers)
                    .map(|_| {
                        let a = Matrix3::from_fn(|_, _| rng.random_range(-1e-4..1e-4));
                        a * a.transpose() + Matrix3::identity() * 1e-8
                    })
                    .collect(),
                lower: positions.iter().map(|q| q - rng.random_range(0.0..room)).collect(),
                upper: positions.iter().map(|q| q + rng.random_range(0.0..room)).collect(),
                positions,
                free: vec![true; joints],
            }
        })
        .collect()
}

fn step(c: &mut Criterion) {
    let mut group = c.benchmark_group("correction_step");
    group.measurement_time(Duration::from_secs(2)).warm_up_time(Duration::from_millis(500));
    let far = 100.0;
    for (name, markers, joints, room, options) in [
        ("7 joints, 3 markers", 3, 7, far, StepOptions::default()),
        (
            "7 joints, 3 markers, fixed damping",
            3,
            7,
            far,
            StepOptions { damping: Damping::Fixed { mu_m_per_rad: 0.01 }, ..StepOptions::default() },
        ),
        ("7 joints, 3 markers, on limits", 3, 7, 0.02, StepOptions::default()),
        ("7 joints, 1 marker (redundant)", 1, 7, far, StepOptions::default()),
        ("3 joints, 1 marker (the paper's)", 1, 3, far, StepOptions::default()),
    ] {
        let inputs = inputs(markers, joints, room);
        let mut workspace = StepWorkspace::new(markers, joints);
        let mut next = 0;
        group.bench_function(name, |b| {
            b.iter(|| {
                let input = &inputs[next % INPUTS];
                next += 1;
                let problem = StepProblem {
                    jacobian: &input.jacobian,
                    error_m: &input.error_m,
                    covariance_m2: &input.covariance_m2,
                    positions: &input.positions,
                    lower: &input.lower,
                    upper: &input.upper,
                    free: &input.free,
                };
                black_box(correction_step(&problem, &options, &mut workspace).unwrap().change[0])
            });
        });
    }
    group.finish();
}

criterion_group!(benches, step);
criterion_main!(benches);
