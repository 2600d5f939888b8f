//! The sums over frames that the score tests of all hypotheses need, in one pass.
//!
//! For a hypothesis with columns X and the model's active columns C, all whitened and with each frame's mirror
//! projected out: `CᵀC`, `Cᵀr`, and for each hypothesis `XᵀX`, `XᵀC` and `Xᵀr`. Hypotheses share elementary
//! changes, so a frame costs one vector for each elementary change and a few products for each hypothesis.
//!
//! A cause of the model that is taken out needs no pass of its own: with p its parameters and X its columns the
//! residual grows to `r + X p`, to first order, and its own columns are no longer among C.

use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::likelihood::fit::{Active, Group};
use crate::diagnose::likelihood::normal_equations::{by_atom, changes_sight, counts, inner, rounds};
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::frame::{
    Acting, FrameWork, ManyColumns, PROJECTED, Table, Task, Wanted, add_products, stride,
};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::model::work_budget::Effort;
use crate::error::Result;
use core::ops::Range;
use multiversion::multiversion;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::collections::HashMap;

/// The sums of a model and of all hypotheses of a catalogue, those of its own causes among them.
#[derive(Clone)]
pub(crate) struct ScoreSums {
    pub active: Active,
    /// `CᵀC` and `Cᵀr`, without priors.
    pub h: DMatrix<f64>,
    pub g: DVector<f64>,
    /// −2 log likelihood of the data.
    pub cost: f64,
    pub candidates: Vec<CandidateSums>,
    /// Whether a fit of the model sees the same of the board's corners, so that its misfit is that of these sums.
    pub comparable: bool,
}

/// The sums of a hypothesis.
#[derive(Clone)]
pub(crate) struct CandidateSums {
    pub hypothesis: usize,
    pub variant: f64,
    /// Whether its parameters cannot be negative.
    pub positive: bool,
    /// `XᵀX`, the upper triangle.
    pub a: DMatrix<f64>,
    /// `CᵀX`.
    pub b: DMatrix<f64>,
    /// `Xᵀr`.
    pub g: DVector<f64>,
}

impl ScoreSums {
    /// The sums at a model.
    ///
    /// # Errors
    /// Invalid parameters of the camera or mirror.
    pub fn at(
        problem: &Problem,
        catalogue: &Catalogue,
        group: &Group,
        model: &Model,
        noise: Noise,
        mask: Option<&[bool]>,
    ) -> Result<Self> {
        let all = 0..catalogue.hypotheses.len();
        Self::of(problem, (catalogue, all), group, model, noise, mask)
    }

    /// The same of some hypotheses alone.
    ///
    /// # Errors
    /// Invalid parameters of the camera or mirror.
    pub fn of(
        problem: &Problem,
        (catalogue, tried): (&Catalogue, Range<usize>),
        group: &Group,
        model: &Model,
        noise: Noise,
        mask: Option<&[bool]>,
    ) -> Result<Self> {
        let scene = &problem.scene;
        let active = Active::of(problem, catalogue, group, model);
        let deformation = model.deformation(problem, catalogue, &group.columns);
        // With free-form columns of the optics the boards' corners are not condensed: those are summed by themselves, so
        // that all others need not have a row for each corner.
        let is_free = |c: &Column| matches!(c.atom, Atom::FreeOptics(_));
        let together = active.columns.iter().any(is_free);
        let (mut first, mut of_free_optics) = (Candidates::default(), Candidates::default());
        for h in tried {
            let hypothesis = &catalogue.hypotheses[h];
            let zero = vec![0.0; hypothesis.prior_std.len()];
            for &variant in catalogue.laws(h) {
                let columns = catalogue.effect(h).columns(scene, hypothesis.place, variant, &zero);
                let apart = !together && columns.iter().any(is_free);
                if apart { &mut of_free_optics } else { &mut first }.push(h, variant, columns);
            }
        }
        let count = active.columns.len();
        let atoms = first.atoms.iter().chain(&of_free_optics.atoms);
        let everything: Vec<Column> =
            active.columns.iter().cloned().chain(atoms.map(|&a| Column::constant(a))).collect();
        let with_board = changes_sight(problem, &everything);
        let eye = problem.eye(&deformation)?;
        let task = Task {
            deformation: &deformation,
            eye: eye.as_ref(),
            noise,
            with_board,
            gaussian: false,
            wanted: Wanted::default(),
            planes: model.planes.as_deref().map(Vec::as_slice),
            condensed: true,
        };
        let frames = (0..problem.frames.len()).filter(|f| counts(mask, *f)).count();
        for of in [&first, &of_free_optics] {
            let (hypotheses, products) = (of.list.len(), count * of.atoms.len());
            problem.budget.spend(Effort::Screened { frames, hypotheses, products });
        }
        let total = first.summed(problem, &task, &active.columns, mask);
        let at = |i: usize, j: usize| total.base[i.max(j) * stride(count + 1) + i.min(j)];
        let (h, g) = (DMatrix::from_fn(count, count, at), DVector::from_fn(count, |i, _| at(i, count)));
        let told = |(candidate, sums): (&Candidate, Sums)| {
            let bounded = |(_, column): &(usize, Column)| problem.is_least(column.atom);
            let positive = catalogue.effect(candidate.hypothesis).is_positive()
                || !candidate.columns.is_empty() && candidate.columns.iter().all(bounded);
            let (hypothesis, variant) = (candidate.hypothesis, candidate.variant);
            CandidateSums { hypothesis, variant, positive, a: sums.a, b: sums.b, g: sums.g }
        };
        let mut candidates: Vec<CandidateSums> = first.list.iter().zip(total.sums).map(told).collect();
        if !of_free_optics.list.is_empty() {
            let part = of_free_optics.summed(problem, &task, &active.columns, mask);
            candidates.extend(of_free_optics.list.iter().zip(part.sums).map(told));
        }
        // With the corners as rows false ones count less: as they do in a fit that has them so too.
        let comparable = with_board == changes_sight(problem, &active.columns);
        Ok(Self { active, h, g, cost: total.cost, candidates, comparable })
    }
}

struct Candidate {
    hypothesis: usize,
    variant: f64,
    columns: Vec<(usize, Column)>,
    /// Index of the product of the i-th and j-th columns' atoms, `[i * columns + j]` for j ≥ i.
    products: Vec<usize>,
}

/// Hypotheses that are scored in one pass over the frames, with the atoms and the products that they share.
#[derive(Default)]
struct Candidates {
    list: Vec<Candidate>,
    atoms: Vec<Atom>,
    atom_index: HashMap<Atom, usize>,
    pairs: Vec<(usize, usize)>,
    pair_index: HashMap<(usize, usize), usize>,
}

impl Candidates {
    fn push(&mut self, hypothesis: usize, variant: f64, columns: Vec<Column>) {
        let columns: Vec<(usize, Column)> = columns
            .into_iter()
            .map(|c| {
                let next = self.atoms.len();
                let index = *self.atom_index.entry(c.atom).or_insert(next);
                if index == next {
                    self.atoms.push(c.atom);
                }
                (index, c)
            })
            .collect();
        let mut products = vec![0; columns.len() * columns.len()];
        for (i, (a, _)) in columns.iter().enumerate() {
            for (j, (b, _)) in columns.iter().enumerate().skip(i) {
                let next = self.pairs.len();
                let index = *self.pair_index.entry((*a, *b)).or_insert(next);
                if index == next {
                    self.pairs.push((*a, *b));
                }
                products[i * columns.len() + j] = index;
            }
        }
        self.list.push(Candidate { hypothesis, variant, columns, products });
    }

    /// Sums over the frames that `mask` lets count.
    fn summed(&self, problem: &Problem, task: &Task<'_>, active: &[Column], mask: Option<&[bool]>) -> Part {
        let everything: Vec<Column> =
            active.iter().cloned().chain(self.atoms.iter().map(|&a| Column::constant(a))).collect();
        let task = Task { wanted: Wanted::by(&everything), ..*task };
        let mut atoms: Vec<(Atom, Vec<usize>)> = self.atoms.iter().map(|&a| (a, Vec::new())).collect();
        for (atom, indices) in by_atom(active) {
            match self.atom_index.get(&atom) {
                Some(&at) => atoms[at].1 = indices,
                None => atoms.push((atom, indices)),
            }
        }
        let acting = |(at, of): (usize, &(Atom, Vec<usize>))| Acting { atom: of.0, at, weight: 1.0 };
        let what = Screened {
            active,
            every_atom: atoms.iter().enumerate().map(acting).collect(),
            atoms,
            candidate_atoms: self.atoms.len(),
            pairs: &self.pairs,
            candidates: &self.list,
        };
        let mut total = Part::zeros(&what);
        for round in rounds(problem.frames.len()) {
            let parts: Vec<Part> = round
                .into_par_iter()
                .map_init(
                    || Scratch::new(problem),
                    |scratch, frames| {
                        let mut part = Part::zeros(&what);
                        for frame in frames.filter(|&f| counts(mask, f)) {
                            scratch.add_frame(problem, &task, &what, frame, &mut part);
                        }
                        part
                    },
                )
                .collect();
            parts.iter().for_each(|part| total.add(part));
        }
        total
    }
}

/// Sums of one candidate over frames: products of its columns with each other, of the active columns with them (one row each), and of
/// the residual with them.
#[derive(Clone)]
struct Sums {
    a: DMatrix<f64>,
    b: DMatrix<f64>,
    g: DVector<f64>,
}

/// The input of a screening.
struct Screened<'a> {
    active: &'a [Column],
    /// The candidates' atoms first; each with the active columns that it has.
    atoms: Vec<(Atom, Vec<usize>)>,
    every_atom: Vec<Acting>,
    candidate_atoms: usize,
    pairs: &'a [(usize, usize)],
    candidates: &'a [Candidate],
}

/// Sums of some frames.
struct Part {
    /// Products of the active columns, and of the residual as the last, with those before.
    base: Vec<f64>,
    cost: f64,
    sums: Vec<Sums>,
}

impl Part {
    fn zeros(what: &Screened<'_>) -> Self {
        let count = what.active.len();
        let of = |c: &Candidate| {
            let k = c.columns.len();
            Sums { a: DMatrix::zeros(k, k), b: DMatrix::zeros(count, k), g: DVector::zeros(k) }
        };
        Self {
            base: vec![0.0; (count + 1) * stride(count + 1)],
            cost: 0.0,
            sums: what.candidates.iter().map(of).collect(),
        }
    }

    fn add(&mut self, part: &Self) {
        self.base.iter_mut().zip(&part.base).for_each(|(a, b)| *a += b);
        self.cost += part.cost;
        for (total, part) in self.sums.iter_mut().zip(&part.sums) {
            total.a += &part.a;
            total.b += &part.b;
            total.g += &part.g;
        }
    }
}

/// Reusable memory. The residual is stored after the active columns.
struct Scratch {
    work: FrameWork,
    columns: ManyColumns,
    /// Vectors of the atoms.
    by_atom: Vec<f64>,
    /// The active columns with the residual, and the atoms.
    active: Table,
    atoms: Table,
    /// Products of each atom with each active column, and with the residual.
    atom_active: Vec<f64>,
    /// Products of the pairs of atoms.
    pair_products: Vec<f64>,
    /// The columns of a candidate that act in the frame, with their weights.
    acting: Vec<(usize, f64)>,
}

impl Scratch {
    fn new(problem: &Problem) -> Self {
        Self {
            work: FrameWork::new(problem),
            columns: ManyColumns::default(),
            by_atom: Vec::new(),
            active: Table::default(),
            atoms: Table::default(),
            atom_active: Vec::new(),
            pair_products: Vec::new(),
            acting: Vec::new(),
        }
    }

    fn add_frame(
        &mut self,
        problem: &Problem,
        task: &Task<'_>,
        what: &Screened<'_>,
        frame: usize,
        out: &mut Part,
    ) {
        let predicted = self.work.evaluate(problem, task, frame);
        out.cost += self.work.cost;
        if !predicted {
            return;
        }
        let scene = &problem.scene;
        let (rows, count) = (self.work.row_count, what.active.len());
        let length = rows + PROJECTED;
        self.atoms.clear(what.atoms.len(), rows);
        self.columns.write(&self.work, (problem, task.deformation), &what.every_atom, &mut self.atoms);
        self.by_atom.resize(what.atoms.len() * length, 0.0);
        self.active.clear(count + 1, rows);
        for (a, (_, indices)) in what.atoms.iter().enumerate() {
            let vector = &mut self.by_atom[a * length..(a + 1) * length];
            self.atoms.read(a, vector);
            for &i in indices {
                let weight = what.active[i].weight.at(scene, frame);
                if weight != 0.0 {
                    self.active.write(i, vector, weight);
                }
            }
        }
        self.active.write(count, &self.work.residual, 1.0);
        let active = self.active.filled();
        add_products(active, active, true, &mut out.base);
        let stride = stride(count + 1);
        self.atom_active.clear();
        self.atom_active.resize(what.candidate_atoms * stride, 0.0);
        self.atoms.keep_first(what.candidate_atoms);
        add_products(self.atoms.filled(), active, false, &mut self.atom_active);
        self.pair_products.clear();
        self.pair_products.resize(what.pairs.len(), 0.0);
        products_of_pairs(&self.by_atom, length, what.pairs, &mut self.pair_products);
        for (candidate, sums) in what.candidates.iter().zip(&mut out.sums) {
            let columns = &candidate.columns;
            let weighed =
                columns.iter().enumerate().map(|(i, (_, column))| (i, column.weight.at(scene, frame)));
            // Of curves over a joint's positions few values act in a frame.
            self.acting.clear();
            self.acting.extend(weighed.filter(|(_, weight)| *weight != 0.0));
            for (at, &(i, w)) in self.acting.iter().enumerate() {
                let a = columns[i].0;
                let products = &self.atom_active[a * stride..a * stride + count + 1];
                sums.g[i] += w * products[count];
                add_times(&mut sums.b.as_mut_slice()[i * count..(i + 1) * count], w, &products[..count]);
                for &(j, other) in &self.acting[at..] {
                    sums.a[(i, j)] +=
                        w * other * self.pair_products[candidate.products[i * columns.len() + j]];
                }
            }
        }
    }
}

/// The products of some pairs of vectors that stand behind each other, so long each.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn products_of_pairs(vectors: &[f64], length: usize, pairs: &[(usize, usize)], out: &mut [f64]) {
    let vector = |a: usize| &vectors[a * length..(a + 1) * length];
    out.iter_mut().zip(pairs).for_each(|(out, &(a, b))| *out = inner(vector(a), vector(b)));
}

/// Adds a vector times a number.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn add_times(to: &mut [f64], by: f64, vector: &[f64]) {
    to.iter_mut().zip(vector).for_each(|(to, x)| *to += by * x);
}
