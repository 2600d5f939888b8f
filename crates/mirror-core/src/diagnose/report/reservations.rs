//! Reservations: where the data do not support the verdict of the search (too few, too many false, or the search did
//! not end).

use crate::diagnose::assessment::evidence;
use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::assessment::left_out_together::{LeftOutTogether, left_out_together};
use crate::diagnose::criteria::cross_validation::{in_sample, seen_size};
use crate::diagnose::data::depends_on::DependsOn;
use crate::diagnose::data::diagnosis::{Cause, Data, Diagnosis, Gap, Verdict, Where};
use crate::diagnose::data::left_out::Reason;
use crate::diagnose::data::recording::Recording;
use crate::diagnose::likelihood::noise::STATED_LOG_STD;
use crate::diagnose::likelihood::probability::unfinished;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::prepare::first_day::leaves_gross;
use crate::diagnose::principles::{
    ABOVE_SCATTER, FAR_DEVIATIONS, LEAST_HELD_OUT_RATIO, MAJORITY, WORTH_NAMING,
};
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::report::gap_steps::Part;
use crate::diagnose::report::noise_warnings::noise_is_not_stated;
use crate::diagnose::report::rms_shift::noise_square;
use crate::error::Result;
use std::collections::BTreeMap;

/// The warning if objects in the background were detected as markers.
pub(crate) fn background_was_taken(data: &Data) -> Option<String> {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for left in data.left_out.iter().filter(|l| matches!(l.why, Reason::AtOnePixel { .. })) {
        *counts.entry(&left.target).or_default() += 1;
    }
    let told: Vec<String> =
        counts.iter().map(|(target, count)| format!("{target} ({count} times)")).collect();
    (!told.is_empty()).then(|| {
        format!(
            "an object that stands still in the pictures was detected as {}, and is left out: look at its pixel in the list of what was left out, cover the \
             object or give the marker another colour, and record again; nothing is known of a marker that was never seen",
            told.join(", ")
        )
    })
}

/// The warning if causes selected without the held-out region predict clearly worse than the reported ones.
pub(crate) fn hangs_on_regions(gap: &Gap) -> Option<String> {
    let anew = gap.chosen_anew.as_ref()?;
    let (told, other, unit) = match (gap.after_px, anew.rms_px) {
        (Some(told), Some(other)) => (told, other, "px"),
        _ => (gap.after_m? * 1e3, anew.rms_m? * 1e3, "mm"),
    };
    (told < LEAST_HELD_OUT_RATIO * other).then(|| {
        format!(
            "the selection of causes depends on few postures: if it is repeated without one region of the postures, other causes are selected for {} of {} regions, \
             and they predict that region to {other:.2} {unit} instead of {told:.2} {unit}; check the causes on a session of other postures (--check)",
            anew.changed, anew.regions
        )
    })
}

/// Limits what is told of causes beside something unexplained, of which a part may imitate a cause: with R left of the
/// observations beyond noise, up to `R/2` of what a cause moves, S (root mean squares), may be another one's. Its
/// probability is multiplied by `S² / (S² + (R/2)²)`.
///
/// Where what is left is as gross as a mistake of model or log, there is one that is not known. A mistake that was undone
/// may be a part of it, and small errors were estimated beside it: no cause is more probable than not.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn beside_remainder(
    causes: &mut [Cause],
    findings: &Findings<'_>,
    recording: &Recording,
) -> Result<()> {
    if findings.unexplained.is_none() {
        return Ok(());
    }
    let search = &findings.search;
    let deformation = search.deformation(&findings.found.fit.model);
    let left = seen_size(&in_sample(&search.problem, &deformation, search.measured_noise)?).powi(2);
    let remainder = (left - noise_square(&search.problem, search.measured_noise)).max(0.0);
    contradicted_slips(causes, findings);
    one_drift_of_several(causes);
    // A droop is told with the stiction that it belongs to.
    for cause in causes.iter_mut().filter(|c| c.rms_shift > 0.0) {
        let own = cause.rms_shift.powi(2);
        cause.probability *= own / (own + MAJORITY.powi(2) * remainder);
    }
    if !causes.is_empty() && leaves_gross(&search.problem, &deformation, recording)? {
        causes.iter_mut().for_each(|c| c.probability *= MAJORITY);
    }
    Ok(())
}

/// Limits what is told of several joints that drift where something is left: one thing that changes with time (temperature, the base, what
/// measures) is as probable as that each drifts by itself.
fn one_drift_of_several(causes: &mut [Cause]) {
    let drifts = |c: &&mut Cause| c.effect == "drift";
    if causes.iter_mut().filter(drifts).count() > 1 {
        causes.iter_mut().filter(drifts).for_each(|c| c.probability *= MAJORITY);
    }
}

/// Limits what is told of a slip where what is left at its place depends on time: it is no single step there, and a
/// mount that works loose is as probable. Of a slip and the way back, any other error of these rows may be a part.
fn contradicted_slips(causes: &mut [Cause], findings: &Findings<'_>) {
    let scene = &findings.search.problem.scene;
    let places = findings.unexplained.iter().flat_map(|u| &u.places);
    let wandering: Vec<String> =
        places.filter(|p| p.depends_on == Some(DependsOn::Time)).map(|p| p.name(scene)).collect();
    let slips: Vec<String> = causes.iter().filter(|c| c.effect == "slip").map(|c| c.at.clone()).collect();
    let is_back = |at: &String| slips.iter().filter(|other| *other == at).count() > 1;
    let doubtful = |c: &&mut Cause| c.effect == "slip" && (wandering.contains(&c.at) || is_back(&c.at));
    for slip in causes.iter_mut().filter(doubtful) {
        slip.probability *= MAJORITY;
    }
}

/// Whether without any region other causes are selected, or without some, and these predict clearly worse.
fn changes_with_regions(gap: &Gap) -> bool {
    gap.chosen_anew.as_ref().is_some_and(|anew| anew.changed == anew.regions)
        || hangs_on_regions(gap).is_some()
}

/// Limits what is told where the limit of work was reached and a remainder is left, if the selection cannot be trusted
/// either: without a region of postures other causes are selected that predict worse, or in every region others, or small
/// errors everywhere would have to be larger than such errors are. Of each cause, mounts by hand and whole mistakes apart,
/// one that was not tested may be as probable.
fn where_unsettled(diagnosis: &mut Diagnosis, findings: &Findings<'_>) {
    let too_large = findings.geometry.as_ref().is_some_and(Geometry::is_at_its_bound);
    if findings.found.cut_off || !(too_large || changes_with_regions(&diagnosis.gap)) {
        return;
    }
    let whole = |c: &Cause| findings.mistakes.iter().any(|m| m.effect == c.effect && m.at == c.at);
    let stays = |c: &Cause| c.effect.ends_with("_mount") || (whole(c) && c.effect != "slip");
    for cause in diagnosis.causes.iter_mut().filter(|c| !stays(c)) {
        cause.probability = unfinished(cause.probability);
    }
    diagnosis.warnings.push(
        format!(
            "a remainder is left, the search reached its limit of work, and {}: each cause is told as no more probable than one that was not tested",
            if too_large {
                "the small errors would have to be larger than such errors are"
            } else {
                "parts of the postures select other causes"
            }
        ),
    );
}

/// Limits what is told where the search ended at its limit of work: of each cause and each displaced mount, a hypothesis
/// that was not tested may be as probable.
pub(crate) fn where_cut_off(causes: &mut [Cause], parts: &[Part], findings: &Findings<'_>) {
    let searched = causes.iter_mut().zip(parts).filter(|(_, part)| **part != Part::Mistake);
    for (cause, _) in searched.filter(|_| findings.found.cut_off) {
        cause.probability = unfinished(cause.probability);
    }
}

/// Whether a gap is far above its floor: as an outlier of any number of points is, or by more than a stated noise is usually
/// wrong and by more than chance, `1/√(2N)` of the root mean square of N points in a picture (one standard deviation).
fn far(gap: Option<f64>, floor: Option<f64>, points: usize) -> bool {
    let by_chance = 1.0 + FAR_DEVIATIONS / (2.0 * points as f64).sqrt();
    let most = STATED_LOG_STD.exp().max(by_chance).min(ABOVE_SCATTER);
    matches!((gap, floor), (Some(gap), Some(floor)) if gap > most * floor)
}

/// Whether a joint, or its log, is told to stand still in a run of rows: rows beside them are the rest of that.
fn stood_still(diagnosis: &Diagnosis) -> bool {
    diagnosis.causes.iter().any(|c| c.effect == "joint_frozen")
}

/// Whether a place is a joint of which a cause is told.
fn names_joint(diagnosis: &Diagnosis, at: &str) -> bool {
    at.starts_with("joint:") && diagnosis.causes.iter().any(|c| c.at.split("<-").next() == Some(at))
}

/// Tells a law of what was left out as false: nothing is in order then, and nothing is explained by causes elsewhere. Where a
/// cause is told of this joint, these rows may be the rest of what it does.
fn tell_left_out(diagnosis: &mut Diagnosis, place: Where, told: String) {
    match diagnosis.verdict {
        Verdict::None => {
            let at = &place.at;
            diagnosis.sentence = format!(
                "Something without a name lives at {at}: {told}; the rest agrees with the nominal model."
            );
            diagnosis.verdict = Verdict::Unknown;
            diagnosis.r#where = vec![place];
        }
        _ if names_joint(diagnosis, &place.at) => {}
        Verdict::Explained => {
            diagnosis.sentence += &format!(" But {told}.");
            diagnosis.verdict = Verdict::Partial;
            // What was left out has no part in the gap.
            match diagnosis.r#where.iter_mut().find(|own| own.at == place.at) {
                Some(own) => own.depends_on = own.depends_on.take().or(place.depends_on),
                None => diagnosis.r#where.push(Where { share: 0.0, ..place }),
            }
        }
        _ => diagnosis.warnings.push(told),
    }
}

/// Whether the causes predict regions that were held out clearly worse than the nominal model does.
pub(crate) fn worse_than_before(gap: &Gap) -> bool {
    let worse = |before: Option<f64>, after: Option<f64>| matches!((before, after), (Some(before), Some(after)) if before < LEAST_HELD_OUT_RATIO * after);
    match gap.before_m {
        Some(_) => worse(gap.before_m, gap.after_m),
        None => worse(gap.before_px, gap.after_px),
    }
}

/// Names no cause where what was found, whole mistakes included, contradicts itself: the gap is that of the nominal model.
fn name_nothing_more(diagnosis: &mut Diagnosis) {
    let named: Vec<String> = diagnosis.causes.iter().map(|c| format!("{} at {}", c.effect, c.at)).collect();
    diagnosis.trace.push(format!("not named, because the gap grows with it: {}", named.join(", ")));
    diagnosis.sentence =
        "There is a gap that no effect explains: what was found leaves it larger on postures that the fit did not see."
            .into();
    diagnosis.verdict = Verdict::Unknown;
    take_causes_back(diagnosis);
    diagnosis.r#where = vec![Where { at: Where::NOWHERE.into(), share: 1.0, depends_on: None }];
}

/// Without causes: neither what is drawn of them, nor what would separate them, nor how far they close the gap.
fn take_causes_back(diagnosis: &mut Diagnosis) {
    let of_regions = hangs_on_regions(&diagnosis.gap);
    diagnosis.warnings.retain(|told| Some(told) != of_regions.as_ref());
    diagnosis.causes.clear();
    diagnosis.signatures.clear();
    diagnosis.tracks.clear();
    diagnosis.fields.clear();
    diagnosis.next_postures.clear();
    as_before(&mut diagnosis.gap);
}

/// The gap of the nominal model, where nothing is named.
pub(crate) fn as_before(gap: &mut Gap) {
    gap.steps.truncate(1);
    // What could not be predicted is not predicted by the nominal model either.
    if gap.is_told() {
        (gap.after_m, gap.after_px) = (gap.before_m, gap.before_px);
    }
    gap.closed_ci95 = None;
    gap.closed = gap.closed.map(|_| 0.0);
    gap.chosen_anew = None;
}

/// What is told of a cause that with its alternatives is too improbable to be named, but without which the gap is larger: something else is
/// there.
fn improbable(causes: &[Cause]) -> Option<String> {
    let together = |c: &Cause| c.probability + c.alternatives.iter().map(|a| a.probability).sum::<f64>();
    let cause = causes.iter().find(|c| together(c) < WORTH_NAMING)?;
    let place = cause.at.split_once(':').map_or(cause.at.as_str(), |(_, name)| name);
    Some(format!(
        " But {} at {place} is improbable and takes the place of something else.",
        cause.effect.replace('_', " ")
    ))
}

/// What the left-out postures of a marker have in common, if that is told: not where a joint is elsewhere, or stood still, which leaves
/// them out.
pub(crate) fn told_together(diagnosis: &Diagnosis, problem: &Problem) -> Option<LeftOutTogether> {
    if stood_still(diagnosis) || evidence::what_is_elsewhere(&diagnosis.data, problem).is_some() {
        return None;
    }
    left_out_together(&diagnosis.data, problem)
}

/// The warning where a search ended at its limit of work.
pub(crate) const LIMIT_REACHED: &str = "the limit of work was reached: not every alternative was tried, and what is told is of the most probable model found until then";

/// Takes a verdict back that the counted data do not carry. `together`: of [`told_together`].
pub(crate) fn reserve(diagnosis: &mut Diagnosis, findings: &Findings<'_>, together: Option<LeftOutTogether>) {
    if diagnosis.verdict == Verdict::None && evidence::much_is_false(&diagnosis.data) {
        diagnosis.sentence = evidence::what_is_false(&diagnosis.data);
        diagnosis.verdict = Verdict::Unknown;
    }
    let problem = &findings.search.problem;
    if let Some(LeftOutTogether { marker, depends_on, told }) = together {
        let at = format!("marker:{marker}");
        tell_left_out(diagnosis, Where { at, share: 1.0, depends_on: Some(depends_on) }, told);
    } else if let Some((joint, told)) = evidence::what_is_elsewhere(&diagnosis.data, problem) {
        let at = format!("joint:{joint}");
        tell_left_out(diagnosis, Where { at, share: 1.0, depends_on: Some(DependsOn::Row) }, told);
    }
    if let (Verdict::None, Some(told)) = (diagnosis.verdict, evidence::rows_elsewhere(&diagnosis.data)) {
        diagnosis.sentence += &format!(" But {told}.");
    }
    // With too few postures no test may be significant, and tests of most postures do not see what a few leave; a gap far
    // above its own floor is still no agreement.
    let gap = &diagnosis.gap;
    let points = diagnosis.data.points_used;
    let is_far = far(gap.after_px, gap.noise_floor_px, points) || far(gap.after_m, gap.noise_floor_m, points);
    if diagnosis.verdict == Verdict::None && is_far {
        diagnosis.sentence =
            "There is a gap far above the noise floor, and these postures show neither its place nor its law.".into();
        diagnosis.verdict = Verdict::Unknown;
    }
    if diagnosis.verdict == Verdict::Explained && is_far {
        diagnosis.sentence += " But the remaining gap is far above the noise floor: there is another cause.";
        diagnosis.verdict = Verdict::Partial;
    }
    if let Some(told) = improbable(&diagnosis.causes).filter(|_| diagnosis.verdict == Verdict::Explained) {
        diagnosis.sentence += &told;
        diagnosis.verdict = Verdict::Partial;
    }
    if worse_than_before(&diagnosis.gap) && !diagnosis.causes.is_empty() {
        name_nothing_more(diagnosis);
    }
    let at_its_bound = findings.geometry.as_ref().is_some_and(Geometry::is_at_its_bound);
    if at_its_bound && diagnosis.verdict == Verdict::Explained {
        diagnosis.sentence += " But the small errors of geometry would have to be larger than such errors are: there is another cause.";
        diagnosis.verdict = Verdict::Partial;
        diagnosis
            .causes
            .iter_mut()
            .filter(|c| c.effect == "geometry")
            .for_each(|c| c.probability *= MAJORITY);
    }
    // Where nothing was held out and predicted, no agreement is shown.
    if evidence::insufficient(&diagnosis.data) || !diagnosis.gap.is_told() {
        diagnosis.sentence = evidence::what_is_missing(&diagnosis.data);
        diagnosis.verdict = Verdict::Insufficient;
        take_causes_back(diagnosis);
        diagnosis.limits.clear();
        diagnosis.r#where.clear();
    }
    if evidence::many_boards_are_false(&diagnosis.data) {
        let told = evidence::what_boards_are_false(&diagnosis.data);
        if diagnosis.verdict == Verdict::None {
            diagnosis.sentence += &format!(" But {told}.");
        } else {
            diagnosis.warnings.push(told);
        }
    }
    diagnosis.warnings.extend(noise_is_not_stated(diagnosis, findings));
    let budget = &findings.search.problem.budget;
    diagnosis.trace.push(format!("work: {:.0} % of the limit", 100.0 * budget.share_of_session()));
    if budget.is_spent() {
        diagnosis.warnings.push(LIMIT_REACHED.into());
        diagnosis.sentence += match diagnosis.verdict {
            Verdict::Partial | Verdict::Unknown => {
                " The search ended at its limit of work: an effect of the vocabulary may still explain it."
            }
            Verdict::Explained
                if findings.found.cut_off && diagnosis.causes.iter().any(|c| c.kind != "data") =>
            {
                " The search ended at its limit of work: a hypothesis that was not tested may be as probable as each cause."
            }
            _ => "",
        };
        if diagnosis.verdict == Verdict::Partial {
            where_unsettled(diagnosis, findings);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::diagnose::data::diagnosis::ChosenAnew;

    fn gap(after_m: Option<f64>, after_px: Option<f64>, rms_m: Option<f64>, rms_px: Option<f64>) -> Gap {
        Gap {
            before_m: None,
            after_m,
            noise_floor_m: None,
            closed: None,
            closed_ci95: None,
            before_px: None,
            after_px,
            noise_floor_px: None,
            steps: Vec::new(),
            held_out_postures: 40,
            chosen_anew: Some(ChosenAnew { rms_m, rms_px, regions: 5, changed: 2 }),
            checked: Vec::new(),
        }
    }

    #[test]
    fn causes_change_with_the_regions_where_all_do_or_some_predict_worse() {
        let alike = gap(Some(0.00125), Some(0.3), Some(0.00126), Some(0.301));
        assert!(!changes_with_regions(&alike));
        assert!(changes_with_regions(&gap(Some(0.00125), Some(0.3), Some(0.0025), Some(0.4))));
        let all = |changed| {
            let mut gap = alike.clone();
            gap.chosen_anew.iter_mut().for_each(|anew| anew.changed = changed);
            gap
        };
        assert!(!changes_with_regions(&all(4)) && changes_with_regions(&all(5)));
        assert!(!changes_with_regions(&Gap { chosen_anew: None, ..alike }));
    }

    #[test]
    fn a_gap_is_far_above_its_floor_by_more_than_chance_and_a_wrong_stated_noise() {
        let far_of = |gap: f64, points: usize| far(Some(gap), Some(1.0), points);
        assert!(far_of(1.55, 10) && far_of(1.4, 300) && !far_of(1.3, 300));
        assert!(!far_of(1.4, 60) && !far(None, Some(1.0), 300) && !far(Some(2.0), None, 300));
    }

    #[test]
    fn what_hangs_on_few_postures_is_told_in_the_unit_of_the_gap() {
        let in_space = hangs_on_regions(&gap(Some(0.00125), None, Some(0.0025), None)).unwrap();
        assert!(
            in_space.contains("2 of 5 regions") && in_space.contains("to 2.50 mm instead of 1.25 mm"),
            "{in_space}"
        );
        let in_pictures = hangs_on_regions(&gap(Some(0.00125), Some(0.3), Some(0.0025), Some(0.4))).unwrap();
        assert!(in_pictures.contains("to 0.40 px instead of 0.30 px"), "{in_pictures}");
        assert_eq!(hangs_on_regions(&gap(Some(0.00125), None, Some(0.00126), None)), None);
    }

    fn told(gap: Gap) -> Diagnosis {
        let warnings = hangs_on_regions(&gap).into_iter().chain(["one marker only".to_owned()]).collect();
        let cause = |at: &str| Where { at: at.into(), share: 1.0, depends_on: None };
        let field = |over: &str| crate::diagnose::data::diagnosis::Field {
            cause: Some(0),
            at: "camera".into(),
            over: over.into(),
            unit: "px".into(),
            size: [1.0, 1.0],
            points: Vec::new(),
        };
        Diagnosis {
            format: String::new(),
            version: 2,
            interrupted: false,
            verdict: Verdict::Explained,
            sentence: String::new(),
            data: Data::default(),
            causes: Vec::new(),
            r#where: vec![cause("camera")],
            gap,
            limits: Vec::new(),
            next_postures: vec![BTreeMap::new()],
            warnings,
            noise: BTreeMap::new(),
            trace: Vec::new(),
            ranking: Vec::new(),
            signatures: Vec::new(),
            tracks: Vec::new(),
            fields: vec![field("image")],
            markers: Vec::new(),
        }
    }

    #[test]
    fn nothing_is_left_of_causes_that_are_not_named_in_the_end() {
        let before = |mut gap: Gap| {
            (gap.before_m, gap.before_px, gap.closed) = (Some(0.001), Some(0.2), Some(0.9));
            gap
        };
        let mut diagnosis = told(before(gap(Some(0.00125), Some(0.3), Some(0.0025), Some(0.4))));
        assert_eq!(diagnosis.warnings.len(), 2);
        name_nothing_more(&mut diagnosis);
        assert_eq!(diagnosis.warnings, ["one marker only"]);
        assert!(diagnosis.fields.is_empty() && diagnosis.next_postures.is_empty());
        assert_eq!(diagnosis.r#where[0].at, Where::NOWHERE);
        let of = &diagnosis.gap;
        assert_eq!((of.after_m, of.after_px, of.closed), (Some(0.001), Some(0.2), Some(0.0)));
        // Where nothing was predicted, nothing is.
        let mut nothing = before(gap(None, None, None, None));
        as_before(&mut nothing);
        assert_eq!((nothing.after_m, nothing.after_px), (None, None));
    }
}
