//! Planned sessions: the lazy choice against a plain one, the twins against fits.

use super::gap_world::{Plan, World};
use crate::cancel::Cancel;
use crate::diagnose::likelihood::normal_equations::Normal;
use crate::diagnose::planning::{PlannedSession, Pool};
use crate::error::Error;
use crate::robot::Robot;
use nalgebra::DMatrix;
use std::collections::BTreeMap;

fn session(postures: usize) -> PlannedSession {
    let world = World::new(4, true);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let plan = Plan { postures, noise_px: 0.0, ..Plan::default() };
    PlannedSession::new(&robot, &world.record(&plan), Cancel::default()).unwrap()
}

/// What some frames add to the information, each parameter in deviations of its prior.
fn information(session: &PlannedSession, frames: &[usize]) -> DMatrix<f64> {
    let problem = &session.problem;
    let mask: Vec<bool> = (0..problem.frames.len()).map(|f| frames.contains(&f)).collect();
    let normal =
        Normal::at(problem, &problem.nominal(), problem.noise, &session.columns, true, None, Some(&mask));
    let std = &session.prior_std;
    normal.unwrap().h.map_with_location(|i, j, x| x * std[i] * std[j])
}

fn log_det(matrix: &DMatrix<f64>) -> f64 {
    matrix.clone().cholesky().unwrap().l().diagonal().iter().map(|x| 2.0 * x.ln()).sum()
}

#[test]
fn the_lazy_choice_is_the_plain_one() {
    let session = session(24);
    // Two frames of one posture, two blocks; items of two frames as well.
    let count = session.problem.frames.len();
    let frames: Vec<Vec<usize>> =
        (0..count - 1).map(|f| if f % 5 == 0 { vec![f, f + 1] } else { vec![f] }).collect();
    let block: Vec<usize> = (0..frames.len()).map(|i| usize::from(i >= frames.len() / 2)).collect();
    let posture: Vec<usize> = (0..frames.len()).map(|i| i / 2).collect();
    let pool = Pool { frames: &frames, block: &block, posture: &posture, most: &[4, 3] };
    let chosen = session.choose(&pool).unwrap();
    let of_items: Vec<DMatrix<f64>> = frames.iter().map(|f| information(&session, f)).collect();
    let width = session.columns.len();
    let (mut sum, mut left) = (DMatrix::identity(width, width), [4, 3]);
    let mut taken: Vec<usize> = Vec::new();
    for &item in &chosen {
        let gain = |i: usize| log_det(&(&sum + &of_items[i]));
        let free: Vec<usize> = (0..frames.len())
            .filter(|&i| left[block[i]] > 0 && taken.iter().all(|&t| posture[t] != posture[i]))
            .collect();
        assert!(free.contains(&item), "{item} is not free after {taken:?}");
        let best = free.iter().map(|&i| gain(i)).fold(f64::NEG_INFINITY, f64::max);
        assert!(gain(item) > best - 1e-6 * best.abs(), "{item}: {} of {best}", gain(item));
        sum += &of_items[item];
        left[block[item]] -= 1;
        taken.push(item);
    }
    assert_eq!(left, [0, 0]);
}

#[test]
fn a_pool_that_does_not_fit_is_refused() {
    let session = session(3);
    let frames = vec![vec![0], vec![1]];
    let choose = |block: &[usize], posture: &[usize], frames: &[Vec<usize>]| {
        session.choose(&Pool { frames, block, posture, most: &[1] })
    };
    assert!(matches!(choose(&[0], &[0, 1], &frames), Err(Error::LengthMismatch { .. })));
    assert!(matches!(choose(&[0, 1], &[0, 1], &frames), Err(Error::OutOfRange { .. })));
    assert!(matches!(choose(&[0, 0], &[0, 1], &[vec![0], vec![99]]), Err(Error::OutOfRange { .. })));
    assert_eq!(choose(&[0, 0], &[0, 0], &frames).unwrap().len(), 1);
    assert_eq!(choose(&[], &[], &[]).unwrap(), Vec::<usize>::new());
}

#[test]
fn a_twin_explains_what_the_cause_does_and_another_cause_does_not() {
    let session = session(7);
    let h = information(&session, &(0..session.problem.frames.len()).collect::<Vec<_>>());
    let first = session.first_effect;
    let column_of: BTreeMap<String, &Vec<usize>> = session
        .of
        .iter()
        .map(|(h, columns)| (session.catalogue.name(&session.problem.scene, *h), columns))
        .collect();
    // What is left of the cause's column where the set-up and the other's columns are fitted, by plain elimination.
    let left_of = |cause: usize, others: &[usize]| {
        let free: Vec<usize> = (0..first).chain(others.iter().copied()).collect();
        let block = DMatrix::from_fn(free.len(), free.len(), |a, b| {
            let prior = if free[a] < first { 1.0 } else { 0.01 };
            h[(free[a], free[b])] + if a == b { prior } else { 0.0 }
        });
        let across = DMatrix::from_fn(free.len(), 1, |a, _| h[(free[a], cause)]);
        h[(cause, cause)] - across.dot(&block.lu().solve(&across).unwrap())
    };
    let (mut apart, mut never, mut clear) = (0, 0, 0);
    for one in session.foresee().unwrap().iter().filter(|one| one.parameters.len() == 1) {
        let own = column_of[&format!("{}@{}", one.effect, one.at)];
        if own[0] < first {
            continue;
        }
        for (name, other) in column_of.iter().filter(|(_, other)| other[0] >= first && **other != own) {
            let rise = left_of(own[0], other);
            let twin = one.twins.iter().find(|t| format!("{}@{}", t.effect, t.at) == *name);
            match twin.map(|t| t.apart_from) {
                // By then the misfit has risen by several deviations, and not by many.
                Some(Some(size)) => {
                    let deviations = rise.sqrt() * size / session.usual[own[0]];
                    assert!((1.5..8.0).contains(&deviations), "{one:?} {name}: {deviations}");
                    apart += 1;
                }
                Some(None) => {
                    assert!(rise.sqrt() < 0.8, "{one:?} {name}: {rise}");
                    never += 1;
                }
                // Of a usual size it is seen, or what needs more numbers is no rival.
                None => clear += usize::from(rise.sqrt() > 3.0),
            }
        }
    }
    assert!(apart > 2 && never > 2 && clear > 100, "{apart} {never} {clear}");
}
