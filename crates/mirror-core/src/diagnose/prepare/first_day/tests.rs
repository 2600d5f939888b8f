//! Thresholds for gross mistakes, each on a session in which half or twice the threshold decides otherwise.

#![allow(clippy::unwrap_used, clippy::panic)]

use super::alternatives::Session;
use super::chain::{Chain, extended};
use super::changes::WITHIN_CHANCE;
use super::exchanges::fewest;
use super::misfit::Misfit;
use super::mistake::{LateKind, Mistake, in_time, rows_of_decay};
use super::optics::CLEAR_LOSS;
use super::outlying;
use super::permuted::best_names;
use super::single_cause::{self, Beside, Explained};
use super::table::Table;
use super::variant::Variant;
use crate::diagnose::data::recording::{Recording, Target};
use crate::diagnose::effects::vocabulary;
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::prepare::first_result::FirstResult;
use crate::diagnose::tests::column_world;
use crate::diagnose::tests::gap_world::{Plan, World, Wrong};
use crate::robot::Robot;
use core::f64::consts::FRAC_PI_2;
use nalgebra::{Vector2, Vector3};

const PLAN: Plan = Plan { postures: 12, views: 2, noise_px: 0.05, seed: 1, wrong: Vec::new() };

fn problem_of(world: &World, recording: &Recording) -> Problem {
    Problem::new(&Robot::from_urdf_str(&world.urdf()).unwrap(), recording).unwrap()
}

/// Size of usual errors of the world's robot, m.
fn usual_m(world: &World) -> f64 {
    Misfit::new(&problem_of(world, &world.record(&PLAN))).unwrap().usual_m
}

/// Whether markers that sit elsewhere by shares of the usual size are a gross error.
fn is_gross(shares: &[f64]) -> bool {
    let world = World::new(4, false);
    let usual = usual_m(&world);
    let wrong =
        shares.iter().enumerate().map(|(m, share)| Wrong::Mount(m, [share * usual, 0.0, 0.0])).collect();
    let recording = world.record(&Plan { wrong, ..PLAN });
    let problem = problem_of(&world, &recording);
    let misfit = Misfit::new(&problem).unwrap();
    let frames: Vec<usize> = (0..problem.frames.len()).collect();
    Chain::new(Vec::new(), Variant::of(&recording, &problem), &misfit, &frames).is_gross()
}

#[test]
fn errors_well_below_the_usual_size_are_small_and_errors_of_it_gross() {
    assert!(!is_gross(&[0.6; 6]));
    assert!(is_gross(&[0.9; 6]));
    // One marker alone may be farther off, since it is one of several.
    assert!(!is_gross(&[0.9]));
    assert!(is_gross(&[1.25]));
}

/// In which frames two markers on one link, so many usual sizes apart, are told to have exchanged names, and whether
/// always, of a session in which they have in some frames.
fn exchanged(apart: f64, frames: core::ops::Range<usize>) -> Option<(Vec<usize>, bool)> {
    let mut world = World::new(4, false);
    let usual = usual_m(&world);
    let (_, bone, place) = world.markers[0].clone();
    (world.markers[1].1, world.markers[1].2) = (bone, place);
    world.markers[1].2.x += apart * usual;
    let mut recording = world.record(&PLAN);
    for sighting in recording.frames[frames].iter_mut().flat_map(|frame| &mut frame.sightings) {
        sighting.target = match sighting.target {
            Target::Marker(0) => Target::Marker(1),
            Target::Marker(1) => Target::Marker(0),
            other => other,
        };
    }
    let problem = problem_of(&world, &recording);
    let misfit = Misfit::new(&problem).unwrap();
    let told = Session::new(&problem, &misfit, &[]).of_labels(&Variant::of(&recording, &problem));
    told.into_iter().find_map(|m| match m {
        Mistake::MarkersSwapped { markers: (0 | 1, 0 | 1), frames, always } => Some((frames, always)),
        _ => None,
    })
}

#[test]
fn labels_are_exchanged_where_the_markers_are_apart_by_more_than_errors_are() {
    assert_eq!(exchanged(1.15, 4..14), None);
    let (told, always) = exchanged(2.3, 4..14).unwrap();
    assert!(told.len() >= 6 && told.iter().all(|f| (4..14).contains(f)) && !always, "{told:?}");
}

#[test]
fn labels_that_are_exchanged_in_every_frame_are_no_number() {
    let (told, always) = exchanged(6.0, 0..24).unwrap();
    assert!(told.len() == 24 && always, "{} {always}", told.len());
    let of = |always: bool| Mistake::MarkersSwapped { markers: (0, 1), frames: told.clone(), always };
    assert!(of(true).has_no_number() && !of(false).has_no_number());
}

/// How many observations of a marker are off, how many are left out, and how many wrongly: it is off in `views` of three views of so
/// many postures.
fn left_out(postures_off: usize, views: usize) -> (usize, usize, usize) {
    let world = World::new(4, false);
    let mut recording = world.record(&Plan { postures: 15, views: 3, ..PLAN });
    let is_off = |f: usize| f < 3 * postures_off && f % 3 < views;
    let mut off = 0;
    for f in (0..recording.frames.len()).filter(|f| is_off(*f)) {
        let sightings = recording.frames[f].sightings.iter_mut();
        for sighting in sightings.filter(|s| s.target == Target::Marker(2)) {
            sighting.pixel += Vector2::new(60.0, -45.0 + 7.0 * f as f64);
            off += 1;
        }
    }
    let problem = problem_of(&world, &recording);
    let names: Vec<String> = problem.scene.body.nodes.iter().map(|n| n.joint.clone()).collect();
    let least = Noise { corner_px: 0.05, marker_px: 0.05, point_m: 1.0 };
    let found = outlying::find(&problem, &recording, &names, least).unwrap();
    let wrongly = found.iter().filter(|f| !is_off(f.frame)).count();
    (off, found.iter().map(|f| f.indices.len()).sum(), wrongly)
}

#[test]
fn a_marker_that_is_off_now_and_then_is_false_there_and_one_that_is_off_often_is_a_cause() {
    let (off, found, wrongly) = left_out(1, 3);
    assert!(off > 1 && found == off && wrongly == 0, "{found} of {off}");
    let (off, found, wrongly) = left_out(6, 3);
    assert!(off > 12 && found + wrongly == 0, "{found} of {off}");
}

/// All views of a posture show the same body: where one is off and another is not, the one is false, however often that is.
#[test]
fn a_view_that_another_of_the_same_posture_contradicts_is_false() {
    for views in [1, 2] {
        let (off, found, wrongly) = left_out(8, views);
        assert!(off > 4 * views && found == off && wrongly == 0, "{found} of {off}");
    }
}

/// A world whose right elbow carries its markers so far from its axis, and the elbow's column.
fn with_lever(lever_m: f64) -> (World, usize, usize) {
    let mut world = World::new(4, false);
    let elbow = world.bone("r_elbow");
    for (_, _, place) in world.markers.iter_mut().filter(|(_, bone, _)| *bone == elbow) {
        (place.x, place.z) = (lever_m, 0.0);
    }
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let column = robot.position_names().position(|n| n == "r_elbow").unwrap();
    (world, elbow, column)
}

#[test]
fn a_zero_is_off_by_a_right_angle_where_no_other_number_is_told() {
    let told = |beside: f64| {
        // So near to the axis that the loss does not tell a degree.
        let (world, elbow, joint) = with_lever(0.006);
        let wrong = vec![Wrong::Offset(elbow, FRAC_PI_2 + beside)];
        let recording = world.record(&Plan { wrong, noise_px: 0.02, ..PLAN });
        let problem = problem_of(&world, &recording);
        let misfit = Misfit::new(&problem).unwrap();
        let frames: Vec<usize> = (0..problem.frames.len()).collect();
        let quarter = Mistake::Zero { joint, offset: FRAC_PI_2 };
        let variant = Variant::of(&recording, &problem);
        match Session::new(&problem, &misfit, &[]).refined(&quarter, &variant, &frames) {
            Mistake::Zero { offset, .. } => offset - FRAC_PI_2,
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(told(0.035), 0.0);
    assert!((told(0.075) - 0.075).abs() < 0.008, "{}", told(0.075));
}

#[test]
fn beside_what_is_known_distances_are_those_of_the_noise() {
    let world = World::new(4, false);
    let mount = [0.02, -0.015, 0.01, 0.003, -0.004, 0.002];
    let (elbow, shoulder) = (world.bone("r_elbow"), world.bone("l_shoulder_roll"));
    let wrong = vec![
        Wrong::CameraMount(mount),
        Wrong::Offset(elbow, 0.06),
        Wrong::Tilt(shoulder, 0.03, -0.02),
        Wrong::Mount(1, [0.004, -0.006, 0.003]),
    ];
    let recording = world.record(&Plan { wrong, noise_px: 0.01, ..PLAN });
    let problem = problem_of(&world, &recording);
    let variant = Variant::of(&recording, &problem);
    let node = |name: &str| problem.scene.body.nodes.iter().position(|n| n.joint == name).unwrap();
    let mut known = problem.nominal();
    known.camera_mount = mount.into();
    known.marker_shift[1] = Vector3::new(0.004, -0.006, 0.003);
    known.tilt[node("l_shoulder_roll")] = Vector2::new(0.03, -0.02);
    let frames: Vec<usize> = (0..problem.frames.len()).collect();
    frames.iter().for_each(|&f| known.add_joint_delta(f, node("r_elbow"), 0.06));
    let largest = |misfit: &Misfit<'_>| {
        misfit.distances(&variant, &frames).iter().map(|d| d.size_m).fold(0.0, f64::max)
    };
    let (nominal, beside) =
        (Misfit::new(&problem).unwrap(), Misfit::beside(&problem, &known, &variant).unwrap());
    // A hundredth of a pixel is some 20 µm at these distances.
    assert!(
        largest(&nominal) > 5e-3 && largest(&beside) < 2e-4,
        "{} {}",
        largest(&nominal),
        largest(&beside)
    );
    assert!(beside.usual_m < 0.1 * nominal.usual_m);
}

/// A joint that one alternative holds is no log that stands still in the next, though another joint of the robot never moves; a log that
/// does is told.
#[test]
fn a_joint_that_an_alternative_holds_is_no_log_that_stands_still() {
    let world = World::new(4, false);
    let mut recording = world.record(&PLAN);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let column = |name: &str| robot.position_index(name).unwrap();
    let (held, never) = (column("r_shoulder_roll"), column("l_elbow"));
    recording.frames.iter_mut().for_each(|frame| frame.commanded[never] = 0.1);
    let stop = Mistake::JointFrozen { joint: held, first: 6, last: 17, position: 0.2 };
    let still_logs = |recording: &Recording, stopped: bool| {
        let problem = problem_of(&world, recording);
        let misfit = Misfit::new(&problem).unwrap();
        let mut variant = Variant::of(recording, &problem);
        if stopped {
            stop.on_variant(&mut variant);
        }
        let told = Session::new(&problem, &misfit, &[]).of_stops(&variant);
        told.iter().filter(|m| matches!(m, Mistake::LogFrozen { .. })).cloned().collect::<Vec<_>>()
    };
    assert!(still_logs(&recording, false).is_empty() && still_logs(&recording, true).is_empty());
    recording.frames[6..=17].iter_mut().for_each(|frame| frame.commanded[held] = 0.2);
    assert_eq!(still_logs(&recording, false), [Mistake::LogFrozen { joint: held, first: 6, last: 17 }]);
}

/// Of alternatives that are tried one after another only what moves is posed again: with the same losses, to the last bit, as where nothing
/// is kept. A marker is tried on another link in between, whose nodes the session's own sites may not ride on.
#[test]
fn poses_that_are_kept_are_those_computed_anew() {
    let world = World::new(4, false);
    let recording = world.record(&PLAN);
    let problem = problem_of(&world, &recording);
    let mut known = problem.nominal();
    known.tilt[1] = Vector2::new(0.03, -0.02);
    let frames: Vec<usize> = (0..problem.frames.len()).collect();
    let (kept, mut variant) = (Misfit::given(&problem, &known).unwrap(), Variant::of(&recording, &problem));
    let joints = recording.frames[0].commanded.len();
    for trial in 0..4 * joints {
        let joint = (7 * trial) % joints;
        let column: Vec<f64> = variant.column(joint).iter().map(|q| 0.3 - q).collect();
        variant.set_column(joint, &column);
        let other = trial % variant.sites.len();
        variant.sites.swap(0, other);
        let anew = Misfit::given(&problem, &known).unwrap();
        assert_eq!(kept.mean_losses(&variant, &frames), anew.mean_losses(&variant, &frames), "{trial}");
    }
}

/// A loss that is not below a limit is mostly known after a few frames; one that is below it is the whole one, to the last bit.
#[test]
fn a_loss_is_given_up_only_above_its_limit() {
    let world = World::new(4, false);
    let wrong = vec![Wrong::Offset(world.bone("r_elbow"), 0.2)];
    let recording = world.record(&Plan { wrong, ..PLAN });
    let problem = problem_of(&world, &recording);
    let (misfit, variant) = (Misfit::new(&problem).unwrap(), Variant::of(&recording, &problem));
    let frames: Vec<usize> = (0..problem.frames.len()).collect();
    let whole = misfit.mean_losses(&variant, &frames);
    assert!(whole.0 > 0.01 && whole.1 > whole.0, "{whole:?}");
    assert_eq!(misfit.mean_losses_below(&variant, &frames, 1.001 * whole.0), whole);
    assert_eq!(misfit.mean_losses_below(&variant, &frames, 0.9 * whole.0).0, f64::INFINITY);
}

#[test]
fn a_mistake_is_gone_on_from_where_the_loss_falls_by_what_matters() {
    let gone_on = |lever_m: f64| {
        let (world, elbow, joint) = with_lever(lever_m);
        let recording = world.record(&Plan { wrong: vec![Wrong::Ratio(elbow, 0.25)], ..PLAN });
        let problem = problem_of(&world, &recording);
        let misfit = Misfit::new(&problem).unwrap();
        let frames: Vec<usize> = (0..problem.frames.len()).collect();
        let nominal = Chain::new(Vec::new(), Variant::of(&recording, &problem), &misfit, &frames);
        let found = extended(
            &Session::new(&problem, &misfit, &[]),
            &frames,
            &nominal,
            &[],
            super::misfit::LEAST_FALL,
        );
        let is_it = |m: &Mistake| matches!(m, Mistake::JointUnit { joint: j, .. } if *j == joint);
        found.iter().any(|c| c.mistakes.iter().any(is_it))
    };
    // Losses of 0.025 and 0.04.
    assert!(!gone_on(0.042));
    assert!(gone_on(0.055));
}

#[test]
fn a_closer_look_goes_on_beside_a_mistake_where_nothing_gross_is_left() {
    // The log of the last joint, which moves one marker by little, is late by an eighth of a row; another joint's axis points the other way.
    const PART: f64 = 0.125;
    let real = World::new(6, false);
    let mut recording = real.record(&Plan { postures: 80, views: 1, ..PLAN });
    let mut believed = World::new(6, false);
    let turned = believed.bone("l_shoulder_pitch");
    believed.bones[turned].axis = -believed.bones[turned].axis;
    let robot = Robot::from_urdf_str(&believed.urdf()).unwrap();
    let column = robot.position_index("r_wrist_2").unwrap();
    let old: Vec<f64> = recording.frames.iter().map(|f| f.commanded[column]).collect();
    for f in 1..old.len() {
        recording.frames[f].commanded[column] = (1.0 - PART) * old[f] + PART * old[f - 1];
    }
    let problem = Problem::new(&robot, &recording).unwrap();
    let known = FirstResult { deformation: problem.nominal(), false_frames: Vec::new(), sought: false };
    let told = |closely: bool| {
        let known = Some(&known).filter(|_| closely);
        let undone = super::undone(
            &robot,
            &recording,
            &problem,
            &["slip".to_owned()],
            known,
            super::Suspects::AT_FIRST,
            &mut super::Memory::default(),
        )
        .unwrap();
        let mut told: Vec<String> = undone.unwrap().told.into_iter().map(|c| c.effect).collect();
        told.sort();
        told
    };
    assert_eq!(told(false), ["axis_sign"]);
    assert_eq!(told(true), ["axis_sign", "joint_late"]);
}

#[test]
fn what_ends_a_search_and_what_begins_one_stand_where_chance_and_usual_corners_put_them() {
    // One parameter gains that much by chance in one of 22; half of it in one of six, twice as much in one of 200.
    let by_chance = chi_squared_1_above(WITHIN_CHANCE);
    assert!((0.02..0.1).contains(&by_chance), "{by_chance}");
    // A board's loss is ln(1 + (RMS / usual)²): optics are asked for where the better boards are clearly off, yet no worse than usual ones.
    let of_usual = CLEAR_LOSS.exp_m1().sqrt();
    assert!((0.65..1.0).contains(&of_usual), "{of_usual}");
}

/// P(z² > x) of a standard normal z, by Simpson's rule over z.
fn chi_squared_1_above(x: f64) -> f64 {
    const STEPS: u32 = 1000;
    let h = x.sqrt() / f64::from(STEPS);
    let density = |i: u32| (-0.5 * (f64::from(i) * h).powi(2)).exp();
    let inner: f64 = (1..STEPS).map(|i| if i % 2 == 1 { 4.0 } else { 2.0 } * density(i)).sum();
    1.0 - (density(0) + inner + density(STEPS)) * h / 3.0 * (2.0 / core::f64::consts::PI).sqrt()
}

#[test]
fn a_factor_that_makes_a_column_constant_is_no_unit() {
    let world = World::new(4, false);
    let mut recording = world.record(&PLAN);
    let joint = {
        let problem = problem_of(&world, &recording);
        let misfit = Misfit::new(&problem).unwrap();
        Session::new(&problem, &misfit, &[]).joints[0].0
    };
    let factors = |recording: &Recording| -> Vec<f64> {
        let problem = problem_of(&world, recording);
        let misfit = Misfit::new(&problem).unwrap();
        let session = Session::new(&problem, &misfit, &[]);
        let of_joint = |m| match m {
            Mistake::JointUnit { joint: j, factor } if j == joint => Some(factor),
            _ => None,
        };
        session.of_joints(&Variant::of(recording, &problem), false).into_iter().filter_map(of_joint).collect()
    };
    let degree = 1f64.to_radians();
    assert!(!factors(&recording).contains(&degree) && factors(&recording).contains(&0.5));
    recording.frames.iter_mut().for_each(|f| f.commanded[joint] /= degree);
    assert!(factors(&recording).contains(&degree));
}

/// Of a session in which one marker may be elsewhere from the middle on.
fn explained(wrong: Vec<Wrong>, slipped_m: f64, stated_share: f64) -> Explained {
    let world = World::new(4, false);
    let plan = Plan { postures: 30, views: 3, noise_px: 0.15, seed: 3, wrong };
    let mut after = World::new(4, false);
    after.markers[2].2.x += slipped_m;
    let mut recording = world.record(&plan);
    let half = recording.frames.len() / 2;
    for (frame, moved) in recording.frames.iter_mut().zip(after.record(&plan).frames).skip(half) {
        frame.sightings = moved.sightings;
    }
    let mut problem = problem_of(&world, &recording);
    problem.noise.corner_px = stated_share * plan.noise_px;
    problem.noise.marker_px = stated_share * plan.noise_px;
    single_cause::explained(&problem, single_cause::alone(&problem).unwrap()).unwrap()
}

#[test]
fn one_cause_is_enough_where_it_leaves_the_noise_that_is_stated_or_that_views_show() {
    let bone = World::new(4, false).bone("r_elbow");
    let ratio = || vec![Wrong::Ratio(bone, 0.08)];
    assert_eq!(explained(Vec::new(), 0.0, 1.0), Explained::ByUsual);
    assert_eq!(explained(ratio(), 0.0, 1.0), Explained::ByUsual);
    assert_eq!(explained(ratio(), 0.0, 0.7), Explained::ByUsual);
    assert_eq!(explained(vec![Wrong::Ratio(bone, 0.2)], 0.0, 1.0), Explained::ByLarge);
}

#[test]
fn one_cause_is_not_enough_beside_another_or_where_something_slipped() {
    let bone = World::new(4, false).bone("r_elbow");
    let both = vec![Wrong::Ratio(bone, 0.08), Wrong::Mount(0, [0.01, 0.0, 0.0])];
    assert_eq!(explained(Vec::new(), 0.008, 1.0), Explained::Not);
    assert_eq!(explained(Vec::new(), 0.008, 0.7), Explained::Not);
    assert_eq!(explained(both, 0.0, 1.0), Explained::Not);
}

/// Panes are up to 10 cm thick; a file that tells 9.5 cm of one of 12 makes the linear estimate a pane that is none.
#[test]
fn an_estimate_that_is_no_pane_is_no_cause() {
    let world = World::new(4, false);
    let mut recording = world.record(&Plan { wrong: vec![Wrong::Glass(0.12)], ..PLAN });
    recording.sight.as_mut().unwrap().glass_thickness_m = 0.095;
    let problem = problem_of(&world, &recording);
    let panes = || vocabulary().into_iter().filter(|e| e.name() == "mirror_glass").collect::<Vec<_>>();
    let found = single_cause::likeliest(problem.clone(), panes(), &Beside::nothing(&problem), problem.noise);
    assert!(found.unwrap().is_none_or(|pane| pane.fitted(problem.noise).is_ok()));
}

/// A row after exchanges of its columns, one after the other.
fn carried(pairs: &[(usize, usize)]) -> Vec<usize> {
    let mut row: Vec<usize> = (0..8).collect();
    pairs.iter().for_each(|&(a, b)| row.swap(a, b));
    row
}

#[test]
fn five_exchanges_of_neighbours_may_be_one() {
    assert_eq!(fewest(&[(4, 5), (3, 4), (2, 3), (3, 4), (4, 5)]), [(2, 5)]);
    assert_eq!(fewest(&[(1, 2), (1, 2)]), []);
}

#[test]
fn fewer_exchanges_have_the_same_effect() {
    let some = [vec![(0, 1), (2, 3)], vec![(0, 1), (1, 2), (2, 3)], vec![(5, 2), (2, 7), (7, 5), (0, 2)]];
    for pairs in some {
        let few = fewest(&pairs);
        assert_eq!(carried(&few), carried(&pairs));
        assert!(few.len() <= pairs.len());
    }
}

/// A mixture of each row with the one before, or with the one after (a log that is early), is undone to a hundredth of what is not known,
/// except in the rows that are given up; never are that more than a quarter of them.
#[test]
fn mixtures_are_undone_but_for_the_rows_that_are_given_up() {
    let positions: Vec<f64> = (0..80).map(|f| (f64::from(f) * 1.7).sin()).collect();
    for rows in [0.1, 0.3, 0.42, -0.1, -0.3, -0.42, 0.7, -0.7] {
        let whole = f64::floor(rows);
        let part = rows - whole;
        let at = |f: i64| positions[f.clamp(0, 79) as usize];
        // Late by so many rows: each contains a share of an earlier position, or of a later one.
        let mixed: Vec<f64> =
            (0..80).map(|f| (1.0 - part) * at(f - whole as i64) + part * at(f - whole as i64 - 1)).collect();
        let undone = in_time(&mixed, rows, LateKind::Blend);
        let given_up = rows_of_decay(part, 80) + 1;
        assert!(given_up <= 21, "{rows}: {given_up}");
        for f in given_up..80 - given_up {
            assert!((undone[f] - positions[f]).abs() < 0.02, "{rows}: row {f}");
        }
    }
    assert_eq!((rows_of_decay(0.1, 80), rows_of_decay(0.5, 80), rows_of_decay(0.499, 80)), (3, 20, 20));
}

#[test]
fn the_best_names_are_found_through_exchanges() {
    // Name i is marker i + 1 of five.
    let losses: Vec<Vec<f64>> = (0..5)
        .map(|i| (0..5).map(|j| if j == (i + 1) % 5 { 0.1 } else { 5.0 + (i * j % 3) as f64 }).collect())
        .collect();
    assert_eq!(best_names(&losses), [1, 2, 3, 4, 0]);
    let in_place: Vec<Vec<f64>> =
        (0..3).map(|i| (0..3).map(|j| if i == j { 0.0 } else { 1.0 }).collect()).collect();
    assert_eq!(best_names(&in_place), [0, 1, 2]);
}

#[test]
fn another_unit_of_all_joints_that_turn_leaves_those_that_slide() {
    let problem = column_world::problem();
    let misfit = Misfit::new(&problem).unwrap();
    let mut variant = Variant::at(Table::of(vec![[0.3, 0.2, 40.0]; problem.frames.len()]), &problem);
    let all = Session::new(&problem, &misfit, &[]).of_joints(&variant, false);
    let degrees =
        all.iter().find(|m| matches!(m, Mistake::AllUnits { factor, .. } if *factor == 1_f64.to_radians()));
    degrees.unwrap().on_variant(&mut variant);
    assert_eq!(variant.positions[4], [0.3, 0.2, 40_f64.to_radians()]);
}
