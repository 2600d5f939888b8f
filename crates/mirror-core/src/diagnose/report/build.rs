//! Builds the diagnosis from the findings: verdict, causes with probabilities, where the gap lies, before and after. Data and warnings
//! are added to it.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::assessment::further_cause::beside_further_cause;
use crate::diagnose::assessment::gap_closed::gap_over;
use crate::diagnose::assessment::limits::limits;
use crate::diagnose::assessment::noise_floor::Floor;
use crate::diagnose::assessment::resample_deviations::at_least_over_resamples;
use crate::diagnose::assessment::stability::stability;
use crate::diagnose::assessment::uncertainty::deviations;
use crate::diagnose::criteria::regions::regions;
use crate::diagnose::data::checked::Checked;
use crate::diagnose::data::diagnosis::{Cause, Data, Diagnosis, Ranked, VERSION, Verdict};
use crate::diagnose::data::recording::Recording;
use crate::diagnose::likelihood::score_test::{Score, Screening, screen};
use crate::diagnose::principles::Size;
use crate::diagnose::report::another_resolution::put_together;
use crate::diagnose::report::gap_steps::{Part, gap_steps};
use crate::diagnose::report::joint_signatures::signatures;
use crate::diagnose::report::named_causes::named_causes;
use crate::diagnose::report::places::{nothing_was_compared, places};
use crate::diagnose::report::reservations::{as_before, beside_remainder, where_cut_off, worse_than_before};
use crate::diagnose::report::sentence::sentence;
use crate::diagnose::selection::standing::Standing;
use crate::error::Result;
use crate::robot::Robot;
use std::collections::BTreeMap;

/// Hypotheses of the ranking that are written.
const RANKED: Size = 40;
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
    let mut deviations = deviations(findings, &floor)?;
    at_least_over_resamples(&mut deviations, findings, &standings, ranking)?;
    let screening = beside_mounts(findings)?;
    if let Some(screening) = &screening {
        let (catalogue, scene) = (findings.search.catalogue, &findings.search.problem.scene);
        beside_further_cause(screening, (catalogue, scene), &mut deviations);
    }
    let mut told = named_causes(findings, &standings, &deviations)?;
    put_together(&mut told, &findings.search.problem);
    // Without which nothing could be compared: no number says how much that moves, and all else is less.
    let unmeasured = nothing_was_compared(findings);
    let whole = |part: &Part| unmeasured && *part == Part::Mistake;
    told.sort_by(|a, b| whole(&b.1).cmp(&whole(&a.1)).then_with(|| b.0.rms_shift.total_cmp(&a.0.rms_shift)));
    let (mut causes, parts): (Vec<Cause>, Vec<Part>) = told.into_iter().unzip();
    add_stability(findings, &standings, ranking, (&mut causes, &parts))?;
    beside_remainder(&mut causes, findings, recording)?;
    where_cut_off(&mut causes, &parts, findings);
    let mut gap = gap_over(&findings.before, &findings.after, &floor, &deviations.law_shifts, checked);
    gap.steps = gap_steps(findings, &causes, &parts)?;
    // Of a single region nothing is held out.
    if regions(findings.reported()).iter().all(|region| *region == 0) {
        gap.held_out_postures = 0;
    }
    if causes.is_empty() && worse_than_before(&gap) {
        as_before(&mut gap);
    }
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
    let sentence = sentence(verdict, &causes, &places, &gap, &findings.in_picture_only);
    Ok(Diagnosis {
        format: "mirror-posture/diagnosis".into(),
        version: VERSION,
        interrupted: false,
        verdict,
        sentence,
        r#where: places,
        gap,
        limits: limits(findings, screening.as_ref())?,
        next_postures: crate::diagnose::assessment::design::next_postures(
            findings, &standings, robot, recording,
        )?,
        warnings: Vec::new(),
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

/// The score test of all hypotheses at the model found with its mounts and small errors; none where it has none.
fn beside_mounts(findings: &Findings<'_>) -> Result<Option<Screening>> {
    let (search, found) = (&findings.search, &findings.found);
    if found.fit.model.group.is_empty() {
        return Ok(None);
    }
    let (problem, catalogue, model) = (&search.problem, search.catalogue, &found.fit.model);
    screen(problem, catalogue, &search.group, model, found.noise, search.mask).map(Some)
}

/// Adds its stability to each cause that was found by the score test.
fn add_stability(
    findings: &mut Findings<'_>,
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
