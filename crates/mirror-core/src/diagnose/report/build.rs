//! Builds the diagnosis from the findings: verdict, causes with probabilities, where the gap lies, before and after.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::assessment::gap_closed::gap_over;
use crate::diagnose::assessment::limits::limits;
use crate::diagnose::assessment::noise_floor::Floor;
use crate::diagnose::assessment::stability::stability;
use crate::diagnose::assessment::uncertainty::{Deviations, deviations};
use crate::diagnose::criteria::cross_validation::seen_size;
use crate::diagnose::data::diagnosis::{
    Alternative, Cause, Checked, Data, Diagnosis, Estimate, Ranked, Signature, SignaturePoint, VERSION,
    Verdict, Where,
};
use crate::diagnose::data::recording::Recording;
use crate::diagnose::effects::{Concern, Place};
use crate::diagnose::likelihood::noise::trimmed_share;
use crate::diagnose::likelihood::probability::tempered;
use crate::diagnose::likelihood::score_test::Score;
use crate::diagnose::model::elementary::Atom;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::prepare::row_slip::WHOLE_STD;
use crate::diagnose::principles::{
    Count, FEWEST_REDUNDANT_ROWS, Grid, LEAST_LOG_ODDS, SURE_DEVIATIONS, Size, Threshold,
};
use crate::diagnose::random_effects::displaced::log_bayes;
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::random_effects::small_errors::Kind;
use crate::diagnose::report::another_resolution::put_together;
use crate::diagnose::report::doubts::doubted;
use crate::diagnose::report::free_numbers::with_free_numbers;
use crate::diagnose::report::gap_steps::{Part, gap_steps};
use crate::diagnose::report::members::members;
use crate::diagnose::report::reservations::{beside_remainder, where_cut_off};
use crate::diagnose::report::rms_shift::{noise_square, rms_shift, shift_of_rows};
use crate::diagnose::report::sentence::sentence;
use crate::diagnose::report::setup_causes::{setup_causes, zeros_log_bayes};
use crate::diagnose::report::signature::free_errors;
use crate::diagnose::selection::standing::Standing;
use crate::error::Result;
use crate::robot::Robot;
use std::collections::BTreeMap;

/// The droop of a servo with stiction is reported as a separate cause if, at the largest load, it is more than this
/// share of the dead band.
pub(crate) const DROOP_BESIDE_BAND: Threshold = 0.1;
/// With fewer postures than this few causes can be separated: one marker, two rows a posture, does not determine
/// its variance then.
const FEW_POSTURES: Count = FEWEST_REDUNDANT_ROWS as usize / 2;
/// Hypotheses of the ranking that are written.
const RANKED: Size = 40;
/// Resolution of a play's friction, as a share of it; reported as its standard deviation.
const FRICTION_RESOLUTION: Grid = 0.1;

/// Builds the diagnosis from the findings.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn diagnosis(
    findings: &mut Findings<'_>,
    robot: &Robot,
    recording: &Recording,
    ranking: &[Score],
    checked: Vec<Checked>,
) -> Result<Diagnosis> {
    findings.found.fit = findings.refit()?;
    let standings = core::mem::take(&mut findings.standings);
    let floor = Floor::new(&findings.search, &findings.found.fit, findings.unexplained.is_none())?;
    let deviations = deviations(findings, &floor)?;
    let mut told = causes(findings, &standings, &deviations)?;
    put_together(&mut told, &findings.search.problem);
    told.sort_by(|a, b| b.0.rms_shift.total_cmp(&a.0.rms_shift));
    let (mut causes, parts): (Vec<Cause>, Vec<Part>) = told.into_iter().unzip();
    add_stability(findings, &standings, ranking, (&mut causes, &parts))?;
    beside_remainder(&mut causes, findings, recording)?;
    where_cut_off(&mut causes, &parts, findings);
    let mut gap = gap_over(&findings.before, &findings.after, &floor, &deviations.law_shifts, checked);
    gap.steps = gap_steps(findings, &causes, &parts)?;
    let places = places(findings, &causes);
    // The verdict: by whether causes are named and whether something is unexplained. `reservations::reserve` changes it where the data do
    // not support it (`insufficient`, too many false observations, a gap far above its floor).
    let verdict = match (causes.is_empty(), &findings.unexplained) {
        (true, None) => Verdict::None,
        (true, Some(_)) => Verdict::Unknown,
        (false, None) if gap.is_told() => Verdict::Explained,
        (false, _) => Verdict::Partial,
    };
    let signatures = signatures(findings, &causes, recording)?;
    let panels = crate::diagnose::report::plots::panels(findings, &causes)?;
    let search = &findings.search;
    let scene = &search.problem.scene;
    let mut seen = Vec::new();
    let ranking = ranking
        .iter()
        .filter(|s| {
            let new = !seen.contains(&s.hypothesis);
            seen.push(s.hypothesis);
            new
        })
        .take(RANKED)
        .map(|s| Ranked {
            effect: search.catalogue.effect(s.hypothesis).name().to_owned(),
            at: search.catalogue.hypotheses[s.hypothesis].place.name(scene),
            log_bayes: s.log_bayes,
        })
        .collect();
    let noise = search.detector_noise();
    let mut noise_map = BTreeMap::new();
    if scene.has_camera {
        noise_map.insert("corner_px".to_owned(), noise.corner_px);
        noise_map.insert("marker_px".to_owned(), noise.marker_px);
    } else {
        noise_map.insert("point_m".to_owned(), noise.point_m);
    }
    let sentence = sentence(verdict, &causes, &places, &gap);
    Ok(Diagnosis {
        format: "mirror-posture/diagnosis".into(),
        version: VERSION,
        interrupted: false,
        verdict,
        sentence,
        r#where: places,
        gap,
        limits: limits(findings)?,
        next_postures: crate::diagnose::assessment::design::next_postures(
            findings, &standings, robot, recording,
        )?,
        warnings: warnings(findings),
        noise: noise_map,
        trace: findings.found.trace.clone(),
        ranking,
        signatures,
        tracks: panels.tracks,
        fields: panels.fields,
        causes,
        data: Data::default(),
        markers: Vec::new(),
    })
}

/// Adds its stability to each cause that was found by the score test.
fn add_stability(
    findings: &Findings<'_>,
    standings: &[Option<Standing>],
    ranking: &[Score],
    (causes, parts): (&mut [Cause], &[Part]),
) -> Result<()> {
    let is_mount = |c: &Cause| c.effect != "geometry";
    let told = causes.iter().zip(parts).filter(|(c, _)| is_mount(c));
    let mounts: Vec<Vec<usize>> = told
        .filter_map(
            |(_, part)| if let Part::Group { columns, .. } = part { Some(columns.clone()) } else { None },
        )
        .collect();
    let stability = stability(findings, standings, ranking, &mounts)?;
    let mut of_mounts = stability.mounts.iter();
    for (cause, part) in causes.iter_mut().zip(parts) {
        cause.stability = match part {
            Part::Term(i) => stability.terms[*i],
            Part::Terms(all) => all.iter().filter_map(|i| stability.terms[*i]).reduce(f64::min),
            Part::Group { .. } if is_mount(cause) => of_mounts.next().copied(),
            _ => None,
        };
    }
    Ok(())
}

fn causes(
    findings: &Findings<'_>,
    standings: &[Option<Standing>],
    deviations: &Deviations,
) -> Result<Vec<(Cause, Part)>> {
    let search = &findings.search;
    let scene = &search.problem.scene;
    let found = &findings.found;
    let mut out = Vec::new();
    let all = search.deformation(&found.fit.model);
    for (i, term) in found.fit.model.terms.iter().enumerate() {
        let Some(standing) = &standings[i] else { continue };
        let effect = search.catalogue.effect(term.hypothesis);
        let place = search.catalogue.hypotheses[term.hypothesis].place;
        let mut parameters: BTreeMap<String, Estimate> = effect
            .parameters()
            .into_iter()
            .zip(term.parameters.iter().zip(&deviations.stds[i]))
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
            let std = FRICTION_RESOLUTION * term.variant;
            parameters.insert("friction_nm".to_owned(), Estimate { value: term.variant, std });
        }
        let without = search.deformation(&found.fit.model.without(i));
        let shift = rms_shift(findings, &without, &all)?;
        let cause = Cause {
            effect: effect.name().to_owned(),
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
            words: effect.words().to_owned(),
            rms_shift: shift,
            members: Vec::new(),
            frames: Vec::new(),
        };
        out.push((cause, Part::Term(i)));
        // The servo's droop, reported separately: `effects.md` calls it joint_compliance at the same joint.
        if let Some(droop) = droop.filter(|d| d.value > SURE_DEVIATIONS * d.std) {
            let largest = place.node().map_or(0.0, |n| scene.largest_torque(n));
            if droop.value * largest > DROOP_BESIDE_BAND * term.parameters[0] {
                let cause = Cause {
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
                };
                out.push((cause, Part::Nothing));
            }
        }
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
        let columns = geometry.group.columns.iter().enumerate();
        let own: Vec<usize> = columns.filter(|(_, c)| geometry.is_of_robot(c)).map(|(k, _)| k).collect();
        // Outliers among the small errors that are not reported as causes.
        let is_free = |h: usize| search.catalogue.is_free(h);
        let terms = found.fit.model.terms.iter().enumerate();
        let outliers: Vec<usize> = terms
            .filter(|(i, t)| standings[*i].is_none() && !is_free(t.hypothesis))
            .map(|(i, _)| i)
            .collect();
        let bare = {
            let mut m = found.fit.model.clone();
            own.iter().for_each(|&k| m.group[k] = 0.0);
            outliers.iter().rev().for_each(|&i| m = m.without(i));
            search.deformation(&m)
        };
        let [std_rad, std_m] = geometry.spread_stds(&found.fit);
        // Where the links are as the model has them, their spread is not in question.
        let (spread_m, std_m) =
            if geometry.setup_only { (0.0, 0.0) } else { (geometry.spread(Kind::Length), std_m) };
        let cause = Cause {
            effect: "geometry".into(),
            at: "robot".into(),
            kind: Concern::Robot.word().into(),
            probability: tempered(log_bayes(geometry, &found.fit, &own)),
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
            rms_shift: rms_shift(findings, &bare, &all)?,
            members: members(findings, geometry, &outliers, deviations),
            frames: Vec::new(),
        };
        out.push((cause, Part::Group { columns: own, terms: outliers }));
    }
    out.iter_mut().for_each(|(cause, _)| doubted(cause, &findings.doubts));
    let moved = (seen_size(&findings.before).powi(2) - seen_size(&findings.after).powi(2)).max(0.0).sqrt();
    for mistake in &findings.mistakes {
        let mut cause = mistake.clone();
        with_free_numbers(&mut cause, findings);
        cause.rms_shift = moved / (findings.mistakes.len() as f64).sqrt();
        out.push((cause, Part::Mistake));
    }
    if let Some(slip) = &findings.slip {
        let whole = |value: f64, std: f64| Estimate { value, std };
        let number = |frame: usize| findings.search.problem.frame_numbers[frame] as f64;
        let [first_std, last_std] = slip.edge_stds(&findings.search.problem.posture);
        let cause = Cause {
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
        };
        out.push((cause, Part::Nothing));
    }
    Ok(out)
}

/// Shares of the gap by place: what each cause moves, and what is unexplained.
fn places(findings: &Findings<'_>, causes: &[Cause]) -> Vec<Where> {
    let mut out: Vec<Where> = Vec::new();
    let explained: f64 = causes.iter().map(|c| c.rms_shift.powi(2)).sum();
    let after = seen_size(&findings.after).powi(2);
    let floor = noise_square(&findings.search.problem, findings.search.detector_noise());
    let left = if findings.unexplained.is_some() { (after - floor).max(0.0) } else { 0.0 };
    let total = (explained + left).max(1e-30);
    for cause in causes {
        match out.iter_mut().find(|w| w.at == cause.at) {
            Some(w) => w.share += cause.rms_shift.powi(2) / total,
            None => out.push(Where {
                at: cause.at.clone(),
                share: cause.rms_shift.powi(2) / total,
                depends_on: None,
            }),
        }
    }
    if let Some(unexplained) = &findings.unexplained {
        let scene = &findings.search.problem.scene;
        let of_all: f64 = unexplained.places.iter().map(|p| p.shift).sum();
        for place in &unexplained.places {
            let at = place.name(scene);
            let part = if of_all > 0.0 { place.shift / of_all } else { 1.0 };
            let share = part * if explained == 0.0 { 1.0 } else { left / total };
            let depends_on = place.depends_on.clone();
            match out.iter_mut().find(|w| w.at == at) {
                Some(w) => {
                    w.share += share;
                    w.depends_on = w.depends_on.take().or(depends_on);
                }
                None => out.push(Where { at, share, depends_on }),
            }
        }
    }
    out.sort_by(|a, b| b.share.total_cmp(&a.share));
    out
}

fn signatures(findings: &Findings<'_>, causes: &[Cause], recording: &Recording) -> Result<Vec<Signature>> {
    let search = &findings.search;
    let scene = &search.problem.scene;
    let found = &findings.found;
    let mut out = Vec::new();
    let mut add = |problem: &Problem,
                   (node, other): (usize, Option<usize>),
                   cause: Option<usize>,
                   model: &crate::diagnose::effects::hypothesis::Model,
                   full: &crate::diagnose::effects::hypothesis::Model|
     -> Result<()> {
        let scene = &problem.scene;
        let of = |model: &crate::diagnose::effects::hypothesis::Model| {
            model.deformation(problem, search.catalogue, &search.group.columns)
        };
        let (bare, with) = (of(model), of(full));
        let points = free_errors(problem, &bare, search.measured_noise, Atom::Joint(node))?
            .iter()
            .map(|e| SignaturePoint {
                frame: recording.frames[e.frame].number,
                position: scene.q(e.frame, node),
                other_position: other.map(|k| scene.q(e.frame, k)),
                torque_nm: scene.torque(e.frame, node),
                direction: scene.direction(e.frame, node),
                time_s: scene.time_s[e.frame],
                error: e.value,
                std: e.std,
                fitted: with.joint_delta(e.frame, node) - bare.joint_delta(e.frame, node),
            })
            .collect();
        let unit = if scene.body.nodes[node].prismatic { "m" } else { "rad" };
        out.push(Signature {
            cause,
            at: format!("joint:{}", scene.body.nodes[node].joint),
            other: other.map(|k| format!("joint:{}", scene.body.nodes[k].joint)),
            unit: unit.into(),
            points,
        });
        Ok(())
    };
    for (i, term) in found.fit.model.terms.iter().enumerate() {
        if search.catalogue.is_free(term.hypothesis) {
            continue;
        }
        // What turns an axis does not move the position: it has a track.
        if !search.catalogue.columns(scene, term).iter().any(|c| matches!(c.atom, Atom::Joint(_))) {
            continue;
        }
        let place = search.catalogue.hypotheses[term.hypothesis].place;
        let name = (search.catalogue.effect(term.hypothesis).name(), place.name(scene));
        let index = causes.iter().position(|c| c.effect == name.0 && c.at == name.1);
        let other = if let Place::JointPair(_, k) = place { Some(k) } else { None };
        if let (Place::Joint(n) | Place::JointPair(n, _), Some(index)) = (place, index) {
            add(&search.problem, (n, other), Some(index), &found.fit.model.without(i), &found.fit.model)?;
        }
    }
    // What is unexplained at a joint, without the free-form error there and as that error has it.
    let mut drawn = Vec::new();
    for entry in findings.unexplained.iter().flat_map(|u| &u.places) {
        let Some(Place::Joint(node)) = entry.place else { continue };
        if drawn.contains(&node) {
            continue;
        }
        drawn.push(node);
        let on = entry.depends_on.as_deref().and_then(|d| d.split_once("position of joint:")).map(|d| d.1);
        let other = on.and_then(|name| scene.body.nodes.iter().position(|n| n.joint == name));
        let mut causes = found.fit.model.clone();
        causes.terms.retain(|t| {
            let at = search.catalogue.hypotheses[t.hypothesis].place.node();
            !(search.catalogue.is_free(t.hypothesis) && at == Some(node))
        });
        // A step is seen in the session as it was logged.
        let problem = match &findings.step {
            Some((step, as_logged)) if step.node == node => as_logged,
            _ => &search.problem,
        };
        add(problem, (node, other), None, &causes, &found.fit.model)?;
    }
    Ok(out)
}

fn warnings(findings: &Findings<'_>) -> Vec<String> {
    let problem = &findings.search.problem;
    let scene = &problem.scene;
    let mut out = Vec::new();
    let postures = findings.after.len();
    if postures < FEW_POSTURES {
        out.push(format!(
            "only {postures} postures: record at least {FEW_POSTURES}, better 60, spread over the joints' ranges; few causes can be told apart with so few"
        ));
    }
    if scene.marker_names.len() == 1 {
        out.push(
            "one marker only: joints in series are hard to separate; add a marker on each link of interest"
                .into(),
        );
    }
    if findings.false_share > trimmed_share() {
        out.push(format!(
            "{:.1} % of the markers' observations are far from the best model and were left out as false: look at them",
            findings.false_share * 100.0
        ));
    }
    if let Some(scatter) = findings.search.scatter {
        out.push(format!(
            "what is left is as if each joint rested {:.2}° (one standard deviation) away from its logged position, in each posture by itself: servos that repeat no \
             better, positions that were rounded or only commanded, or postures that had not settled; record what the encoders say, at rest, and repeat postures",
            scatter.std_rad.to_degrees()
        ));
    }
    if !scene.ordered {
        out.push("the rows are not in the order of execution: play and stiction by direction of motion cannot be seen".into());
    }
    let still: Vec<&str> = (0..scene.nodes())
        .filter(|&n| scene.relevant[n] && !scene.moves(n))
        .map(|n| scene.body.nodes[n].joint.as_str())
        .collect();
    if !still.is_empty() {
        out.push(format!(
            "joints that never moved: {}; only a constant error of these can be seen",
            still.join(", ")
        ));
    }
    if problem.camera.is_some() && findings.after.iter().all(|g| g.markers == 0.0) {
        out.push("no marker was seen together with the board: the body cannot be diagnosed".into());
    }
    out
}
