//! A tie at an early step that one cause more decides: the search leads back from the cause that was taken.

use super::gap_world::{Plan, World, Wrong};
use super::prior::{NOISE, search};
use super::shortcuts::{catalogue, named};
use crate::diagnose::effects::hypothesis::Model;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::selection::near_ties::from_near_ties;
use crate::diagnose::selection::pairwise_start::{Pair, start_from};
use crate::diagnose::selection::search::Found;
use crate::robot::Robot;

#[test]
fn what_a_tilt_stands_for_is_found_from_the_zero_that_was_as_likely_once() {
    let world = World::new(4, true);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let wrong =
        vec![Wrong::Offset(world.bone("r_elbow"), 0.03), Wrong::Ratio(world.bone("r_shoulder_yaw"), 0.04)];
    let plan = Plan { postures: 24, noise_px: 0.15, wrong, ..Plan::default() };
    let problem = Problem::new(&robot, &world.record(&plan)).unwrap();
    let catalogue = catalogue(&problem);
    let [zero, ratio, tilt, glass] = [
        "joint_offset@joint:r_elbow",
        "gear_ratio@joint:r_shoulder_yaw",
        "axis_tilt@joint:r_shoulder_yaw",
        "mirror_glass@mirror",
    ]
    .map(|name| named(&problem, &catalogue, name));
    let one = |hypothesis: usize| Model::nominal(&problem).with(&catalogue, hypothesis, 0.0);
    let from = |taken: usize, other: usize| {
        let mut search = search(&problem, &catalogue);
        let noise = search.effective(&one(taken)).unwrap();
        let fit = search.fit(&one(taken), noise, 6).unwrap();
        let mut found = Found { fit, noise, trace: Vec::new(), cut_off: false };
        search.ties = vec![(taken, one(other).terms[0].clone())];
        from_near_ties(&mut search, &mut found).unwrap();
        assert!(search.ties.is_empty());
        let mut causes: Vec<usize> = found.fit.model.terms.iter().map(|t| t.hypothesis).collect();
        causes.sort_unstable();
        causes
    };
    let mut wanted = vec![zero, ratio];
    wanted.sort_unstable();
    assert_eq!(from(tilt, zero), wanted);
    assert!(from(tilt, zero) != from(tilt, tilt), "a cause is no rival of itself");
    // What was as likely once and leads nowhere changes nothing.
    let both = search(&problem, &catalogue);
    let model = one(zero).with(&catalogue, ratio, 0.0);
    let fit = both.fit(&model, NOISE, 8).unwrap();
    let mut found = Found { fit, noise: NOISE, trace: Vec::new(), cut_off: false };
    let mut ended = both.clone();
    ended.ties = vec![(ratio, one(glass).terms[0].clone())];
    from_near_ties(&mut ended, &mut found).unwrap();
    assert_eq!(found.fit.model.terms.iter().map(|t| t.hypothesis).collect::<Vec<_>>(), [zero, ratio]);
    assert!(found.trace.is_empty());
}

#[test]
fn a_pair_that_leads_to_a_mirror_which_cannot_be_is_no_start() {
    let world = World::new(4, true);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let problem = Problem::new(&robot, &world.record(&Plan { postures: 8, ..Plan::default() })).unwrap();
    let catalogue = catalogue(&problem);
    let search = search(&problem, &catalogue);
    let started = |thickness_m: f64| {
        let hypotheses = ["joint_offset@joint:r_elbow", "mirror_glass@mirror"]
            .map(|name| named(&problem, &catalogue, name));
        let pair = Pair { hypotheses, parameters: [0.01, thickness_m], log_bayes: 1.0 };
        start_from(&search, &Model::nominal(&problem), &pair)
    };
    assert_eq!(started(0.008).map(|model| model.terms.len()), Some(2));
    assert!(started(0.13).is_none());
}
