//! Sums of products of columns that act alike in all frames: `H = Σ ⟨x, xᵀ⟩`, `g = Σ ⟨x, r⟩`.

use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::elementary::Atom;
use crate::diagnose::model::frame::{Acting, FrameWork, ManyColumns, Table, add_products, stride};
use crate::diagnose::model::problem::Problem;
use nalgebra::{DMatrix, DVector};

/// The sums, and reusable memory.
pub(super) struct ConstantColumns {
    acting: Vec<Acting>,
    columns: ManyColumns,
    table: Table,
    /// Products of the columns, and of the residual as the last, with those before.
    products: Vec<f64>,
}

impl ConstantColumns {
    pub fn of(atoms: impl Iterator<Item = Atom>) -> Self {
        let acting = atoms.enumerate().map(|(at, atom)| Acting { atom, at, weight: 1.0 }).collect();
        let mut out =
            Self { acting, columns: ManyColumns::default(), table: Table::default(), products: Vec::new() };
        out.clear();
        out
    }

    /// Begins anew.
    pub fn clear(&mut self) {
        let count = self.acting.len() + 1;
        self.products.clear();
        self.products.resize(count * stride(count), 0.0);
    }

    /// Adds the frame that was evaluated.
    pub fn add(&mut self, work: &FrameWork, problem: &Problem, deformation: &Deformation) {
        let count = self.acting.len();
        self.table.clear(count + 1, work.row_count);
        self.columns.write(work, (problem, deformation), &self.acting, &mut self.table);
        self.table.write(count, &work.residual, 1.0);
        let table = self.table.filled();
        add_products(table, table, true, &mut self.products);
    }

    /// `H`.
    pub fn information(&self) -> DMatrix<f64> {
        let count = self.acting.len();
        let wide = stride(count + 1);
        DMatrix::from_fn(count, count, |i, j| self.products[i.max(j) * wide + i.min(j)])
    }

    /// `g`.
    pub fn gradient(&self) -> DVector<f64> {
        let count = self.acting.len();
        DVector::from_row_slice(&self.products[count * stride(count + 1)..][..count])
    }
}
