//! Screening: the score test of every effect at every place at once, given the causes that the model already
//! contains.
//!
//! For a hypothesis with columns X and the model's active columns C (nuisance parameters, group, causes), all
//! whitened and with each frame's mirror projected out, the test needs only `XᵀX`, `XᵀC` and `Xᵀr`: no fit.
//! Hypotheses share elementary changes, so a frame costs one vector for each elementary change and a few products
//! for each hypothesis.
//!
//! Source: the score (Lagrange multiplier) test, Rao 1948; the evidence is that of the linearised model.

use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::likelihood::fit::{Active, Group};
use crate::diagnose::likelihood::normal_equations::{by_atom, counts, inner, needs_board, rounds};
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::frame::{FrameWork, PROJECTED, Span, Table, Task, Wanted, add_products, stride};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::error::Result;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;
use std::collections::HashMap;

/// The result of the score test of one hypothesis.
#[derive(Debug, Clone)]
pub(crate) struct Score {
    pub hypothesis: usize,
    pub variant: f64,
    /// Log Bayes factor of the model with this cause against the model without it, linearised.
    pub log_bayes: f64,
    /// The linearised estimate.
    pub parameters: Vec<f64>,
    /// The information on the parameters with everything in the model free: the inverse of their covariance.
    pub information: DMatrix<f64>,
    /// `L⁻¹ B p` of these parameters p: the change of all that the model already contains.
    pub across: DVector<f64>,
}

/// The Cholesky factor L of the model's columns, and `L⁻¹ g` of its gradient.
type Base = (Cholesky<f64, Dyn>, DVector<f64>);

/// All hypotheses scored, best first, given the model.
pub(crate) struct Screening {
    pub scores: Vec<Score>,
    /// The misfit of the model at its current values; none if a fit of it changes which of the board's corners are
    /// visible.
    pub misfit: Option<f64>,
    base: Option<Base>,
}

impl Screening {
    /// How far all that the model has already moves along with a hypothesis at its estimate, linearised: `L⁻ᵀ (L⁻¹ g − L⁻¹ B p)`. None where
    /// numbers overflow.
    pub fn moved_along(&self, score: &Score) -> Option<DVector<f64>> {
        let (factor, along) = self.base.as_ref()?;
        let left = along - &score.across;
        factor.l_dirty().tr_solve_lower_triangular(&left).filter(|step| step.iter().all(|x| x.is_finite()))
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
        let what = Screened {
            active,
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

/// Scores all hypotheses that are not yet in the model, best first, given the model; its parameters move with each
/// of them.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn screen(
    problem: &Problem,
    catalogue: &Catalogue,
    group: &Group,
    model: &Model,
    noise: Noise,
    mask: Option<&[bool]>,
) -> Result<Screening> {
    let scene = &problem.scene;
    let active = Active::of(problem, catalogue, group, model);
    let deformation = model.deformation(problem, catalogue, &group.columns);
    // With free-form columns of the optics the boards' corners are not condensed: those are summed by themselves, so
    // that all others need not have a row for each corner.
    let is_free = |c: &Column| matches!(c.atom, Atom::FreeOptics(_));
    let together = active.columns.iter().any(is_free);
    let (mut first, mut of_free_optics) = (Candidates::default(), Candidates::default());
    for (h, hypothesis) in catalogue.hypotheses.iter().enumerate() {
        if model.terms.iter().any(|t| t.hypothesis == h) {
            continue;
        }
        let zero = vec![0.0; hypothesis.prior_std.len()];
        for &variant in &hypothesis.variants {
            let columns = catalogue.effect(h).columns(scene, hypothesis.place, variant, &zero);
            let apart = !together && columns.iter().any(is_free);
            if apart { &mut of_free_optics } else { &mut first }.push(h, variant, columns);
        }
    }
    let count = active.columns.len();
    let atoms = first.atoms.iter().chain(&of_free_optics.atoms);
    let everything: Vec<Column> =
        active.columns.iter().cloned().chain(atoms.map(|&a| Column::constant(a))).collect();
    let with_board = needs_board(problem, &everything);
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
    let total = first.summed(problem, &task, &active.columns, mask);
    let mut candidates: Vec<(&Candidate, Sums)> = first.list.iter().zip(total.sums).collect();
    if !of_free_optics.list.is_empty() {
        let part = of_free_optics.summed(problem, &task, &active.columns, mask);
        candidates.extend(of_free_optics.list.iter().zip(part.sums));
    }
    problem.spend(with_board, count + first.atoms.len() + of_free_optics.atoms.len(), mask);
    let at = |i: usize, j: usize| total.base[i.max(j) * stride(count + 1) + i.min(j)];
    let mut h = DMatrix::from_fn(count, count, at);
    let mut g = DVector::from_fn(count, |i, _| at(i, count));
    active.add_priors(&mut h, &mut g);
    let base = h.cholesky().and_then(|factor| {
        let along = factor.l_dirty().solve_lower_triangular(&g)?;
        Some((factor, along))
    });
    let mut scores: Vec<Score> = candidates
        .iter()
        .map(|(candidate, sums)| score(problem, catalogue, candidate, sums, base.as_ref()))
        .collect();
    scores.sort_by(|x, y| y.log_bayes.total_cmp(&x.log_bayes));
    // With the corners as rows false ones count less: as they do in a fit that has them so too.
    let comparable = with_board == needs_board(problem, &active.columns);
    let misfit = comparable.then(|| total.cost + active.penalty(&active.values));
    Ok(Screening { scores, misfit, base })
}

fn score(
    problem: &Problem,
    catalogue: &Catalogue,
    candidate: &Candidate,
    sums: &Sums,
    base: Option<&Base>,
) -> Score {
    let hypothesis = &catalogue.hypotheses[candidate.hypothesis];
    let bounded = |(_, column): &(usize, Column)| problem.is_least(column.atom);
    let positive = catalogue.effect(candidate.hypothesis).is_positive()
        || !candidate.columns.is_empty() && candidate.columns.iter().all(bounded);
    let s = DVector::from_column_slice(&hypothesis.prior_std);
    let (mut a, mut g) = (sums.a.clone(), sums.g.clone());
    a.fill_lower_triangle_with_upper_triangle();
    let mut beside = None;
    if let Some((factor, along)) = base
        && sums.b.nrows() > 0
        && let Some(b) = factor.l_dirty().solve_lower_triangular(&sums.b)
    {
        a -= b.tr_mul(&b);
        g -= b.tr_mul(along);
        beside = Some(b);
    }
    let k = g.len();
    let scaled = DMatrix::from_fn(k, k, |i, j| a[(i, j)] * s[i] * s[j] + if i == j { 1.0 } else { 0.0 });
    let scaled_g = g.component_mul(&s);
    let (log_bayes, parameters) = match scaled.clone().cholesky() {
        Some(factor) => {
            let mut solution = factor.solve(&scaled_g);
            if positive && k > 1 {
                solution = not_negative(&scaled, &scaled_g, solution);
            }
            let log_det = 2.0 * factor.l_dirty().diagonal().iter().map(|x| x.ln()).sum::<f64>();
            let estimate = solution.component_mul(&s);
            let impossible = positive && estimate.iter().all(|value| *value <= 0.0);
            let gain = if impossible { 0.0 } else { 0.5 * scaled_g.dot(&solution) };
            (gain - 0.5 * log_det, estimate.as_slice().to_vec())
        }
        None => (f64::NEG_INFINITY, vec![0.0; k]),
    };
    let estimate = DVector::from_column_slice(&parameters);
    let across = beside.map_or_else(|| DVector::zeros(sums.b.nrows()), |b| b * estimate);
    Score {
        across,
        hypothesis: candidate.hypothesis,
        variant: candidate.variant,
        log_bayes,
        parameters,
        information: a,
    }
}

/// The solution of `A x = g` where no x may be negative: those that would be are held at 0, and the others solved for once more.
fn not_negative(a: &DMatrix<f64>, g: &DVector<f64>, unbound: DVector<f64>) -> DVector<f64> {
    let mut solution = unbound;
    let mut free: Vec<usize> = (0..g.len()).collect();
    while free.iter().any(|&i| solution[i] < 0.0) {
        free.retain(|&i| solution[i] > 0.0);
        let among = DMatrix::from_fn(free.len(), free.len(), |i, j| a[(free[i], free[j])]);
        let own = DVector::from_fn(free.len(), |i, _| g[free[i]]);
        let Some(factor) = among.cholesky() else { return DVector::zeros(g.len()) };
        let part = factor.solve(&own);
        solution.fill(0.0);
        free.iter().zip(part.iter()).for_each(|(&i, x)| solution[i] = *x);
    }
    solution
}

/// Reusable memory. The residual is stored after the active columns.
struct Scratch {
    work: FrameWork,
    /// Vectors of the atoms, and where each is not 0; none where it is absent from the frame.
    by_atom: Vec<f64>,
    atom_spans: Vec<Option<Span>>,
    /// The active columns with the residual, and the atoms.
    active: Table,
    atoms: Table,
    /// Products of each atom with each active column, and with the residual.
    atom_active: Vec<f64>,
    /// Products of the pairs of atoms.
    pair_products: Vec<f64>,
}

impl Scratch {
    fn new(problem: &Problem) -> Self {
        Self {
            work: FrameWork::new(problem),
            by_atom: Vec::new(),
            atom_spans: Vec::new(),
            active: Table::default(),
            atoms: Table::default(),
            atom_active: Vec::new(),
            pair_products: Vec::new(),
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
        self.active.clear(count + 1, rows);
        self.atoms.clear(what.candidate_atoms, rows);
        self.by_atom.resize(what.atoms.len() * length, 0.0);
        self.atom_spans.clear();
        for (a, (atom, indices)) in what.atoms.iter().enumerate() {
            let vector = &mut self.by_atom[a * length..(a + 1) * length];
            let span = self.work.column_in(problem, task.deformation, frame, *atom, vector);
            self.atom_spans.push(span);
            let Some(span) = span else { continue };
            for &i in indices {
                let weight = what.active[i].weight.at(scene, frame);
                if weight != 0.0 {
                    self.active.write(i, vector, span, weight);
                }
            }
            if a < what.candidate_atoms {
                self.atoms.write(a, vector, span, 1.0);
            }
        }
        self.active.write(count, &self.work.residual, Span { start: 0, end: rows }, 1.0);
        add_products(&self.active, &self.active, true, &mut out.base);
        let stride = stride(count + 1);
        self.atom_active.clear();
        self.atom_active.resize(what.candidate_atoms * stride, 0.0);
        add_products(&self.atoms, &self.active, false, &mut self.atom_active);
        let atom = |a: usize| &self.by_atom[a * length..(a + 1) * length];
        self.pair_products.clear();
        self.pair_products.extend(what.pairs.iter().map(|&(a, b)| {
            match (self.atom_spans[a], self.atom_spans[b]) {
                (Some(_), Some(_)) => inner(atom(a), atom(b)),
                _ => 0.0,
            }
        }));
        let mut weights = Vec::new();
        for (candidate, sums) in what.candidates.iter().zip(&mut out.sums) {
            let columns = &candidate.columns;
            weights.clear();
            weights.extend(columns.iter().map(|(a, column)| {
                if self.atom_spans[*a].is_some() { column.weight.at(scene, frame) } else { 0.0 }
            }));
            for (i, (a, _)) in columns.iter().enumerate() {
                let w = weights[i];
                if w == 0.0 {
                    continue;
                }
                let products = &self.atom_active[a * stride..a * stride + count + 1];
                sums.g[i] += w * products[count];
                for (b, product) in sums.b.column_mut(i).iter_mut().zip(products) {
                    *b += w * product;
                }
                for j in i..columns.len() {
                    sums.a[(i, j)] +=
                        w * weights[j] * self.pair_products[candidate.products[i * columns.len() + j]];
                }
            }
        }
    }
}
