//! The measurement's noise from the data, and what lingers of it.

use super::gap_world::lingering::blobs_linger;
use super::gap_world::{Plan, World};
use crate::diagnose::data::recording::Target;
use crate::diagnose::likelihood::noise::estimate;
use crate::diagnose::likelihood::noise_correlation::{shared_by_views, widening_of_views};
use crate::diagnose::likelihood::saturated::free_markers;
use crate::diagnose::model::problem::{Noise, Problem};
use crate::robot::Robot;

#[test]
fn noise_is_what_no_model_could_explain_with_all_that_was_spent_counted() {
    const NOISE_PX: f64 = 0.2;
    let world = World::new(4, true);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let plan = Plan { postures: 60, views: 3, noise_px: NOISE_PX, ..Plan::default() };
    let problem = Problem::new(&robot, &world.record(&plan)).unwrap();
    let stated = Noise { corner_px: 0.5, marker_px: 0.5, point_m: 1.0 };
    let found = estimate(&problem, &problem.nominal(), stated).unwrap();
    // A homography's eight numbers of 70 a board: uncounted they make 6 % of the deviation.
    assert!((found.corner_px / NOISE_PX - 1.0).abs() < 0.03, "{}", found.corner_px);
    assert!((found.marker_px / NOISE_PX - 1.0).abs() < 0.06, "{}", found.marker_px);
}

#[test]
fn what_the_model_does_not_predict_to_be_seen_is_no_row_of_the_markers() {
    let world = World::new(4, true);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let problem = Problem::new(&robot, &world.record(&Plan { postures: 12, ..Plan::default() })).unwrap();
    let noise = Noise { corner_px: 0.1, marker_px: 0.1, point_m: 1.0 };
    let rows = |marker_x_m: f64| {
        let mut deformation = problem.nominal();
        deformation.marker_shift[0].x = marker_x_m;
        let postures = free_markers(&problem, &deformation, noise, true, None).unwrap();
        let freedom: f64 = postures.iter().map(|p| p.freedom_left + p.freedom_taken).sum();
        let predicted: usize = postures.iter().map(|p| p.pixel_count).sum();
        assert!((freedom - 2.0 * predicted as f64).abs() < 1e-9, "{freedom} rows of {predicted} points");
        predicted
    };
    // Far behind the mirror in some frames, before it in others.
    assert!(rows(30.0).min(rows(-30.0)) < rows(0.0));
}

#[test]
fn views_of_a_posture_share_what_lingers_between_each_two_of_them() {
    for (correlation, views) in [(0.3_f64, 2), (0.5, 3), (0.6, 5)] {
        let (mut sum, mut pairs) = (0.0, 0.0);
        for i in 0..views {
            for j in 0..i {
                sum += correlation.powi(i - j);
                pairs += 1.0;
            }
        }
        let shared = shared_by_views(correlation, f64::from(views));
        assert!((shared - sum / pairs).abs() < 1e-12, "{correlation} {views}: {shared}");
    }
    assert_eq!(shared_by_views(0.5, 1.0), 0.0);
}

#[test]
fn views_are_widened_for_what_fades_within_a_few_frames_and_not_for_what_stays() {
    const NOISE: Noise = Noise { corner_px: 0.15, marker_px: 0.15, point_m: 1.0 };
    // Mean widening of ten sessions whose blobs' successive errors correlate so.
    let mean = |correlation: f64, slow_px: f64| {
        let of = |seed: u64| {
            let world = World::new(4, true);
            let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
            let plan = Plan { postures: 60, noise_px: 1e-3, seed, ..Plan::default() };
            let mut recording = world.record(&plan);
            blobs_linger(&mut recording, NOISE.marker_px, correlation, 1000 + seed);
            let count = recording.frames.len() as f64;
            for (f, frame) in recording.frames.iter_mut().enumerate() {
                for sighting in &mut frame.sightings {
                    if matches!(sighting.target, Target::Marker(_)) {
                        sighting.pixel.x += slow_px * (f as f64 / count - 0.5);
                    }
                }
            }
            let problem = Problem::new(&robot, &recording).unwrap();
            widening_of_views(&problem, &problem.nominal(), NOISE).unwrap()
        };
        (0..10).map(of).sum::<f64>() / 10.0
    };
    // Two views: √((1 + r) / (1 − r)).
    let lingering = mean(0.4, 0.0);
    assert!((lingering / (1.4_f64 / 0.6).sqrt() - 1.0).abs() < 0.08, "{lingering}");
    let (white, slow) = (mean(0.0, 0.0), mean(0.0, 0.8));
    assert!(white < 1.02, "{white}");
    assert!(slow < 1.1, "{slow}");
}
