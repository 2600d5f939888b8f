//! All columns of a frame at once against each by itself, which is checked against differences.

use super::column_world;
use super::jacobians::{atoms, problem_with, problem_with_gears, somewhere, task};
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::elementary::Atom;
use crate::diagnose::model::frame::{Acting, FrameWork, ManyColumns, PROJECTED, Table};
use crate::diagnose::model::problem::Problem;

/// The largest difference between the table's columns and those by themselves, and how many columns are not 0.
fn difference(problem: &Problem, deformation: &Deformation, condensed: bool) -> (f64, usize) {
    let eye = problem.eye(deformation).unwrap();
    let task = task(problem, deformation, eye.as_ref(), !condensed, condensed);
    let mut work = FrameWork::new(problem);
    let mut all = atoms(problem);
    all.extend((0..6).flat_map(|k| [Atom::BoardSlip(k), Atom::FramePose(k)]));
    all.retain(|atom| !condensed || !matches!(atom, Atom::FreeOptics(_)));
    // Two columns of each atom, the second one with another weight; every third atom has only one.
    let mut acting = Vec::new();
    for (index, &atom) in all.iter().enumerate() {
        for weight in [0.7, -1.3].into_iter().take(if index % 3 == 0 { 1 } else { 2 }) {
            acting.push(Acting { atom, at: acting.len(), weight });
        }
    }
    let (mut table, mut columns) = (Table::default(), ManyColumns::default());
    let (mut worst, mut moving) = (0.0_f64, 0);
    for frame in 0..problem.frames.len() {
        assert!(work.evaluate(problem, &task, frame));
        table.clear(acting.len(), work.row_count);
        columns.write(&work, (problem, deformation), &acting, &mut table);
        let (mut own, mut of_table) =
            (vec![0.0; work.row_count + PROJECTED], vec![0.0; work.row_count + PROJECTED]);
        for column in &acting {
            moving += usize::from(work.column(problem, deformation, column.atom, &mut own));
            table.read(column.at, &mut of_table);
            let scale = own.iter().fold(1e-9_f64, |most, x| most.max(x.abs()));
            for (one, other) in own.iter().zip(&of_table) {
                worst = worst.max((column.weight * one - other).abs() / scale);
            }
        }
    }
    (worst, moving)
}

#[test]
fn many_columns_at_once_are_each_by_itself() {
    let mut problems = vec![problem_with(true), problem_with(false), problem_with_gears()];
    let mut deformations: Vec<Deformation> = problems.iter().map(somewhere).collect();
    problems.push(column_world::problem());
    deformations.push(problems[3].nominal());
    for (problem, deformation) in problems.iter().zip(&deformations) {
        for condensed in [false, true] {
            let (worst, moving) = difference(problem, deformation, condensed);
            assert!(worst < 1e-11, "{worst:e}");
            assert!(moving > 20 * problem.frames.len(), "{moving}");
        }
    }
}
