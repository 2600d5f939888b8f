//! Many columns of a frame at once, row by row, into its table.
//!
//! An elementary change of the body moves a target by a twist `(ω, s)`, and a row with the derivative b by the target's
//! position p grows by `b·(ω × p + s) = (p × b)·ω + b·s`: six numbers of the row times six of the column. With the
//! columns side by side these are sums of six rows, which vector registers add. Columns of the optics are copied; the
//! few others (free forms, pictures, joints that others follow) are computed by [`FrameWork::column`], one by one.

use super::columns::optics_column;
use super::condensed::MOTION;
use super::products::{PROJECTED, Table};
use super::target::Target;
use super::work::FrameWork;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::elementary::{Atom, followers};
use crate::diagnose::model::problem::Problem;
use multiversion::multiversion;
use nalgebra::Vector3;

/// A column that acts in a frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Acting {
    /// Columns of one atom are neighbours.
    pub atom: Atom,
    /// Its place in the table.
    pub at: usize,
    pub weight: f64,
}

/// How each column moves a target.
#[derive(Debug)]
struct Signs {
    of: Target,
    /// By the columns' places in the table.
    by_place: Vec<f64>,
    /// Whether any does.
    any: bool,
}

/// Reusable memory.
#[derive(Debug, Default)]
pub(crate) struct ManyColumns {
    /// The columns that are twists, by their atoms and places in a table so wide; and those of the frame before.
    moving: Vec<(Atom, usize)>,
    before: Vec<(Atom, usize)>,
    width: usize,
    /// Six rows as wide as the table: their twists times their weights.
    twists: Vec<f64>,
    /// Their signs for each target that was met since they changed.
    signs: Vec<Signs>,
    vector: Vec<f64>,
}

impl ManyColumns {
    /// Writes the columns that act in the frame that was evaluated; the table is clear, and wide enough.
    pub fn write(
        &mut self,
        work: &FrameWork,
        (problem, deformation): (&Problem, &Deformation),
        columns: &[Acting],
        table: &mut Table,
    ) {
        self.find_twists(work, (problem, deformation), columns, table.width());
        self.write_moving(work, problem, table);
        self.write_optics(work, columns, table);
        project(work, table);
        // These come with their own parts along the plane.
        for column in columns.iter().filter(|c| is_single(problem, c.atom)) {
            self.vector.resize(work.row_count + PROJECTED, 0.0);
            if work.column(problem, deformation, column.atom, &mut self.vector) {
                table.write(column.at, &self.vector, column.weight);
            }
        }
    }

    fn find_twists(
        &mut self,
        work: &FrameWork,
        (problem, deformation): (&Problem, &Deformation),
        columns: &[Acting],
        width: usize,
    ) {
        core::mem::swap(&mut self.moving, &mut self.before);
        self.moving.clear();
        self.twists.clear();
        self.twists.resize(MOTION * width, 0.0);
        for of_atom in columns.chunk_by(|one, next| one.atom == next.atom) {
            let atom = of_atom[0].atom;
            if is_single(problem, atom) {
                continue;
            }
            let Some(twist) = work.twist_of(problem, deformation, atom) else { continue };
            for column in of_atom {
                self.moving.push((atom, column.at));
                for k in 0..3 {
                    self.twists[k * width + column.at] = column.weight * twist.omega[k];
                    self.twists[(3 + k) * width + column.at] = column.weight * twist.shift[k];
                }
            }
        }
        if self.width != width || self.moving != self.before {
            self.signs.clear();
        }
        self.width = width;
    }

    fn write_moving(&mut self, work: &FrameWork, problem: &Problem, table: &mut Table) {
        let condensed = &work.condensed;
        let mut at = 0;
        if condensed.used {
            let board = Target::board(problem, work.frame);
            if let Some(signs) = board.and_then(|target| self.find_signs(problem, target)) {
                for row in 0..condensed.of_motion {
                    let by = condensed.by_world_twist(row);
                    write_row(&self.twists, &self.signs[signs].by_place, &by, table.row_mut(row));
                }
            }
            at = condensed.rank;
        }
        for rows in work.rows[condensed.corners..].chunk_by(|_, next| next.continues) {
            let Some(signs) = self.find_signs(problem, Target::of(&rows[0])) else {
                at += rows.iter().map(|row| row.count).sum::<usize>();
                continue;
            };
            for row in rows {
                for k in 0..row.count {
                    let by: Vector3<f64> = row.by_world.row(k).transpose();
                    let turn = row.point.cross(&by);
                    let by = [turn.x, turn.y, turn.z, by.x, by.y, by.z];
                    write_row(&self.twists, &self.signs[signs].by_place, &by, table.row_mut(at + k));
                }
                at += row.count;
            }
        }
    }

    /// Which of the signs are those for a target; none where no column moves it.
    fn find_signs(&mut self, problem: &Problem, target: Target) -> Option<usize> {
        let known = self.signs.iter().position(|signs| signs.of == target).unwrap_or_else(|| {
            let mut by_place = vec![0.0; self.width];
            self.moving
                .iter()
                .for_each(|(atom, at)| by_place[*at] = target.sign(problem, *atom).unwrap_or(0.0));
            let any = by_place.iter().any(|sign| *sign != 0.0);
            self.signs.push(Signs { of: target, by_place, any });
            self.signs.len() - 1
        });
        self.signs[known].any.then_some(known)
    }

    fn write_optics(&mut self, work: &FrameWork, columns: &[Acting], table: &mut Table) {
        let condensed = &work.condensed;
        for column in columns {
            let Some(k) = optics_column(column.atom) else { continue };
            let mut at = 0;
            if condensed.used {
                at = condensed.rank;
                if condensed.has_optics {
                    self.vector.resize(at, 0.0);
                    let end = condensed.by_optics(k, &mut self.vector[..at]);
                    for row in 0..end {
                        table.row_mut(row)[column.at] = column.weight * self.vector[row];
                    }
                }
            }
            for row in &work.rows[condensed.corners..] {
                let optics = row.optics.filter(|_| !row.measured).and_then(|o| work.optics.get(o));
                if let Some(optics) = optics {
                    table.row_mut(at)[column.at] = column.weight * optics[(0, k)];
                    table.row_mut(at + 1)[column.at] = column.weight * optics[(1, k)];
                }
                at += row.count;
            }
        }
    }
}

/// Whether a column is computed by itself: neither one twist nor of the optics.
fn is_single(problem: &Problem, atom: Atom) -> bool {
    match atom {
        Atom::MarkerImage(..) | Atom::FreeOptics(_) | Atom::FramePose(_) => true,
        _ => !followers(atom, &problem.scene).is_empty(),
    }
}

/// The parts of all columns along the plane's parameters, `L⁻¹Dᵀx`.
fn project(work: &FrameWork, table: &mut Table) {
    if !work.has_plane {
        return;
    }
    let condensed = &work.condensed;
    let mut at = 0;
    if condensed.used {
        for row in 0..condensed.rank {
            table.add_along(row, &condensed.plane_of_row(row));
        }
        at = condensed.rank;
    }
    for row in &work.rows[condensed.corners..] {
        for k in 0..row.count {
            table.add_along(at + k, &[row.plane[(k, 0)], row.plane[(k, 1)], row.plane[(k, 2)]]);
        }
        at += row.count;
    }
    table.transform_along(&work.plane_inverse_factor);
}

/// Writes a row of all columns, `signs · (twistsᵀ by)`.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn write_row(twists: &[f64], signs: &[f64], by: &[f64; MOTION], out: &mut [f64]) {
    let width = out.len();
    let (a, rest) = twists.split_at(width);
    let (b, rest) = rest.split_at(width);
    let (c, rest) = rest.split_at(width);
    let (d, rest) = rest.split_at(width);
    let (e, f) = rest.split_at(width);
    let (signs, f) = (&signs[..width], &f[..width]);
    for i in 0..width {
        let turn = by[0] * a[i] + by[1] * b[i] + by[2] * c[i];
        out[i] = signs[i] * (turn + (by[3] * d[i] + by[4] * e[i] + by[5] * f[i]));
    }
}
