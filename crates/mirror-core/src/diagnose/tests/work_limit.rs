//! A session that reaches its limit of work: what was found until then is told, and said to be so.

use super::gap_world::{Plan, World, Wrong};
use crate::diagnose::data::diagnosis::Diagnosis;
use crate::diagnose::model::work_budget::Effort;
use crate::diagnose::pipeline;
use crate::diagnose::prepare::first_day::{Memory, Suspects};
use crate::diagnose::prepare::options::DiagnoseOptions;
use crate::diagnose::prepare::prepared::Prepared;
use crate::robot::Robot;

/// The diagnosis of a session with two causes, with so much of its work left for the search, as a share.
fn diagnosed(left: f64) -> Diagnosis {
    let world = World::new(4, true);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let wrong =
        vec![Wrong::Offset(world.bone("r_elbow"), 0.03), Wrong::Ratio(world.bone("r_shoulder_yaw"), 0.04)];
    let recording = world.record(&Plan { postures: 24, noise_px: 0.15, wrong, ..Plan::default() });
    let options = DiagnoseOptions::default();
    let mut memory = Memory::default();
    let mut prepared =
        Prepared::new(&robot, &recording, &options, None, Suspects::AT_FIRST, &mut memory).unwrap();
    let budget = prepared.problem.budget.clone();
    while budget.share_for_searches() > left {
        budget.spend(Effort::Equations(40));
    }
    prepared.problem.budget = budget.again();
    pipeline::diagnose(prepared, &robot, &recording, &options, &[]).unwrap().diagnosis
}

fn says_so(diagnosis: &Diagnosis) -> bool {
    diagnosis.warnings.iter().any(|w| w.contains("limit of work"))
}

/// Whether the zero at the elbow is named: the larger cause.
fn named(diagnosis: &Diagnosis) -> bool {
    diagnosis.causes.iter().any(|c| c.at == "joint:r_elbow")
}

#[test]
fn what_was_found_at_the_limit_of_work_is_told_and_said_to_be_so() {
    // With work for no step nothing is sure, mounts that absorb a cause included.
    let none = diagnosed(0.0);
    assert!(says_so(&none) && none.sentence.contains("limit of work"), "{}", none.sentence);
    assert!(none.causes.iter().all(|c| c.probability <= 0.5), "{:?}", none.causes);
    // With more, what is found before all is found is no more probable than what was not tried. Where nothing could be
    // added the search has ended.
    let (mut left, mut first) = (1e-4, None);
    while left < 1.0 && first.is_none() {
        let some = diagnosed(left);
        assert!(says_so(&some), "{left}");
        assert!(some.causes.len() >= 2 || some.causes.iter().all(|c| c.probability <= 0.5), "{left}");
        first = named(&some).then_some(left);
        left *= 1.3;
    }
    assert!(first.is_some());
    // With all of it both are found, more probable than anything else.
    let all = diagnosed(1.0);
    assert!(!says_so(&all) && all.causes.len() == 2, "{:?} {:?}", all.causes, all.warnings);
    assert!(all.causes.iter().all(|c| c.probability > 0.5), "{:?}", all.causes);
}

#[test]
fn a_further_diagnosis_has_what_the_ones_before_left() {
    let world = World::new(4, true);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let recording = world.record(&Plan { postures: 12, ..Plan::default() });
    let options = DiagnoseOptions::default();
    let mut memory = Memory::default();
    let mut next = || {
        Prepared::new(&robot, &recording, &options, None, Suspects::AT_FIRST, &mut memory)
            .unwrap()
            .problem
            .budget
    };
    let first = next();
    while !first.is_over() {
        first.spend(Effort::Equations(80));
    }
    let (before, second) = (first.share_of_session(), next());
    assert!(second.is_over() && second.share_of_session() >= before, "{before}");
    assert!(second.share() < 0.2, "{}", second.share());
}
