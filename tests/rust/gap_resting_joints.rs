//! Servos that repeat badly, in a robot that was put together by hand: the mounts take nothing of it, and causes are named beside it.

use crate::gap_world::resting::rest_elsewhere;
use crate::gap_world::{Plan, World, Wrong, draws};
use mirror_core::diagnose::{DependsOn, DiagnoseOptions, Diagnosis, Verdict, diagnose};
use mirror_core::robot::Robot;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// One standard deviation of what a joint rests beside its logged position, degrees.
const REST_DEG: f64 = 0.15;

/// Board, camera and markers off by some millimetres and a degree.
fn by_hand(world: &World, random: &mut ChaCha8Rng) -> Vec<Wrong> {
    let mut mount =
        || core::array::from_fn(|k| random.random_range(-1.0..1.0) * if k < 3 { 0.025 } else { 0.004 });
    let mut wrong = vec![Wrong::BoardMount(mount()), Wrong::CameraMount(mount())];
    wrong
        .extend((0..world.markers.len()).map(|marker| {
            Wrong::Mount(marker, core::array::from_fn(|_| random.random_range(-0.004..0.004)))
        }));
    wrong
}

fn told_beside(cause: Vec<Wrong>, seed: u64) -> Diagnosis {
    let world = World::new(4, true);
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let wrong = [by_hand(&world, &mut random), cause].concat();
    let mut recording = world.record(&Plan { postures: 60, seed, wrong, ..Plan::default() });
    // The noise is left to the two views of each posture.
    recording.pixel_std_px = None;
    let joints: Vec<usize> = (0..recording.frames[0].commanded.len()).collect();
    rest_elsewhere(&mut recording, &joints, || {
        REST_DEG.to_radians() * Distribution::<f64>::sample(&StandardNormal, &mut random)
    });
    diagnose(&Robot::from_urdf_str(&world.urdf()).unwrap(), &recording, &DiagnoseOptions::default(), &[])
        .unwrap()
}

#[test]
fn a_cause_is_named_beside_mounts_and_joints_that_rest_anywhere() {
    let world = World::new(4, true);
    let causes = [
        (vec![Wrong::Ratio(world.bone("r_elbow"), 0.08)], Some("joint:r_elbow")),
        (vec![], None),
        (vec![Wrong::Ratio(world.bone("l_shoulder_pitch"), -0.06)], Some("joint:l_shoulder_pitch")),
    ];
    for (seed, (wrong, at)) in draws(2, [0, 1, 2]).zip(causes) {
        let told = told_beside(wrong, 920 + seed);
        let said = format!("{} {:?} {:#?}", told.sentence, told.causes, told.trace);
        assert_eq!(told.verdict, Verdict::Partial, "{said}");
        // The zeros of a robot that was put together by hand may be small errors everywhere.
        let of_robot = || told.causes.iter().filter(|c| c.kind != "setup" && c.effect != "geometry");
        assert!(of_robot().all(|c| Some(c.at.as_str()) == at || c.probability < 0.5), "{said}");
        if let Some(at) = at {
            // At this scatter an eccentric gear looks much like another ratio.
            let found = of_robot().find(|c| c.at == at).expect(&said);
            let named = |effect: &str| effect == "gear_ratio";
            assert!(named(&found.effect) || found.alternatives.iter().any(|a| named(&a.effect)), "{said}");
            let laws: f64 =
                found.alternatives.iter().filter(|a| a.at == at).map(|a| a.probability).sum::<f64>()
                    + found.probability;
            assert!(laws > 0.45, "{laws} {said}");
        }
        assert!(
            told.r#where.iter().any(|w| w.at == "robot" && w.depends_on == Some(DependsOn::EachPosture)),
            "{said}"
        );
        let warning = told.warnings.iter().find(|w| w.contains("as if each joint rested")).expect(&said);
        let scale: f64 = warning.split("rested ").nth(1).unwrap().split('°').next().unwrap().parse().unwrap();
        assert!((scale / REST_DEG - 1.0).abs() < 0.2, "{warning}");
    }
}

/// Postures at the end of a session, whose views have an error in common, are few: by chance a joint rests on one side in all of them.
#[test]
fn a_few_postures_that_rest_on_one_side_are_no_other_zero() {
    let world = World::new(4, true);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let joint = robot.position_index("r_elbow").unwrap();
    for (last, off_deg, is_step) in [(2, 0.55, false), (25, 3.0, true)] {
        let mut random = ChaCha8Rng::seed_from_u64(931);
        let mut recording = world.record(&Plan { postures: 50, views: 6, seed: 931, ..Plan::default() });
        recording.pixel_std_px = None;
        let joints: Vec<usize> = (0..recording.frames[0].commanded.len()).collect();
        rest_elsewhere(&mut recording, &joints, || {
            REST_DEG.to_radians() * Distribution::<f64>::sample(&StandardNormal, &mut random)
        });
        let postures: Vec<i64> = recording.frames.iter().map(|f| f.posture).collect();
        let first = postures.partition_point(|posture| *posture <= postures[postures.len() - 1] - last);
        recording.frames[first..].iter_mut().for_each(|f| f.commanded[joint] += f64::to_radians(off_deg));
        let told = diagnose(&robot, &recording, &DiagnoseOptions::default(), &[]).unwrap();
        let warned = |w: &&String| w.contains("joint:r_elbow has another zero from row");
        let said = format!("{:?} {:#?}", told.warnings, told.trace);
        assert_eq!(told.warnings.iter().filter(warned).count(), usize::from(is_step), "{said}");
    }
}
