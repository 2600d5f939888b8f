//! Screening: the score test of every effect at every place at once, beside the causes that the model has already.
//!
//! For a hypothesis with columns X and the model's active columns C (nuisances, group, causes), all whitened and with each
//! frame's mirror projected out, the test needs only `XᵀX`, `XᵀC` and `Xᵀr`: no fit. Hypotheses share atoms, so a frame costs
//! one vector an atom and a few products a hypothesis.
//!
//! Source: the score (Lagrange multiplier) test, Rao 1948; the evidence is that of the linearised model.

use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::likelihood::fit::{Active, Group};
use crate::diagnose::likelihood::normal_equations::{Normal, counts, inner_in, needs_board, rounds};
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::frame::{FrameWork, PROJECTED, Span, Task, Wanted};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::error::Result;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::collections::HashMap;

/// What the score test says of one hypothesis.
#[derive(Debug, Clone)]
pub(crate) struct Score {
    pub hypothesis: usize,
    pub variant: f64,
    /// Log Bayes factor of the model with this cause against the model without it, linearised.
    pub log_bayes: f64,
    /// The linearised estimate.
    pub parameters: Vec<f64>,
    /// What the data tell of the parameters once all that the model has already is free: the inverse of their covariance.
    pub information: DMatrix<f64>,
}

struct Candidate {
    hypothesis: usize,
    variant: f64,
    columns: Vec<(usize, Column)>,
    /// Index of the product of the i-th and j-th columns' atoms, `[i * columns + j]` for j ≥ i.
    products: Vec<usize>,
}

/// Sums of one candidate over frames.
#[derive(Clone)]
struct Sums {
    a: DMatrix<f64>,
    b: DMatrix<f64>,
    g: DVector<f64>,
}

/// Scores all hypotheses that are not yet in the model, best first.
///
/// # Errors
/// A camera or mirror that cannot be.
pub(crate) fn screen(
    problem: &Problem,
    catalogue: &Catalogue,
    group: &Group,
    model: &Model,
    noise: Noise,
    mask: Option<&[bool]>,
) -> Result<Vec<Score>> {
    let scene = &problem.scene;
    let active = Active::of(problem, catalogue, group, model);
    let deformation = model.deformation(problem, catalogue, &group.columns);
    let mut atoms: Vec<Atom> = Vec::new();
    let mut atom_index: HashMap<Atom, usize> = HashMap::new();
    let mut pairs: Vec<(usize, usize)> = Vec::new();
    let mut pair_index: HashMap<(usize, usize), usize> = HashMap::new();
    let mut candidates = Vec::new();
    for (h, hypothesis) in catalogue.hypotheses.iter().enumerate() {
        if model.terms.iter().any(|t| t.hypothesis == h) {
            continue;
        }
        let zero = vec![0.0; hypothesis.prior_std.len()];
        for &variant in &hypothesis.variants {
            let columns = catalogue.effect(h).columns(scene, hypothesis.place, variant, &zero);
            let columns: Vec<(usize, Column)> = columns
                .into_iter()
                .map(|c| {
                    let next = atoms.len();
                    let index = *atom_index.entry(c.atom).or_insert(next);
                    if index == next {
                        atoms.push(c.atom);
                    }
                    (index, c)
                })
                .collect();
            let mut products = vec![0; columns.len() * columns.len()];
            for (i, (a, _)) in columns.iter().enumerate() {
                for (j, (b, _)) in columns.iter().enumerate().skip(i) {
                    let next = pairs.len();
                    let index = *pair_index.entry((*a, *b)).or_insert(next);
                    if index == next {
                        pairs.push((*a, *b));
                    }
                    products[i * columns.len() + j] = index;
                }
            }
            candidates.push(Candidate { hypothesis: h, variant, columns, products });
        }
    }
    let count = active.columns.len();
    let everything: Vec<Column> =
        active.columns.iter().cloned().chain(atoms.iter().map(|&a| Column::constant(a))).collect();
    let with_board = needs_board(problem, &everything);
    let eye = problem.eye(&deformation)?;
    let task = Task {
        deformation: &deformation,
        eye: eye.as_ref(),
        noise,
        with_board,
        gaussian: false,
        wanted: Wanted::by(&everything),
        planes: model.planes.as_deref().map(Vec::as_slice),
    };
    let empty = || -> (Normal, Vec<Sums>) {
        let sums = candidates
            .iter()
            .map(|c| {
                let k = c.columns.len();
                Sums { a: DMatrix::zeros(k, k), b: DMatrix::zeros(k, count), g: DVector::zeros(k) }
            })
            .collect();
        (Normal::zeros(count), sums)
    };
    let (mut normal, mut sums) = empty();
    for round in rounds(problem.frames.len()) {
        let parts: Vec<(Normal, Vec<Sums>)> = round
            .into_par_iter()
            .map_init(
                || Scratch::new(problem),
                |scratch, frames| {
                    let (mut normal, mut sums) = empty();
                    for frame in frames.filter(|&f| counts(mask, f)) {
                        scratch.add_frame(
                            problem,
                            &task,
                            &active,
                            &atoms,
                            &pairs,
                            &candidates,
                            frame,
                            &mut normal,
                            &mut sums,
                        );
                    }
                    (normal, sums)
                },
            )
            .collect();
        for (n, s) in parts {
            normal.h += n.h;
            normal.g += n.g;
            for (total, part) in sums.iter_mut().zip(s) {
                total.a += part.a;
                total.b += part.b;
                total.g += part.g;
            }
        }
    }
    normal.h.fill_lower_triangle_with_upper_triangle();
    active.add_priors(&mut normal.h, &mut normal.g);
    let base = normal.h.clone().cholesky();
    let mut scores: Vec<Score> = candidates
        .iter()
        .zip(&sums)
        .map(|(candidate, sums)| score(catalogue, candidate, sums, base.as_ref(), &normal.g))
        .collect();
    scores.sort_by(|x, y| y.log_bayes.total_cmp(&x.log_bayes));
    Ok(scores)
}

fn score(
    catalogue: &Catalogue,
    candidate: &Candidate,
    sums: &Sums,
    base: Option<&nalgebra::Cholesky<f64, nalgebra::Dyn>>,
    base_gradient: &DVector<f64>,
) -> Score {
    let hypothesis = &catalogue.hypotheses[candidate.hypothesis];
    let s = DVector::from_column_slice(&hypothesis.prior_std);
    let (mut a, mut g) = (sums.a.clone(), sums.g.clone());
    a.fill_lower_triangle_with_upper_triangle();
    if let (Some(base), true) = (base, sums.b.ncols() > 0) {
        a -= &sums.b * base.solve(&sums.b.transpose());
        g -= &sums.b * base.solve(base_gradient);
    }
    let k = g.len();
    let scaled = DMatrix::from_fn(k, k, |i, j| a[(i, j)] * s[i] * s[j] + if i == j { 1.0 } else { 0.0 });
    let scaled_g = g.component_mul(&s);
    let (log_bayes, parameters) = match scaled.cholesky() {
        Some(factor) => {
            let solution = factor.solve(&scaled_g);
            let log_det = 2.0 * factor.l_dirty().diagonal().iter().map(|x| x.ln()).sum::<f64>();
            let estimate = solution.component_mul(&s);
            let impossible = catalogue.effect(candidate.hypothesis).is_positive() && estimate[0] <= 0.0;
            let gain = if impossible { 0.0 } else { 0.5 * scaled_g.dot(&solution) };
            (gain - 0.5 * log_det, estimate.as_slice().to_vec())
        }
        None => (f64::NEG_INFINITY, vec![0.0; k]),
    };
    Score {
        hypothesis: candidate.hypothesis,
        variant: candidate.variant,
        log_bayes,
        parameters,
        information: a,
    }
}

struct Scratch {
    work: FrameWork,
    /// Vectors of the active columns, and where each is not 0; none where it is absent from the frame.
    active: Vec<f64>,
    present: Vec<Option<Span>>,
    /// The same of the atoms.
    by_atom: Vec<f64>,
    atom_spans: Vec<Option<Span>>,
    atom_residual: Vec<f64>,
    /// `[atom * active + active]`.
    atom_active: Vec<f64>,
    /// Products of the pairs of atoms.
    pair_products: Vec<f64>,
}

impl Scratch {
    fn new(problem: &Problem) -> Self {
        Self {
            work: FrameWork::new(problem),
            active: Vec::new(),
            present: Vec::new(),
            by_atom: Vec::new(),
            atom_spans: Vec::new(),
            atom_residual: Vec::new(),
            atom_active: Vec::new(),
            pair_products: Vec::new(),
        }
    }

    fn add_frame(
        &mut self,
        problem: &Problem,
        task: &Task<'_>,
        active: &Active,
        atoms: &[Atom],
        pairs: &[(usize, usize)],
        candidates: &[Candidate],
        frame: usize,
        normal: &mut Normal,
        sums: &mut [Sums],
    ) {
        if !self.work.evaluate(problem, task, frame) {
            return;
        }
        let scene = &problem.scene;
        let stride = self.work.row_count + PROJECTED;
        let everywhere = Span { start: 0, end: self.work.row_count };
        let count = active.columns.len();
        self.active.resize(stride * count, 0.0);
        self.present.clear();
        for (i, column) in active.columns.iter().enumerate() {
            let out = &mut self.active[i * stride..(i + 1) * stride];
            let weight = column.weight.at(scene, frame);
            let span = if weight == 0.0 {
                None
            } else {
                self.work.column_in(problem, task.deformation, frame, column.atom, out)
            };
            if span.is_some() && weight != 1.0 {
                out.iter_mut().for_each(|x| *x *= weight);
            }
            self.present.push(span);
        }
        let residual = &self.work.residual;
        let vector = |i: usize| &self.active[i * stride..(i + 1) * stride];
        for i in 0..count {
            let Some(in_x) = self.present[i] else { continue };
            normal.g[i] += inner_in(vector(i), in_x, residual, everywhere);
            for j in i..count {
                if let Some(in_y) = self.present[j] {
                    normal.h[(i, j)] += inner_in(vector(i), in_x, vector(j), in_y);
                }
            }
        }
        self.by_atom.resize(atoms.len() * stride, 0.0);
        self.atom_active.resize(atoms.len() * count, 0.0);
        self.atom_spans.clear();
        self.atom_residual.clear();
        for (a, atom) in atoms.iter().enumerate() {
            let out = &mut self.by_atom[a * stride..(a + 1) * stride];
            let span = self.work.column_in(problem, task.deformation, frame, *atom, out);
            self.atom_spans.push(span);
            let Some(in_x) = span else {
                self.atom_residual.push(0.0);
                continue;
            };
            self.atom_residual.push(inner_in(out, in_x, residual, everywhere));
            for i in 0..count {
                self.atom_active[a * count + i] =
                    self.present[i].map_or(0.0, |in_y| inner_in(out, in_x, vector(i), in_y));
            }
        }
        let atom = |a: usize| &self.by_atom[a * stride..(a + 1) * stride];
        self.pair_products.clear();
        self.pair_products.extend(pairs.iter().map(|&(a, b)| {
            match (self.atom_spans[a], self.atom_spans[b]) {
                (Some(in_x), Some(in_y)) => inner_in(atom(a), in_x, atom(b), in_y),
                _ => 0.0,
            }
        }));
        for (candidate, sums) in candidates.iter().zip(sums) {
            let columns = &candidate.columns;
            for (i, (a, column)) in columns.iter().enumerate() {
                let there = self.atom_spans[*a].is_some();
                let w = if there { column.weight.at(scene, frame) } else { 0.0 };
                if w == 0.0 {
                    continue;
                }
                sums.g[i] += w * self.atom_residual[*a];
                for c in 0..count {
                    sums.b[(i, c)] += w * self.atom_active[a * count + c];
                }
                for (j, (b, other)) in columns.iter().enumerate().skip(i) {
                    if self.atom_spans[*b].is_some() {
                        let product = self.pair_products[candidate.products[i * columns.len() + j]];
                        sums.a[(i, j)] += w * other.weight.at(scene, frame) * product;
                    }
                }
            }
        }
    }
}
