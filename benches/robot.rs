//! Throughput of forward kinematics, Jacobians and gravity torques.
//!
//! The robot is a humanoid of 29 joints and 39 links made here (the size and shape of a Unitree G1: six-joint legs, three at the waist,
//! seven-joint arms, ten fixed links). `MIRROR_BENCH_URDF=path/to/robot.urdf` measures another robot instead.

// A bench may panic: that is how it says that its input is wrong.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use mirror_core::robot::{JointTwist, Robot};
use nalgebra::{Matrix3xX, Point3, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::fmt::Write;
use std::hint::black_box;
use std::path::Path;

/// Appends a link and the joint that carries it.
fn limb(out: &mut String, parent: &str, child: &str, kind: &str, axis: &str, xyz: &str, rpy: &str) {
    let _ = write!(
        out,
        "<link name=\"{child}\"><inertial><origin xyz=\"0.01 0 -0.05\"/><mass value=\"1.1\"/></inertial></link>\
         <joint name=\"{child}_joint\" type=\"{kind}\"><origin xyz=\"{xyz}\" rpy=\"{rpy}\"/><parent link=\"{parent}\"/>\
         <child link=\"{child}\"/><axis xyz=\"{axis}\"/><limit lower=\"-2\" upper=\"2\" effort=\"1\" velocity=\"1\"/></joint>"
    );
}

fn humanoid() -> String {
    let mut out = String::from("<robot name=\"humanoid29\"><link name=\"pelvis\"/>");
    let (x, y, z) = ("1 0 0", "0 1 0", "0 0 1");
    for (side, s) in [("left", 1.0), ("right", -1.0)] {
        let mut parent = "pelvis".to_owned();
        let parts = [
            ("hip_pitch", y, 0.064, "0 0 0"),
            ("hip_roll", x, 0.05, "0 -0.1749 0"),
            ("hip_yaw", z, 0.0, "0 0 0"),
            ("knee", y, 0.0, "0 0.1749 0"),
            ("ankle_pitch", y, 0.0, "0 0 0"),
            ("ankle_roll", x, 0.0, "0 0 0"),
        ];
        for (part, axis, off, rpy) in parts {
            let child = format!("{side}_{part}");
            limb(&mut out, &parent, &child, "revolute", axis, &format!("0.02 {} -0.1", s * off), rpy);
            parent = child;
        }
        for k in 0..2 {
            limb(&mut out, &parent, &format!("{side}_sole_{k}"), "fixed", x, "0.05 0.02 -0.03", "0 0 0");
        }
    }
    let mut torso = "pelvis".to_owned();
    for (part, axis) in [("waist_yaw", z), ("waist_roll", x), ("waist_pitch", y)] {
        limb(&mut out, &torso, part, "revolute", axis, "-0.004 0 0.035", "0 0 0");
        torso = part.to_owned();
    }
    for (side, s) in [("left", 1.0), ("right", -1.0)] {
        let mut parent = torso.clone();
        let parts = [
            ("shoulder_pitch", y, 0.1, format!("{} 0 0", s * 0.279)),
            ("shoulder_roll", x, 0.04, format!("{} 0 0", -s * 0.279)),
            ("shoulder_yaw", z, 0.0, "0 0 0".to_owned()),
            ("elbow", y, 0.0, "0 0 0".to_owned()),
            ("wrist_roll", x, 0.0, "0 0 0".to_owned()),
            ("wrist_pitch", y, 0.0, "0 0 0".to_owned()),
            ("wrist_yaw", z, 0.0, "0 0 0".to_owned()),
        ];
        for (part, axis, off, rpy) in parts {
            let child = format!("{side}_{part}");
            limb(&mut out, &parent, &child, "revolute", axis, &format!("0.05 {} -0.02", s * off), &rpy);
            parent = child;
        }
        limb(&mut out, &parent, &format!("{side}_palm"), "fixed", x, "0.04 0.003 0", "0 0 0");
    }
    for (name, rpy) in [("camera", "0 0.83 0"), ("lidar", "0 0.04 0"), ("imu", "0 0 0"), ("logo", "0 0 0")] {
        limb(&mut out, &torso, name, "fixed", x, "0.05 0.01 0.43", rpy);
    }
    out.push_str("</robot>");
    out
}

fn robot() -> Robot {
    match std::env::var("MIRROR_BENCH_URDF") {
        Ok(path) => Robot::from_urdf_file(Path::new(&path)).expect("MIRROR_BENCH_URDF names a robot"),
        Err(_) => Robot::from_urdf_str(&humanoid()).expect("the humanoid is a robot"),
    }
}

fn random_postures(robot: &Robot, count: usize) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    (0..count * robot.position_count()).map(|_| rng.random_range(-2.0..2.0)).collect()
}

fn single(c: &mut Criterion) {
    let robot = robot();
    let (width, links, joints) = (robot.position_count(), robot.links().len(), robot.joints().len());
    println!("robot {:?}: {width} positions, {links} links", robot.name());
    let q = random_postures(&robot, 64);
    let mut poses = robot.new_poses();
    let mut group = c.benchmark_group("robot, one posture");
    let mut k = 0;
    group.bench_function("forward kinematics of all links", |b| {
        b.iter(|| {
            k = (k + 1) % 64;
            robot.forward_kinematics(black_box(&q[k * width..(k + 1) * width]), &mut poses).unwrap();
            black_box(&poses);
        });
    });
    let mut twists = vec![JointTwist::default(); joints];
    group.bench_function("forward kinematics and all joint Jacobians", |b| {
        b.iter(|| {
            k = (k + 1) % 64;
            robot.forward_kinematics(black_box(&q[k * width..(k + 1) * width]), &mut poses).unwrap();
            robot.joint_twists(&poses, &mut twists).unwrap();
            black_box(&twists);
        });
    });
    let mut jacobian = Matrix3xX::zeros(width);
    group.bench_function("Jacobian of a point (after forward kinematics)", |b| {
        b.iter(|| {
            robot
                .point_jacobian(
                    black_box(&poses),
                    links - 1,
                    links / 2,
                    &Point3::new(0.1, 0.2, 0.3),
                    &mut jacobian,
                )
                .unwrap();
            black_box(&jacobian);
        });
    });
    let mut loads = robot.new_gravity_loads();
    group.bench_function("gravity loads (after forward kinematics)", |b| {
        b.iter(|| {
            robot
                .gravity_loads(black_box(&poses), &Vector3::new(0.0, 0.0, -9.81), links / 2, &mut loads)
                .unwrap();
            black_box(&loads);
        });
    });
    group.finish();
}

fn batches(c: &mut Criterion) {
    let robot = robot();
    let (width, links, joints) = (robot.position_count(), robot.links().len(), robot.joints().len());
    let (a, b) = (links - 1, links / 2);
    let some_links = [0, links / 5, links / 3, links / 2, links - 2, links - 1];
    let point = Point3::new(0.1, 0.2, 0.3);
    let gravity = Vector3::new(0.0, 0.0, -9.81);
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        let mut group = c.benchmark_group(format!("robot, batch, {threads} core(s)"));
        group.sample_size(20);
        for count in [1_000, 100_000] {
            let q = random_postures(&robot, count);
            group.throughput(Throughput::Elements(count as u64));
            let mut bench = |name: &str, each: usize, run: &(dyn Fn(&mut [f64]) + Sync)| {
                let mut out = vec![0.0; count * each];
                group.bench_function(BenchmarkId::new(name, count), |bencher| {
                    bencher.iter(|| pool.install(|| run(black_box(&mut out))));
                });
            };
            bench("forward kinematics of all links", links * 16, &|out| {
                robot.forward_kinematics_batch(&q, out).unwrap();
            });
            bench("poses of 6 links", 6 * 16, &|out| {
                robot.link_poses_batch(&q, &some_links, out).unwrap();
            });
            bench("all joint Jacobians", joints * 6, &|out| robot.joint_twists_batch(&q, out).unwrap());
            bench("point", 3, &|out| robot.points_batch(&q, a, b, &point, out).unwrap());
            bench("Jacobian of a point", 3 * width, &|out| {
                robot.point_jacobians_batch(&q, a, b, &point, out).unwrap();
            });
            bench("gravity torques", width, &|out| {
                robot.gravity_torques_batch(&q, &gravity, b, out).unwrap();
            });
        }
        group.finish();
    }
}

criterion_group!(benches, single, batches);
criterion_main!(benches);
