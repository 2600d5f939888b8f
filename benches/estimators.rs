//! Throughput of mirror estimators, virtual rays and triangulation: single, and in batches on one and two cores.
//!
//! `cargo bench --bench estimators`. Inputs differ from call to call, so that nothing is hoisted out of the loop.

// A bench may panic: that is how it says that its input is wrong.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use mirror_core::Cancel;
use mirror_core::camera::{Camera, Distortion};
use mirror_core::geometry::{Plane, Reflection};
use mirror_core::mirror::*;
use mirror_core::triangulate::*;
use nalgebra::{Isometry3, Point3, Vector2, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::hint::black_box;
use std::time::Duration;

const LENS: Distortion = Distortion::PlumbBob([-0.21, 0.07, 8e-4, -6e-4, 0.01]);
const MARKER: Point3<f64> = Point3::new(-0.06, 0.08, 0.03);
/// Different inputs that a single-call bench goes through in turn.
const INPUTS: usize = 256;

fn rig(lens: Distortion) -> Rig {
    let camera =
        Camera::new((800, 600), Vector2::new(693.0, 693.0), Vector2::new(399.5, 299.5), lens).unwrap();
    Rig::new(camera, Board::new((7, 5), 0.014).unwrap(), Isometry3::translation(0.0, 0.075, 0.0))
}

fn mirror(yaw: f64, rng: &mut ChaCha8Rng) -> Plane {
    let n = Vector3::new(yaw + rng.random_range(-0.02..0.02), rng.random_range(-0.02..0.02), 1.0);
    Plane::new(n, 0.15 + rng.random_range(-0.01..0.01)).unwrap()
}

fn shaken(pixel: Vector2<f64>, rng: &mut ChaCha8Rng) -> Vector2<f64> {
    pixel + Vector2::new(rng.random_range(-0.3..0.3), rng.random_range(-0.3..0.3))
}

/// Pixels of the whole board and of the marker in a mirror, with some noise.
fn seen(rig: &Rig, plane: &Plane, rng: &mut ChaCha8Rng) -> (Vec<Vector2<f64>>, Vector2<f64>) {
    let reflection = Reflection::across(*plane);
    let mut pixel = |x: &Point3<f64>| shaken(rig.camera.project(&reflection.point(x)).unwrap(), rng);
    let corners = rig.board.corners_in_board().iter().map(|x| pixel(&(rig.camera_from_board * x))).collect();
    (corners, pixel(&MARKER))
}

struct Batch {
    reflected_boards: Vec<[f64; 6]>,
    pixels: Vec<[f64; 4]>,
    corners: Vec<f64>,
}

fn batch(rig: &Rig, count: usize, with_corners: bool) -> Batch {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut out = Batch { reflected_boards: vec![], pixels: vec![], corners: vec![] };
    let origin = Point3::from(rig.camera_from_board.translation.vector);
    for _ in 0..count {
        let planes = [mirror(0.0, &mut rng), mirror(0.25, &mut rng)];
        let boards = planes.map(|p| Reflection::across(p).point(&origin));
        let marks = planes.map(|p| seen(rig, &p, &mut rng));
        let [a, b] = boards;
        out.reflected_boards.push([a.x, a.y, a.z, b.x, b.y, b.z]);
        out.pixels.push([marks[0].1.x, marks[0].1.y, marks[1].1.x, marks[1].1.y]);
        if with_corners {
            out.corners.extend(marks[0].0.iter().flat_map(|p| [p.x, p.y]));
        }
    }
    out
}

fn two_views(batch: &Batch, row: usize) -> TwoViews {
    let [a, b, c, d, e, f] = batch.reflected_boards[row];
    let [ua, va, ub, vb] = batch.pixels[row];
    TwoViews {
        reflected_boards: [Point3::new(a, b, c), Point3::new(d, e, f)],
        pixels: [Vector2::new(ua, va), Vector2::new(ub, vb)],
    }
}

fn singles(c: &mut Criterion) {
    for (lens_name, lens) in [("pinhole", Distortion::None), ("plumb_bob", LENS)] {
        let rig = rig(lens);
        let inputs = batch(&rig, INPUTS, true);
        let board = Point3::from(rig.camera_from_board.translation.vector);
        let views: Vec<_> =
            inputs.corners.chunks_exact(70).map(|row| view_from_row(&rig.board, row).unwrap()).collect();
        let rows: Vec<_> = (0..INPUTS).map(|row| two_views(&inputs, row)).collect();
        let mut group = c.benchmark_group(lens_name);
        group.measurement_time(Duration::from_secs(2)).warm_up_time(Duration::from_millis(500));

        let mut i = 0;
        group.bench_function("two point-pair planes + two virtual rays + midpoint", |b| {
            b.iter(|| {
                i = (i + 1) % INPUTS;
                point_pair_marker(&rig.camera, &board, black_box(&rows[i]), 0.0175).unwrap()
            });
        });
        for estimator in MirrorEstimator::ALL {
            let options = EstimatorOptions::default();
            group.bench_function(format!("mirror from 35 corners: {}", estimator.name()), |b| {
                b.iter(|| {
                    i = (i + 1) % INPUTS;
                    estimator.estimate(&rig, black_box(&views[i]), &options).unwrap()
                });
            });
        }
        let options = EstimatorOptions { noise_px: Some(0.2), ..Default::default() };
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let mirrors: Vec<_> = [0.0, 0.25, -0.12, 0.12, -0.25]
            .map(|yaw| {
                let (corners, pixel) = seen(&rig, &mirror(yaw, &mut rng), &mut rng);
                let view = BoardView::complete(&rig.board, &corners).unwrap();
                (MirrorEstimator::MaximumLikelihood.estimate(&rig, &view, &options).unwrap(), pixel)
            })
            .into();
        let (first, pixel) = &mirrors[0];
        group.bench_function("virtual ray", |b| {
            b.iter(|| virtual_ray(&rig.camera, black_box(&first.plane), black_box(pixel)).unwrap());
        });
        let virtual_camera = first.virtual_camera();
        group.bench_function("virtual ray with covariance", |b| {
            b.iter(|| black_box(&virtual_camera).ray(&rig.camera, black_box(pixel), 0.2).unwrap());
        });
        let rays: Vec<_> =
            mirrors.iter().map(|(m, p)| m.virtual_camera().ray(&rig.camera, p, 0.2).unwrap()).collect();
        let marks: Vec<_> = mirrors.iter().map(|(m, p)| MarkerView::new(m, *p, 0.2).unwrap()).collect();
        let options = TriangulationOptions::default();
        for n in [2, 5] {
            group.bench_function(format!("midpoint with covariance, {n} rays"), |b| {
                b.iter(|| midpoint(black_box(&rays[..n]), &options).unwrap());
            });
            group.bench_function(format!("maximum likelihood marker, {n} views"), |b| {
                b.iter(|| maximum_likelihood(&rig.camera, black_box(&marks[..n]), &options).unwrap());
            });
        }
        group.bench_function("mid2 with covariance", |b| {
            b.iter(|| lee_civera_mid2(black_box(&rays[..2]), &options).unwrap());
        });
        group.bench_function("unbiased with covariance", |b| {
            b.iter(|| unbiased(black_box(&rays[..2]), &options).unwrap());
        });
        group.finish();
    }
}

fn batches(c: &mut Criterion) {
    let rig = rig(LENS);
    let board = Point3::from(rig.camera_from_board.translation.vector);
    for cores in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(cores).build().unwrap();
        let mut group = c.benchmark_group(format!("batch on {cores} core(s), plumb_bob"));
        group
            .sample_size(10)
            .measurement_time(Duration::from_secs(2))
            .warm_up_time(Duration::from_millis(500));
        for count in [1_000, 100_000] {
            let inputs = batch(&rig, count, false);
            group.throughput(Throughput::Elements(count as u64));
            group.bench_with_input(
                BenchmarkId::new("two-view markers (Eq. 2)", count),
                &inputs,
                |b, inputs| {
                    b.iter(|| {
                        pool.install(|| {
                            let (boards, pixels) = (&inputs.reflected_boards, &inputs.pixels);
                            point_pair_markers(
                                &rig.camera,
                                &board,
                                boards,
                                pixels,
                                0.0175,
                                &Cancel::default(),
                            )
                            .unwrap()
                        })
                    });
                },
            );
        }
        // 100,000 boards of 35 corners are 56 MB of pixels: rows repeat, the work does not shrink.
        let rows = batch(&rig, 1_000, true).corners;
        for count in [1_000, 100_000] {
            let rows: Vec<f64> = rows.iter().copied().cycle().take(count * 70).collect();
            group.throughput(Throughput::Elements(count as u64));
            group.bench_with_input(
                BenchmarkId::new("maximum-likelihood mirrors", count),
                &rows,
                |b, rows| {
                    let options = EstimatorOptions::default();
                    b.iter(|| {
                        pool.install(|| {
                            estimate_rows(
                                MirrorEstimator::MaximumLikelihood,
                                &rig,
                                rows,
                                &options,
                                &Cancel::default(),
                            )
                        })
                    });
                },
            );
        }
        group.finish();
    }
}

criterion_group!(benches, singles, batches);
criterion_main!(benches);
