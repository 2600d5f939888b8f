//! The board's corners of a frame, condensed to a few rows with the same products.
//!
//! A board has a hundred rows, but they depend on few quantities: the board's motion relative to the camera (six
//! numbers), the optics, the mirror's plane. With B these columns and P the plane's, all weighted, and `[B P]ᵀ[B P]
//! = RᵀR` (Cholesky, without columns that depend on earlier ones), the rows of R have the same products with each
//! other as those of `[B P]`, and `R⁻ᵀ[B P]ᵀr` replaces the residual r. The normal equations are the same, with a
//! dozen rows instead of a hundred.
//!
//! Free-form errors are not among the columns: there are dozens of them, and they are nearly collinear.

use super::products::{PROJECTED, Table, stride};
use crate::diagnose::model::elementary::Twist;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::Size;
use nalgebra::{Matrix3, Vector3};

/// Numbers of the board's motion: a turn and a shift.
pub(super) const MOTION: Size = 6;
/// Columns of the optics, as in `OpticsColumns`: the camera's mount moves the board relative to the camera, the
/// others are separate columns.
pub(super) const OPTICS: Size = 13 - MOTION;

/// The information of a board's corners on the plane.
pub(super) struct BoardSums {
    pub information: Matrix3<f64>,
    pub gradient: Vector3<f64>,
    /// Sum of the whitened residuals' squares.
    pub square: f64,
    /// Corners that are predicted, and how many of these count.
    pub corners: usize,
    pub counted: f64,
}

/// The condensed corners of a frame.
#[derive(Debug, Default)]
pub(super) struct Condensed {
    /// Whether the frame has any.
    pub used: bool,
    /// How many of [`FrameWork::rows`](super::work::FrameWork) these rows replace: the first ones.
    pub corners: usize,
    /// Whether columns by the optics are among them.
    pub has_optics: bool,
    /// How many rows they are.
    pub rank: usize,
    /// How many of them the board's motion moves: the first ones.
    pub(super) of_motion: usize,
    /// R, row by row: motion, optics, plane, residual.
    pub(super) factor: Vec<f64>,
    pub(super) columns: usize,
    /// The point that the board turns about in the motion's columns, in the world.
    pub(super) about: Vector3<f64>,
    /// From the world to the frame in which its turns and shifts are expressed.
    pub(super) turned: Matrix3<f64>,
    /// How the board moves against the camera with each parameter of the camera's mount.
    pub(super) by_mount: Option<[Twist; MOTION]>,
    pub(super) table: Table,
    pub(super) gram: Vec<f64>,
}

impl Condensed {
    fn row(&self, row: usize) -> &[f64] {
        &self.factor[row * self.columns..(row + 1) * self.columns]
    }

    /// The rows of a column that moves the board by a twist; how many of them are not 0.
    pub fn by_twist(&self, twist: &Twist, out: &mut [f64]) -> usize {
        let turn = self.turned * twist.omega;
        let shift = self.turned * (twist.omega.cross(&self.about) + twist.shift);
        let by = [turn.x, turn.y, turn.z, shift.x, shift.y, shift.z];
        for (row, out) in out[..self.of_motion].iter_mut().enumerate() {
            *out = self.row(row)[..MOTION].iter().zip(by).map(|(a, b)| a * b).sum();
        }
        self.of_motion
    }

    /// What a row grows by with each number of a twist in the world: `(Tᵀj₀ + a × Tᵀj₁, Tᵀj₁)` of a row `(j₀, j₁)`, turned
    /// by T, about a.
    pub fn by_world_twist(&self, row: usize) -> [f64; MOTION] {
        let by = &self.row(row)[..MOTION];
        let turn = self.turned.tr_mul(&Vector3::new(by[0], by[1], by[2]));
        let shift = self.turned.tr_mul(&Vector3::new(by[3], by[4], by[5]));
        let turn = turn + self.about.cross(&shift);
        [turn.x, turn.y, turn.z, shift.x, shift.y, shift.z]
    }

    /// The plane's columns of a row.
    pub fn plane_of_row(&self, row: usize) -> [f64; PROJECTED] {
        let first = self.columns - 1 - PROJECTED;
        let row = self.row(row);
        [row[first], row[first + 1], row[first + 2]]
    }

    /// The rows of a column by the optics.
    pub fn by_optics(&self, column: usize, out: &mut [f64]) -> usize {
        match &self.by_mount {
            Some(by_mount) if column < MOTION => self.by_twist(&by_mount[column], out),
            _ => self.copy(column, out),
        }
    }

    fn copy(&self, column: usize, out: &mut [f64]) -> usize {
        for (row, out) in out[..self.rank].iter_mut().enumerate() {
            *out = self.row(row)[column];
        }
        self.rank
    }

    /// The rows' part of a product with the plane's columns, `Pᵀx`.
    pub fn plane_of(&self, x: &[f64]) -> Vector3<f64> {
        let rows = x[..self.rank].iter().enumerate();
        rows.map(|(row, x)| Vector3::from(self.plane_of_row(row)) * *x).sum()
    }

    /// R's rows by the products of all columns with each other.
    pub(super) fn factorise(&mut self) {
        let (m, wide) = (self.columns, stride(self.columns));
        self.factor.clear();
        self.rank = 0;
        for k in 0..m - 1 {
            if k == MOTION {
                self.of_motion = self.rank;
            }
            // What is left of the products with column k once the rows above are taken out.
            let at = self.factor.len();
            self.factor.resize(at + m, 0.0);
            let (above, next) = self.factor.split_at_mut(at);
            for (j, next) in next.iter_mut().enumerate().skip(k) {
                *next = self.gram[j * wide + k];
            }
            for row in above.chunks_exact(m) {
                let share = row[k];
                if share != 0.0 {
                    next[k..].iter_mut().zip(&row[k..]).for_each(|(n, r)| *n -= share * r);
                }
            }
            // Written so that NaN is left out.
            if next[k] > SOLVER.dependent * self.gram[k * wide + k] {
                let root = next[k].sqrt();
                next[k..].iter_mut().for_each(|n| *n /= root);
                self.rank += 1;
            } else {
                self.factor.truncate(at);
            }
        }
    }
}
