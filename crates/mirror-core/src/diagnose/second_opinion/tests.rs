//! Which results of a first diagnosis are a reason for a second one, and what is told where no work is left for it.

use super::nearly_all_at_one;
use super::reason::{
    FIRST_FRAME, LATE, Reason, SLIP, hardly_slipped, is_late_by_nothing, is_of_no_size, is_told_twice,
    is_turned_in_vain, leaves_a_law, slip_together,
};
use crate::diagnose::data::depends_on::DependsOn;
use crate::diagnose::data::diagnosis::{Cause, Estimate, Verdict, Where};
use crate::diagnose::data::left_out::{LeftOut, Reason as Why};

fn cause(effect: &str, at: &str) -> Cause {
    Cause {
        effect: effect.into(),
        at: at.into(),
        kind: "robot".into(),
        probability: 0.99,
        parameters: Default::default(),
        stability: None,
        alternatives: Vec::new(),
        words: String::new(),
        rms_shift: 0.0,
        members: Vec::new(),
        frames: Vec::new(),
    }
}

#[test]
fn only_a_ratio_twice_at_one_joint_is_told_twice() {
    let (a, b) = (cause("gear_ratio", "joint:a"), cause("gear_ratio", "joint:b"));
    let offset = cause("joint_offset", "joint:a");
    assert!(is_told_twice(&[a.clone(), b.clone(), a.clone()]));
    assert!(!is_told_twice(&[a.clone(), b, offset.clone(), offset]));
    let ratio = |value: f64| {
        let scale = ("scale_error".to_owned(), Estimate { value, std: 0.001 });
        Cause { parameters: [scale].into_iter().collect(), ..a.clone() }
    };
    assert!(
        is_of_no_size(&[ratio(-0.002)])
            && !is_of_no_size(&[ratio(-0.02)])
            && !is_of_no_size(core::slice::from_ref(&a))
    );
}

#[test]
fn markers_that_slip_at_one_row_slip_together() {
    let slip = |at: &str, row: f64| {
        let first = (FIRST_FRAME.to_owned(), Estimate { value: row, std: 0.3 });
        Cause { parameters: [first].into_iter().collect(), ..cause(SLIP, at) }
    };
    let [hand, later, forearm] =
        [slip("marker:hand", 105.0), slip("marker:hand", 135.0), slip("marker:forearm", 105.0)];
    assert!(slip_together(&[hand.clone(), later.clone(), forearm.clone()]));
    assert!(!slip_together(&[hand.clone(), hand.clone()]) && !slip_together(&[later, forearm]));
    // What slips with the camera is seen in the markers too.
    assert!(!slip_together(&[hand, slip("camera", 105.0)]));
}

#[test]
fn a_delay_within_its_own_deviation_is_asked_of_twice() {
    let late = |delay: f64| {
        let delay = ("delay_s".to_owned(), Estimate { value: delay, std: 0.007 });
        Cause { parameters: [delay].into_iter().collect(), ..cause(LATE, "robot") }
    };
    assert!(is_late_by_nothing(&[late(0.0004)]) && is_late_by_nothing(&[late(-0.01)]));
    assert!(!is_late_by_nothing(&[late(0.05)]) && !is_late_by_nothing(&[cause("drift", "joint:a")]));
}

#[test]
fn a_slip_by_next_to_nothing_is_asked_of_twice() {
    let slip = |motion: f64| {
        let of = |value: f64, std: f64| Estimate { value, std };
        let parameters =
            [("dx_m", of(motion, 0.002)), ("dy_m", of(0.001, 0.002)), (FIRST_FRAME, of(90.0, 0.5))];
        let parameters = parameters.into_iter().map(|(name, e)| (name.to_owned(), e)).collect();
        Cause { parameters, ..cause(SLIP, "marker:a") }
    };
    assert!(hardly_slipped(&slip(0.004)) && hardly_slipped(&slip(0.02)) && !hardly_slipped(&slip(0.03)));
    assert!(!hardly_slipped(&cause("gear_ratio", "joint:a")));
}

#[test]
fn gravity_that_was_turned_and_leaves_something_is_asked_of_twice() {
    let (gravity, spring) = (cause("gravity_direction", "robot"), cause("joint_compliance", "joint:a"));
    let spring = Cause { rms_shift: 2.0, ..spring };
    let both = [spring.clone(), gravity];
    assert!(
        is_turned_in_vain(&both, Verdict::Partial, 3.0) && !is_turned_in_vain(&both, Verdict::Explained, 3.0)
    );
    assert!(!is_turned_in_vain(core::slice::from_ref(&spring), Verdict::Partial, 3.0));
    // What yields moves next to nothing of the gap.
    assert!(is_turned_in_vain(&both, Verdict::Explained, 1000.0));
    // Nothing yields to a load: the direction of gravity changes no prediction.
    let [_, gravity] = both;
    let zero = cause("joint_offset", "joint:elbow");
    assert!(is_turned_in_vain(&[gravity.clone(), zero], Verdict::Explained, 3.0));
    // Of play and friction the load's sign alone counts.
    let play = Cause { rms_shift: 2.0, ..cause("backlash", "joint:a") };
    assert!(is_turned_in_vain(&[gravity.clone(), play], Verdict::Explained, 3.0));
    // Springs among small errors everywhere are none by themselves.
    assert!(is_turned_in_vain(&[gravity, cause("geometry", "robot")], Verdict::Explained, 3.0));
    assert_eq!(Reason::Gravity.without(), ["gravity_direction"]);
}

#[test]
fn what_is_false_of_one_marker_is_doubted_and_of_a_whole_limb_is_not() {
    let left = |target: &str, count: usize, why: Why| {
        let one = LeftOut { frame: 1, target: target.into(), deviations: Some(9.0), why };
        vec![one; count]
    };
    let hand = left("l_hand", 27, Why::FarFromModel);
    let forearm = |count| left("l_forearm", count, Why::FarFromModel);
    let board = left("board", 90, Why::FewCorners { got: 2, needed: 12 });
    assert_eq!(nearly_all_at_one(&[hand.clone(), forearm(9), board.clone()].concat()), Some(("l_hand", 27)));
    assert_eq!(nearly_all_at_one(&[hand, forearm(10)].concat()), None);
    assert_eq!(nearly_all_at_one(&board), None);
}

#[test]
fn a_slip_may_be_a_piece_of_a_law_without_a_name_and_of_joints_that_scatter_it_is_none() {
    let left = |depends_on| Where { at: "joint:a".into(), share: 0.1, depends_on };
    let scattered = [left(None), left(Some(DependsOn::EachPosture)), left(Some(DependsOn::RowsFrom(9)))];
    assert!(!leaves_a_law(&scattered));
    assert!(leaves_a_law(&[left(None), left(Some(DependsOn::History))]));
    assert!(leaves_a_law(&[left(Some(DependsOn::Nothing))]));
}
