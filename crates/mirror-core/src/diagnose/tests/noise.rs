//! The measurement's noise from the data, and what lingers of it.

use super::gap_world::{Plan, World};
use crate::diagnose::assessment::noise_floor::shared_by_views;
use crate::diagnose::likelihood::noise::estimate;
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
