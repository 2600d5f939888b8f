//! What a cause could be instead, found outside of its own search: a gross mistake, the zeros of both joints of a link.

use crate::diagnose::data::diagnosis::Cause;
use crate::diagnose::prepare::first_day::Doubt;

/// Reports what could replace a cause among its alternatives, and reduces its probability, and theirs so far, by that.
pub(super) fn doubted(cause: &mut Cause, doubts: &[Doubt]) {
    let of_it = |d: &&Doubt| d.of.0 == cause.effect && d.of.1 == cause.at;
    let mistakes: Vec<_> = doubts.iter().filter(of_it).map(|d| d.mistake.clone()).collect();
    let left = (1.0 - mistakes.iter().map(|m| m.probability).sum::<f64>()).max(0.0);
    cause.probability *= left;
    // The search may have compared the same with other priors.
    cause.alternatives.retain(|a| !mistakes.iter().any(|m| m.effect == a.effect && m.at == a.at));
    // These were compared with the cause, and share what the mistakes leave.
    cause.alternatives.iter_mut().for_each(|a| a.probability *= left);
    cause.alternatives.extend(mistakes);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::data::diagnosis::Alternative;

    fn alternative(effect: &str, probability: f64) -> Alternative {
        Alternative { effect: effect.into(), at: "joint:elbow".into(), probability }
    }

    #[test]
    fn a_cause_with_all_its_alternatives_is_never_more_than_certain() {
        let mut cause = Cause {
            kind: "robot".into(),
            effect: "joint_offset".into(),
            at: "joint:elbow".into(),
            probability: 0.55,
            stability: None,
            alternatives: vec![alternative("axis_tilt", 0.44)],
            parameters: Default::default(),
            words: String::new(),
            rms_shift: 1.0,
            frames: Vec::new(),
            members: Vec::new(),
        };
        let of = ("joint_offset".to_owned(), "joint:elbow".to_owned());
        doubted(&mut cause, &[Doubt { of, mistake: alternative("slip", 0.4) }]);
        let told: Vec<f64> = cause.alternatives.iter().map(|a| a.probability).collect();
        let sum = cause.probability + told.iter().sum::<f64>();
        assert!((sum - 0.994).abs() < 1e-12 && (told[0] - 0.264).abs() < 1e-12, "{sum} {told:?}");
    }
}
