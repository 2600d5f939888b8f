//! From a recording to a diagnosis: the order in which the stages run.

use crate::diagnose::assessment::came_back::came_back;
use crate::diagnose::assessment::evidence::{self, Sources};
use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::assessment::left_out_together::LeftOutTogether;
use crate::diagnose::assessment::names_in_file::as_in_file;
use crate::diagnose::assessment::nested::chosen_anew;
use crate::diagnose::assessment::other_session::check;
use crate::diagnose::assessment::survivors::keep_survivors;
use crate::diagnose::assessment::weighed::weighed;
use crate::diagnose::assessment::zero_lost::{BesideStep, tell_step};
use crate::diagnose::criteria::cross_validation::PostureGap;
use crate::diagnose::data::depends_on::DependsOn;
use crate::diagnose::data::diagnosis::Diagnosis;
use crate::diagnose::data::left_out::LeftOut;
use crate::diagnose::data::recording::Recording;
use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::likelihood::fit::Group;
use crate::diagnose::likelihood::noise;
use crate::diagnose::likelihood::nominal_sums::NominalSums;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::model::work_budget::{A_STAGE, WorkBudget};
use crate::diagnose::prepare::first_result::FirstResult;
use crate::diagnose::prepare::options::{DiagnoseOptions, OtherSession};
use crate::diagnose::prepare::prepared::Prepared;
use crate::diagnose::prepare::row_slip::{Slip, is_slipped};
use crate::diagnose::random_effects::free_form::free_forms;
use crate::diagnose::report::board_shape::{NotFlat, not_flat};
use crate::diagnose::report::build;
use crate::diagnose::report::missing_rows::rows_are_missing;
use crate::diagnose::report::noise_warnings::{noise_is_larger, noise_may_be_larger};
use crate::diagnose::report::optics_together;
use crate::diagnose::report::point_scale::beside_one_scale;
use crate::diagnose::report::reservations::{background_was_taken, hangs_on_regions, reserve, told_together};
use crate::diagnose::report::rounded_positions::positions_are_rounded;
use crate::diagnose::report::seen_markers::seen_markers;
use crate::diagnose::report::spoilt_column::column_is_spoilt;
use crate::diagnose::report::warnings::warnings;
use crate::diagnose::selection::correlated_noise::allow_for_correlation;
use crate::diagnose::selection::erratic_joint::column_says_nothing;
use crate::diagnose::selection::long_session::{on_all_frames, part_of_frames};
use crate::diagnose::selection::lost_column::beside_lost_column;
use crate::diagnose::selection::near_ties::from_near_ties;
use crate::diagnose::selection::pairwise_start::from_a_pair;
use crate::diagnose::selection::scattered_joints::beyond_single_causes;
use crate::diagnose::selection::search::{Search, SearchOptions};
use crate::diagnose::selection::small_errors_instead::small_errors_instead;
use crate::diagnose::selection::transmission_errors::with_transmission_errors;
use crate::diagnose::selection::with_setup::{go_on_at_smaller_noise, with_or_without_setup};
use crate::error::Result;
use crate::robot::Robot;
use std::sync::Arc;

/// A diagnosis, and what decides on a second one.
pub(crate) struct Outcome {
    pub diagnosis: Diagnosis,
    /// Rows were left out as slipped, but fit their own postures once the causes are known.
    pub rows_in_order: bool,
    /// A diagnosis under another direction of gravity may explain all.
    pub loads_may_be_turned: bool,
    /// The result without causes that are far larger than such an error usually is.
    pub known: FirstResult,
    /// Whether there are such causes.
    pub too_large: bool,
    /// A joint's error, independent in each posture, is as large as what its column moves.
    pub says_nothing: bool,
    /// Whether a joint's column is not used, in all postures or in some.
    pub lost: bool,
    /// The gap with a lost zero undone; none if no zero was lost.
    pub left_beside_step: Option<BesideStep>,
    /// The gap on regions that the fit did not see, and the noise that it is weighed at.
    pub after: Vec<PostureGap>,
    pub noise: Noise,
    /// The board's shape, if it is not flat: no reason for other assumptions, so it is told of the diagnosis that stays.
    pub not_flat: Option<NotFlat>,
    /// The work of the session so far.
    pub budget: WorkBudget,
}

/// Diagnoses a recording: where the model is wrong, which effect causes it, how far the gap shrinks.
///
/// In order:
///
/// 1. gross mistakes are undone, the noise is estimated, slipped rows are left out (`prepare`);
/// 2. the search for causes, with free mounts where a few causes are not sufficient; in a long session on a part of
///    its frames;
/// 3. noise that is correlated over frames, and near ties;
/// 4. where there is reason for doubt, or mounts were set free, the search with free-form errors, or with an
///    independent error in each posture at one joint;
/// 5. where that leaves a remainder or many causes, the search with small errors everywhere (`geometry`); where these
///    leave a remainder, with the joints' transmission errors among them;
/// 6. where few causes beside a scatter of all joints are more probable than all of this, the search beside it; beside
///    free mounts, where nothing else is nearly as probable, it comes before 4;
/// 7. causes that do not help on held-out regions are dropped, improbable ones are replaced, the remainder is
///    tested against the noise;
/// 8. causes that are not selected again in resamples of the postures are removed;
/// 9. the assessment and the report.
///
/// # Errors
/// A recording that is not valid, links that do not exist, invalid parameters of the camera.
pub(crate) fn diagnose(
    prepared: Prepared,
    robot: &Robot,
    recording: &Recording,
    options: &DiagnoseOptions,
    others: &[OtherSession],
) -> Result<Outcome> {
    let (mut problem, stated) = (prepared.problem.clone(), prepared.stated);
    problem.budget.search_begins();
    let catalogue = options.catalogue(&problem.scene)?;
    let all = Catalogue::with_free_forms(&catalogue, &problem.scene, free_forms(&problem.scene));
    let nominal = Model::nominal(&problem);
    let scatter = noise::effective(&problem, &problem.nominal(), problem.noise, None)?;
    let known = prepared.nominal_sums.clone();
    let sums = match known.filter(|known| known.are_of(&problem, &catalogue, &nominal, scatter)) {
        Some(known) => known,
        None => Arc::new(NominalSums::at(&problem, &catalogue, scatter)?),
    };
    let ranking = sums.screening(&catalogue).scores;

    options.progress.enter("searching for causes");
    problem.budget.allow(1.0 - 2.0 * A_STAGE);
    let part = part_of_frames(&problem);
    let mut search = Search {
        measured_noise: problem.noise,
        noise_widening: 1.0,
        scatter: None,
        problem,
        catalogue: &catalogue,
        group: Group::default(),
        options: SearchOptions::of(options.most_causes),
        mask: part.as_deref(),
        ties: Vec::new(),
        nominal_sums: Some(sums),
    };
    let plain = search.clone();
    let (mut found, setup, extended) = match prepared.lost() {
        Some(lost) => {
            let (found, extended) =
                beside_lost_column(&mut search, lost, &nominal, (stated, &options.without))?;
            (found, None, Some(extended))
        }
        None => {
            let (found, setup) = with_or_without_setup(&mut search, &nominal, stated, &options.without)?;
            (found, setup, None)
        }
    };
    if setup.is_none() && extended.is_none() {
        if let Some(other) = from_a_pair(&search, &found, &nominal)? {
            (search, found) = other;
        }
        // Wrong optics look like noise of the markers until they are known, and a stated noise may be too large, so
        // the noise is estimated again from the residuals.
        let optics = search.deformation(&found.fit.model).optics_differ() || search.problem.camera.is_none();
        if optics {
            go_on_at_smaller_noise(&mut search, &mut found, stated)?;
        }
    }
    allow_for_correlation(&mut search, &mut found)?;
    let mut extended = match extended {
        Some(extended) => extended,
        None => {
            from_near_ties(&mut search, &mut found)?;
            let models = (&mut search, &mut found);
            beyond_single_causes(&plain, models, setup, (&nominal, stated), (options, &all))?
        }
    };

    if prepared.had_small_errors {
        small_errors_instead((&mut search, &mut found), &mut extended, &nominal)?;
    }
    let says_nothing = extended.erratic.is_some_and(|node| column_says_nothing(&search, &found, node));
    on_all_frames(&mut search, &mut found)?;
    with_transmission_errors((&mut search, &mut found), &mut extended)?;

    options.progress.enter("comparing the causes found");
    let mut findings = weighed((search, found), extended, &nominal, &prepared)?;

    options.progress.enter("assessing the result");
    keep_survivors(&mut findings, &ranking)?;
    let left_beside_step = tell_step(&mut findings, &nominal, &prepared)?;
    let rows_in_order = match &prepared.slip {
        Some(slip) => !is_found_again(&findings, &prepared.arranged, slip)?,
        None => false,
    };
    let (deformation, too_large) = findings.known();
    let anew = chosen_anew(&findings, &ranking)?;
    let checked =
        others.iter().map(|other| check(&findings, &prepared, other)).collect::<Result<Vec<_>>>()?;
    let (its_robot, its_recording) = (prepared.robot(robot), prepared.recording(recording));
    let mut diagnosis = build::diagnosis(&mut findings, its_robot, its_recording, &ranking, checked)?;
    diagnosis.gap.chosen_anew = anew;
    let (arranged, left_out) = (&prepared.arranged, &prepared.left_out);
    let sources = Sources { given: recording, arranged, left_out };
    diagnosis.data = evidence::data(&sources, &findings)?;
    diagnosis.warnings = warnings(&findings, &diagnosis.data);
    diagnosis.warnings.extend(hangs_on_regions(&diagnosis.gap));
    let together = told_together(&diagnosis, &findings.search.problem);
    warn_of_data(&mut diagnosis, recording, &prepared, &findings, together.as_ref())?;
    reserve(&mut diagnosis, &findings, together);
    as_in_file(&mut diagnosis.data, &findings.mistakes);
    optics_together::limit(&mut diagnosis);
    let not_flat = not_flat(&findings)?;
    if options.markers {
        diagnosis.markers = seen_markers(&findings)?;
    }
    // Frames that were passed over on the way out left numbers that mean nothing.
    options.cancel.check()?;
    let known = first_result(deformation, &diagnosis, arranged);
    let lost = prepared.lost().is_some();
    let budget = findings.search.problem.budget.clone();
    let noise = findings.search.detector_noise();
    Ok(Outcome {
        rows_in_order,
        loads_may_be_turned: prepared.loads_may_be_turned(),
        known,
        too_large,
        says_nothing,
        lost,
        left_beside_step,
        after: findings.after,
        noise,
        not_flat,
        budget,
        diagnosis,
    })
}

/// What the data themselves show beside the causes.
fn warn_of_data(
    diagnosis: &mut Diagnosis,
    recording: &Recording,
    prepared: &Prepared,
    findings: &Findings<'_>,
    together: Option<&LeftOutTogether>,
) -> Result<()> {
    diagnosis.warnings.extend(background_was_taken(&diagnosis.data));
    let told = together.filter(|it| it.depends_on == DependsOn::Time).map(|it| it.marker.as_str());
    diagnosis.warnings.extend(came_back(&findings.search.problem, &diagnosis.data, told));
    diagnosis.warnings.extend(rows_are_missing(recording));
    diagnosis.warnings.extend(column_is_spoilt(prepared, &prepared.arranged.frame_numbers));
    diagnosis.warnings.extend(positions_are_rounded(findings)?);
    diagnosis.warnings.extend(noise_is_larger(findings, recording));
    diagnosis.warnings.extend(noise_may_be_larger(findings)?);
    beside_one_scale(diagnosis, findings)?;
    Ok(())
}

/// What a second diagnosis begins with: the deformation found, and the frames in which something was left out as false.
fn first_result(deformation: Deformation, diagnosis: &Diagnosis, arranged: &Problem) -> FirstResult {
    let number_of = |left: &LeftOut| arranged.frame_numbers.iter().position(|n| *n == left.frame);
    let left_out = diagnosis.data.left_out.iter().filter(|l| l.is_false());
    FirstResult { deformation, false_frames: left_out.filter_map(number_of).collect(), sought: false }
}

/// Whether slipped rows are still slipped given the causes found.
fn is_found_again(findings: &Findings<'_>, all_rows: &Problem, slip: &Slip) -> Result<bool> {
    let (search, model) = (&findings.search, &findings.found.fit.model);
    let as_found = |problem: &Problem| model.deformation(problem, search.catalogue, &search.group.columns);
    // Beside something unexplained rows fit their own postures no better than that lets them.
    let mut noise = findings.found.noise;
    if findings.unexplained.is_some() {
        noise = noise::effective(&search.problem, &search.deformation(model), noise, None)?;
    }
    is_slipped(all_rows, as_found, noise, slip)
}
