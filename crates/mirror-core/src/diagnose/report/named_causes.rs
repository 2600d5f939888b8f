//! The named causes with probabilities, parameters and alternatives: of the model's terms, of the set-up, of small
//! errors everywhere, of mistakes in the session, and of slipped rows.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::assessment::uncertainty::Deviations;
use crate::diagnose::criteria::cross_validation::seen_size;
use crate::diagnose::data::diagnosis::{Alternative, Cause, Estimate};
use crate::diagnose::effects::Concern;

use crate::diagnose::likelihood::probability::tempered;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::prepare::first_day::REVERSED;
use crate::diagnose::prepare::row_slip::{Slip, WHOLE_STD};
use crate::diagnose::principles::{Grid, LEAST_LOG_ODDS, Prior, SURE_DEVIATIONS, Threshold};
use crate::diagnose::random_effects::displaced::log_bayes;
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::random_effects::small_errors::Kind;
use crate::diagnose::report::doubts::doubted;
use crate::diagnose::report::free_numbers::with_free_numbers;
use crate::diagnose::report::gap_steps::Part;
use crate::diagnose::report::members::members;
use crate::diagnose::report::rms_shift::{rms_shift, shift_of_rows};
use crate::diagnose::report::setup_causes::{setup_causes, zeros_log_bayes};
use crate::diagnose::selection::standing::Standing;
use crate::error::Result;
use std::collections::BTreeMap;

/// Smallest uncertainty of a ratio beside which a joint may turn the other way: laws are not exact.
const REVERSED_STD: Prior = 0.005;

/// The droop of a servo with stiction is reported as a separate cause if, at the largest load, it is more than this
/// share of the dead band.
pub(crate) const DROOP_BESIDE_BAND: Threshold = 0.1;
/// Resolution of a play's friction, as a share of it; reported as its standard deviation.
const FRICTION_RESOLUTION: Grid = 0.1;

/// Whether a ratio's error is that of a joint that turns the other way, `1 + e = -1`: within its uncertainty.
fn is_reversed(scale_error: &Estimate) -> bool {
    (scale_error.value + 2.0).abs() < SURE_DEVIATIONS * scale_error.std.max(REVERSED_STD)
}

/// Each with what it is made of; whole mistakes and slips last.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(super) fn named_causes(
    findings: &Findings<'_>,
    standings: &[Option<Standing>],
    deviations: &Deviations,
) -> Result<Vec<(Cause, Part)>> {
    let found = &findings.found;
    let all = findings.search.deformation(&found.fit.model);
    let mut out = Vec::new();
    for (i, standing) in standings.iter().enumerate() {
        let Some(standing) = standing else { continue };
        let (cause, droop) = of_term(findings, i, standing, deviations, &all)?;
        out.push((cause, Part::Term(i)));
        out.extend(droop.map(|cause| (cause, Part::Nothing)));
    }
    if let Some(setup) = &findings.geometry {
        out.extend(
            setup_causes(findings, setup, deviations)?
                .into_iter()
                .map(|(c, columns)| (c, Part::Group { columns, terms: Vec::new() })),
        );
    }
    let of_robot = |g: &&Geometry| !g.setup_only || zeros_log_bayes(g, &found.fit) > LEAST_LOG_ODDS;
    if let Some(geometry) = findings.geometry.as_ref().filter(of_robot) {
        out.push(of_small_errors(findings, geometry, standings, deviations, &all)?);
    }
    out.iter_mut().for_each(|(cause, _)| doubted(cause, &findings.doubts));
    out.extend(of_mistakes(findings).into_iter().map(|cause| (cause, Part::Mistake)));
    out.extend(findings.slip.as_ref().map(|slip| (of_slip(findings, slip), Part::Nothing)));
    Ok(out)
}

/// The cause of a term of the model; and a servo's droop beside a play with stiction, where it is large enough:
/// `effects.md` calls it `joint_compliance` at the same joint.
fn of_term(
    findings: &Findings<'_>,
    index: usize,
    standing: &Standing,
    deviations: &Deviations,
    all: &Deformation,
) -> Result<(Cause, Option<Cause>)> {
    let search = &findings.search;
    let scene = &search.problem.scene;
    let model = &findings.found.fit.model;
    let term = &model.terms[index];
    let effect = search.catalogue.effect(term.hypothesis);
    let place = search.catalogue.hypotheses[term.hypothesis].place;
    let mut parameters: BTreeMap<String, Estimate> = effect
        .parameters()
        .into_iter()
        .zip(term.parameters.iter().zip(&deviations.stds[index]))
        .map(|(name, (value, std))| (name, Estimate { value: *value, std: *std }))
        .collect();
    if effect.name() == "mirror_glass" {
        // The vocabulary's parameter is the pane's thickness, not its excess over the session's.
        if let Some(thickness) = parameters.get_mut("thickness_m") {
            thickness.value = (thickness.value + scene.glass_thickness_m).max(0.0);
        }
    }
    let droop = parameters.remove("droop_rad_per_nm");
    if effect.name() == "backlash" && term.variant.is_finite() {
        // A simulator needs it in addition to the width: below it friction, above it gravity's torque decides
        // the side.
        let friction_nm = term.variant.abs();
        let std = FRICTION_RESOLUTION * friction_nm;
        parameters.insert("friction_nm".to_owned(), Estimate { value: friction_nm, std });
    }
    // A ratio of -1 is a wrong sign. The search for signs did not find it: it looks for errors that are far larger than small causes.
    let reversed = effect.name() == "gear_ratio" && parameters.get("scale_error").is_some_and(is_reversed);
    if reversed {
        parameters.clear();
    }
    let cause = Cause {
        effect: if reversed { REVERSED.0 } else { effect.name() }.to_owned(),
        at: place.name(scene),
        kind: effect.concern(place).word().into(),
        probability: standing.probability,
        stability: None,
        parameters,
        alternatives: standing
            .rivals
            .iter()
            .map(|r| Alternative {
                effect: search.catalogue.effect(r.hypothesis).name().to_owned(),
                at: search.catalogue.hypotheses[r.hypothesis].place.name(scene),
                probability: r.probability,
            })
            .collect(),
        words: if reversed { REVERSED.1 } else { effect.words() }.to_owned(),
        rms_shift: rms_shift(findings, &search.deformation(&model.without(index)), all)?,
        members: Vec::new(),
        frames: Vec::new(),
    };
    let torque_nm = place.node().map_or(0.0, |n| scene.largest_torque(n));
    let droop = droop
        .filter(|d| d.value > SURE_DEVIATIONS * d.std)
        .filter(|d| d.value * torque_nm > DROOP_BESIDE_BAND * term.parameters[0])
        .map(|droop| Cause {
            effect: "joint_compliance".into(),
            at: place.name(scene),
            kind: Concern::Robot.word().into(),
            probability: standing.probability,
            parameters: BTreeMap::from([("compliance_rad_per_nm".to_owned(), droop)]),
            stability: None,
            alternatives: Vec::new(),
            words: "the sticking servo droops under the load of gravity".into(),
            rms_shift: 0.0,
            members: Vec::new(),
            frames: Vec::new(),
        });
    Ok((cause, droop))
}

/// Small errors all over the robot, with those that stand out among them and are not causes of their own.
fn of_small_errors(
    findings: &Findings<'_>,
    geometry: &Geometry,
    standings: &[Option<Standing>],
    deviations: &Deviations,
    all: &Deformation,
) -> Result<(Cause, Part)> {
    let search = &findings.search;
    let fit = &findings.found.fit;
    let columns = geometry.group.columns.iter().enumerate();
    let own: Vec<usize> = columns.filter(|(_, c)| geometry.is_of_robot(c)).map(|(k, _)| k).collect();
    let terms = fit.model.terms.iter().enumerate();
    let outliers: Vec<usize> = terms
        .filter(|(i, t)| standings[*i].is_none() && !search.catalogue.is_free(t.hypothesis))
        .map(|(i, _)| i)
        .collect();
    let bare = {
        let mut m = fit.model.clone();
        own.iter().for_each(|&k| m.group[k] = 0.0);
        outliers.iter().rev().for_each(|&i| m = m.without(i));
        search.deformation(&m)
    };
    let [std_rad, std_m] = geometry.spread_stds(fit);
    // Where the links are as the model has them, their spread is not in question.
    let (spread_m, std_m) =
        if geometry.setup_only { (0.0, 0.0) } else { (geometry.spread(Kind::Length), std_m) };
    let cause = Cause {
        effect: "geometry".into(),
        at: "robot".into(),
        kind: Concern::Robot.word().into(),
        probability: tempered(log_bayes(geometry, fit, &own)),
        parameters: BTreeMap::from([
            ("spread_m".to_owned(), Estimate { value: spread_m, std: std_m }),
            ("spread_rad".to_owned(), Estimate { value: geometry.spread(Kind::Angle), std: std_rad }),
        ]),
        stability: None,
        alternatives: Vec::new(),
        words: if geometry.setup_only {
            "small errors of the joints' zeros all over the robot".into()
        } else if geometry.has(Kind::Transmission) {
            "many small errors of links, axes and zeros together, and of each joint's transmission along its turn: manufacturing tolerance".into()
        } else {
            "many small errors of links, axes and zeros together: manufacturing tolerance".into()
        },
        rms_shift: rms_shift(findings, &bare, all)?,
        members: members(findings, geometry, &outliers, deviations),
        frames: Vec::new(),
    };
    Ok((cause, Part::Group { columns: own, terms: outliers }))
}

/// Whole mistakes in the session, which were undone before: together they moved what the gap lost (nothing that can be told in numbers
/// where nothing could be compared before).
fn of_mistakes(findings: &Findings<'_>) -> Vec<Cause> {
    let moved = (seen_size(&findings.before).powi(2) - seen_size(&findings.after).powi(2)).max(0.0).sqrt();
    let each = moved / (findings.mistakes.len() as f64).sqrt();
    let told = findings.mistakes.iter().map(|mistake| {
        let mut cause = mistake.clone();
        with_free_numbers(&mut cause, findings);
        cause.rms_shift = each;
        cause
    });
    told.collect()
}

fn of_slip(findings: &Findings<'_>, slip: &Slip) -> Cause {
    let search = &findings.search;
    let whole = |value: f64, std: f64| Estimate { value, std };
    let number = |frame: usize| search.problem.frame_numbers[frame] as f64;
    let [first_std, last_std] = slip.edge_stds(&search.problem.posture);
    Cause {
        effect: "pairing".into(),
        at: "data".into(),
        kind: "data".into(),
        probability: tempered(0.5 * slip.gain),
        parameters: BTreeMap::from([
            ("first_frame".to_owned(), whole(number(slip.first), first_std)),
            ("last_frame".to_owned(), whole(number(slip.last), last_std)),
            ("shift_rows".to_owned(), whole(slip.shift as f64, WHOLE_STD)),
        ]),
        stability: None,
        alternatives: Vec::new(),
        words: "a run of rows contains the measurement of other rows; it was left out of the fit".into(),
        rms_shift: shift_of_rows(&search.problem, search.measured_noise, slip),
        members: Vec::new(),
        frames: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ratio_within_its_uncertainty_of_minus_one_is_a_wrong_sign() {
        let told = |value, std| is_reversed(&Estimate { value, std });
        assert!(told(-1.9965, 0.0018) && told(-1.9, 0.05));
        assert!(!told(-1.97, 0.002) && !told(-1.7, 0.05) && !told(0.02, 0.001));
    }
}
