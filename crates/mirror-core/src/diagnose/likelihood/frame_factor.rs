//! What single frames add to the information on some columns, as factors: `JᵀJ = XᵀX − PᵀP`, with X the frame's whitened
//! rows and P their parts along the mirror's plane.
//!
//! J has as few rows as the frame has independent numbers. It comes from a Cholesky factorisation with pivots, which
//! ends where no column has any information left (Higham, "Analysis of the Cholesky decomposition of a semi-definite
//! matrix", 1990).

use crate::diagnose::likelihood::normal_equations::by_atom;
use crate::diagnose::model::camera_and_mirror::Eye;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::frame::{Acting, FrameWork, ManyColumns, PROJECTED, Table, Task, Wanted};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::principles::Guard;
use crate::error::Result;
use nalgebra::{DMatrix, DVector, RowDVector};
use rayon::prelude::*;

/// Information on a parameter that is rounding: so much of the largest.
const ROUNDING: Guard = 1e-13;

/// The factor J of each of these frames at a deformation, one row each for what is independent in it, by parameters in the
/// given units; none of a frame that shows nothing.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn frame_factors(
    problem: &Problem,
    deformation: &Deformation,
    noise: Noise,
    (columns, units): (&[Column], &[f64]),
    frames: &[usize],
) -> Result<Vec<Option<DMatrix<f64>>>> {
    let eye = problem.eye(deformation)?;
    let (eye, by_atom) = (eye.as_ref(), by_atom(columns));
    let asked = Asked { problem, deformation, eye, noise, columns, units, by_atom };
    let new = || (FrameWork::new(problem), ManyColumns::default(), Table::default());
    Ok(frames.par_iter().map_init(new, |memory, &frame| asked.of_frame(memory, frame)).collect())
}

struct Asked<'a> {
    problem: &'a Problem,
    deformation: &'a Deformation,
    eye: Option<&'a Eye>,
    noise: Noise,
    columns: &'a [Column],
    units: &'a [f64],
    by_atom: Vec<(Atom, Vec<usize>)>,
}

impl Asked<'_> {
    fn of_frame(
        &self,
        (work, many, table): &mut (FrameWork, ManyColumns, Table),
        frame: usize,
    ) -> Option<DMatrix<f64>> {
        let task = Task {
            deformation: self.deformation,
            eye: self.eye,
            noise: self.noise,
            with_board: true,
            gaussian: true,
            wanted: Wanted::by(self.columns),
            planes: None,
            condensed: true,
        };
        if !work.evaluate(self.problem, &task, frame) {
            return None;
        }
        let mut acting = Vec::with_capacity(self.columns.len());
        for (atom, indices) in &self.by_atom {
            let weighted =
                indices.iter().map(|&at| (at, self.columns[at].weight.at(&self.problem.scene, frame)));
            acting.extend(weighted.map(|(at, weight)| Acting { atom: *atom, at, weight }));
        }
        acting.retain(|column| column.weight != 0.0);
        table.clear(self.columns.len(), work.row_count);
        many.write(work, (self.problem, self.deformation), &acting, table);
        let values = table.rows().flat_map(|row| row.iter().zip(self.units).map(|(x, unit)| x * unit));
        let all = DMatrix::from_row_iterator(table.rows().len(), self.columns.len(), values);
        let own = all.rows(0, work.row_count);
        let along = all.rows(work.row_count, PROJECTED);
        Some(factor(own.tr_mul(&own) - along.tr_mul(&along)))
    }
}

/// J with `JᵀJ = H` of a positive semi-definite H, row by row from the column with most information left.
fn factor(mut left: DMatrix<f64>) -> DMatrix<f64> {
    let mut rows: Vec<RowDVector<f64>> = Vec::new();
    let least = ROUNDING * left.diagonal().amax();
    for _ in 0..left.nrows() {
        let (pivot, most) = left.diagonal().argmax();
        if !(most > least) {
            break;
        }
        let column: DVector<f64> = left.column(pivot) / most.sqrt();
        left.ger(-1.0, &column, &column, 1.0);
        rows.push(column.transpose());
    }
    if rows.is_empty() { DMatrix::zeros(0, left.ncols()) } else { DMatrix::from_rows(&rows) }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_factor_has_as_many_rows_as_the_rank() {
        let root = DMatrix::from_fn(3, 7, |i, j| {
            (((3 * i + 5 * j * j) % 11) as f64 - 4.0) * 10_f64.powi(j as i32 - 3)
        });
        let whole = root.tr_mul(&root);
        let j = factor(whole.clone());
        assert_eq!(j.nrows(), 3);
        assert!((j.tr_mul(&j) - &whole).amax() < 1e-12 * whole.amax());
        assert_eq!(factor(DMatrix::zeros(4, 4)).shape(), (0, 4));
    }
}
