//! Reduced normal equations over all frames; the mirror plane of each frame is projected out.

use crate::diagnose::model::camera_and_mirror::FootPoints;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::frame::{
    Acting, FrameWork, LANES, ManyColumns, PROJECTED, Table, Task, Wanted, add_products, stride,
};
use crate::diagnose::model::problem::{FRAMES_A_CHUNK, Noise, Problem};
use crate::diagnose::model::work_budget::Effort;
use crate::diagnose::principles::Size;
use crate::error::Result;
use nalgebra::{DMatrix, DVector, Vector3};
use rayon::prelude::*;
use std::collections::HashMap;

/// `H = Σ ⟨x, xᵀ⟩`, `g = Σ ⟨x, r⟩`, and the cost (−2 log likelihood).
#[derive(Debug, Clone)]
pub(crate) struct Normal {
    pub h: DMatrix<f64>,
    pub g: DVector<f64>,
    pub cost: f64,
    /// Each frame's plane, and how it moves with the columns' parameters; none where the deformation needs no fresh boards.
    pub planes: Planes,
}

/// The frames' mirror planes to first order in the parameters.
#[derive(Debug, Clone, Default)]
pub(crate) struct Planes {
    pub feet: FootPoints,
    /// By frame that has a plane, then by column.
    by_parameter: Vec<Vector3<f64>>,
}

impl Planes {
    /// Where the planes will be once the parameters have moved by `step`.
    pub fn after(&self, step: &[f64]) -> FootPoints {
        let mut by_frame = self.by_parameter.chunks(step.len().max(1));
        let moved = |by: &[Vector3<f64>]| by.iter().zip(step).map(|(b, s)| b * *s).sum::<Vector3<f64>>();
        let mut after = |f: Vector3<f64>| f + by_frame.next().map_or_else(Vector3::zeros, moved);
        self.feet.iter().map(|foot| foot.map(&mut after)).collect()
    }

    /// Those of frames of which each is in one of the parts, or in none; `count`: the number of columns.
    fn of_parts(parts: &[&Self], count: usize) -> Self {
        let frames = parts.iter().map(|part| part.feet.len()).max().unwrap_or(0);
        let mut rows: Vec<_> =
            parts.iter().map(|part| part.by_parameter.chunks_exact(count.max(1))).collect();
        let mut out = Self::default();
        for frame in 0..frames {
            let holds = |part: &&Self| part.feet.get(frame).is_some_and(Option::is_some);
            let of = parts.iter().position(holds);
            out.feet.push(of.and_then(|part| parts[part].feet[frame]));
            out.by_parameter.extend(of.and_then(|part| rows[part].next()).unwrap_or_default());
        }
        out
    }
}

/// The dot product, in several partial sums, so that additions need not wait for each other and vector registers
/// are used.
#[inline(always)]
fn dot(x: &[f64], y: &[f64]) -> f64 {
    let (xs, ys) = (x.chunks_exact(LANES), y.chunks_exact(LANES));
    let rest: f64 = xs.remainder().iter().zip(ys.remainder()).map(|(a, b)| a * b).sum();
    let mut sums = [0.0; LANES];
    for (a, b) in xs.zip(ys) {
        for k in 0..LANES {
            sums[k] += a[k] * b[k];
        }
    }
    sums.iter().sum::<f64>() + rest
}

/// `x·y` of two vectors of a frame: their rows, less their parts along the plane's three parameters.
#[inline(always)]
pub(crate) fn inner(x: &[f64], y: &[f64]) -> f64 {
    let rows = x.len() - PROJECTED;
    let along = dot(&x[..rows], &y[..rows]);
    let plane: f64 = x[rows..].iter().zip(&y[rows..]).map(|(a, b)| a * b).sum();
    along - plane
}

/// Whether any column moves how the board's corners are seen; without a board, whether any is of the camera, by which
/// markers are seen.
pub(crate) fn changes_sight(problem: &Problem, columns: &[Column]) -> bool {
    let Some(board) = problem.board else {
        return problem.camera.is_some() && columns.iter().any(|c| c.atom.is_optical());
    };
    columns.iter().any(|c| moves_board(problem, c.atom, board.node))
}

fn moves_board(problem: &Problem, atom: Atom, board: Option<usize>) -> bool {
    if atom.is_optical() || matches!(atom, Atom::BoardSlip(_)) {
        return true;
    }
    if let Atom::BoardMount(_) = atom {
        return !problem.camera_beside_board();
    }
    let camera = problem.camera_site.and_then(|s| s.node);
    crate::diagnose::model::elementary::moves_against(atom, &problem.scene, board, camera)
}

/// Whether a frame counts.
pub(crate) fn counts(mask: Option<&[bool]>, frame: usize) -> bool {
    mask.is_none_or(|m| m[frame])
}

impl Normal {
    /// Linearises all frames that `mask` lets count, at a deformation, by the given columns.
    ///
    /// # Errors
    /// Invalid parameters of the camera or mirror.
    pub fn at(
        problem: &Problem,
        deformation: &Deformation,
        noise: Noise,
        columns: &[Column],
        with_board: bool,
        planes: Option<&FootPoints>,
        mask: Option<&[bool]>,
    ) -> Result<Self> {
        let eye = problem.eye(deformation)?;
        let task = Task {
            deformation,
            eye: eye.as_ref(),
            noise,
            with_board,
            gaussian: false,
            wanted: Wanted::by(columns),
            planes: planes.map(Vec::as_slice),
            condensed: true,
        };
        let count = columns.len();
        let by_atom = by_atom(columns);
        let fresh = with_board && problem.needs_fresh_board(deformation);
        let chunks: Vec<Sums> = chunks_of(problem.frames.len(), FRAMES_A_CHUNK.max(count / COLUMNS_A_FRAME))
            .into_par_iter()
            .map_init(
                || Scratch::new(problem),
                |scratch, frames| {
                    let any = frames.clone().any(|frame| counts(mask, frame));
                    let mut sum = if any { Sums::zeros(count) } else { Sums::none(count) };
                    for frame in frames {
                        if fresh {
                            sum.planes.feet.push(None);
                        }
                        if counts(mask, frame) {
                            scratch.add_frame(problem, &task, columns, &by_atom, frame, &mut sum);
                        }
                    }
                    sum
                },
            )
            .collect();
        let mut total = Sums::zeros(count);
        for chunk in chunks {
            total.add(chunk);
        }
        let equations = Effort::Equations(count);
        problem.budget.spend_ns(total.spent_ns + equations.nanoseconds());
        Ok(total.into_normal())
    }

    /// Those of all frames of some parts, at the same deformation and by the same columns.
    pub fn of_parts(parts: &[&Self]) -> Self {
        let count = parts.first().map_or(0, |part| part.g.len());
        let planes: Vec<&Planes> = parts.iter().map(|part| &part.planes).collect();
        let mut out = Self {
            h: DMatrix::zeros(count, count),
            g: DVector::zeros(count),
            cost: 0.0,
            planes: Planes::of_parts(&planes, count),
        };
        for part in parts {
            out.h += &part.h;
            out.g += &part.g;
            out.cost += part.cost;
        }
        out
    }
}

/// What some frames add up to.
struct Sums {
    count: usize,
    /// Products of the columns, and of the residual as the last, with those before.
    products: Vec<f64>,
    cost: f64,
    planes: Planes,
    spent_ns: u64,
}

impl Sums {
    fn zeros(count: usize) -> Self {
        let products = vec![0.0; (count + 1) * stride(count + 1)];
        Self { count, products, cost: 0.0, planes: Planes::default(), spent_ns: 0 }
    }

    /// Of no frame that counts.
    fn none(count: usize) -> Self {
        Self { count, products: Vec::new(), cost: 0.0, planes: Planes::default(), spent_ns: 0 }
    }

    fn add(&mut self, other: Self) {
        self.products.iter_mut().zip(&other.products).for_each(|(a, b)| *a += b);
        self.cost += other.cost;
        self.spent_ns += other.spent_ns;
        self.planes.feet.extend(other.planes.feet);
        self.planes.by_parameter.extend(other.planes.by_parameter);
    }

    /// Adds products of some of the columns with each other.
    fn add_of(&mut self, columns: &[usize], products: &[f64]) {
        let (own, all) = (stride(columns.len()), stride(self.count + 1));
        for (a, &i) in columns.iter().enumerate() {
            for (b, &j) in columns[..=a].iter().enumerate() {
                self.products[i.max(j) * all + i.min(j)] += products[a * own + b];
            }
        }
    }

    fn into_normal(self) -> Normal {
        let (count, stride) = (self.count, stride(self.count + 1));
        let at = |i: usize, j: usize| self.products[i.max(j) * stride + i.min(j)];
        Normal {
            h: DMatrix::from_fn(count, count, at),
            g: DVector::from_fn(count, |i, _| at(i, count)),
            cost: self.cost,
            planes: self.planes,
        }
    }
}

/// The different atoms of some columns, each with its columns: an atom's vector is computed once a frame.
pub(crate) fn by_atom(columns: &[Column]) -> Vec<(Atom, Vec<usize>)> {
    let mut index: HashMap<Atom, usize> = HashMap::new();
    let mut out: Vec<(Atom, Vec<usize>)> = Vec::new();
    for (i, column) in columns.iter().enumerate() {
        let at = *index.entry(column.atom).or_insert(out.len());
        if at == out.len() {
            out.push((column.atom, Vec::new()));
        }
        out[at].1.push(i);
    }
    out
}

/// Reusable memory.
struct Scratch {
    work: FrameWork,
    columns: ManyColumns,
    table: Table,
    /// The columns that act in the frame, atom by atom, and which they are.
    acting: Vec<Acting>,
    which: Vec<usize>,
    /// Products of only these.
    products: Vec<f64>,
}

impl Scratch {
    fn new(problem: &Problem) -> Self {
        Self {
            work: FrameWork::new(problem),
            columns: ManyColumns::default(),
            table: Table::default(),
            acting: Vec::new(),
            which: Vec::new(),
            products: Vec::new(),
        }
    }

    fn add_frame(
        &mut self,
        problem: &Problem,
        task: &Task<'_>,
        columns: &[Column],
        by_atom: &[(Atom, Vec<usize>)],
        frame: usize,
        sum: &mut Sums,
    ) {
        let predicted = self.work.evaluate(problem, task, frame);
        sum.cost += self.work.cost;
        if !predicted {
            return;
        }
        let count = columns.len();
        let with_plane = self.work.has_plane() && !sum.planes.feet.is_empty();
        let of_frame = sum.planes.by_parameter.len();
        if let Some(foot) = sum.planes.feet.last_mut().filter(|_| with_plane) {
            *foot = Some(self.work.best_foot());
            sum.planes.by_parameter.resize(of_frame + count, Vector3::zeros());
        }
        self.find_acting(problem, columns, by_atom, frame);
        // Of curves over a joint's positions few values act in a frame: then only the products of these are computed.
        let few = 2 * self.acting.len() < count;
        let last = if few { self.acting.len() } else { count };
        if few {
            self.acting.iter_mut().enumerate().for_each(|(at, column)| column.at = at);
        }
        let Self { work, columns, table, acting, which, products } = self;
        table.clear(last + 1, work.row_count);
        sum.spent_ns += Effort::Rows { rows: work.row_count, columns: acting.len() }.nanoseconds();
        columns.write(work, (problem, task.deformation), acting, table);
        if with_plane {
            for (column, i) in acting.iter().zip(which.iter()) {
                sum.planes.by_parameter[of_frame + i] = work.foot_by(&table.along(column.at));
            }
        }
        table.write(last, &work.residual, 1.0);
        let table = table.filled();
        if few {
            which.push(count);
            products.clear();
            products.resize(which.len() * stride(which.len()), 0.0);
            add_products(table, table, true, products);
            sum.add_of(which, products);
        } else {
            add_products(table, table, true, &mut sum.products);
        }
    }

    /// The columns that act in a frame, atom by atom.
    fn find_acting(
        &mut self,
        problem: &Problem,
        columns: &[Column],
        by_atom: &[(Atom, Vec<usize>)],
        frame: usize,
    ) {
        self.acting.clear();
        self.which.clear();
        for (atom, indices) in by_atom {
            for &at in indices {
                let weight = columns[at].weight.at(&problem.scene, frame);
                if weight != 0.0 {
                    self.acting.push(Acting { atom: *atom, at, weight });
                    self.which.push(at);
                }
            }
        }
    }
}

/// Sums of n columns are n² numbers, which every chunk clears and adds: with more columns chunks have more frames, one for each so many
/// columns.
const COLUMNS_A_FRAME: Size = 4;

/// The frames in chunks of a fixed size.
pub(crate) fn chunks(frames: usize) -> Vec<core::ops::Range<usize>> {
    chunks_of(frames, FRAMES_A_CHUNK)
}

fn chunks_of(frames: usize, size: usize) -> Vec<core::ops::Range<usize>> {
    (0..frames.div_ceil(size)).map(|c| c * size..((c + 1) * size).min(frames)).collect()
}

/// Chunks whose sums are kept at once: enough for many cores, and no more memory for long sessions than for short
/// ones.
const CHUNKS_A_ROUND: Size = 16;

/// The chunks in rounds: each round's sums are added up, in order, before the next begins.
pub(crate) fn rounds(frames: usize) -> impl Iterator<Item = Vec<core::ops::Range<usize>>> {
    let chunks = chunks(frames);
    (0..chunks.len())
        .step_by(CHUNKS_A_ROUND)
        .map(move |first| chunks[first..(first + CHUNKS_A_ROUND).min(chunks.len())].to_vec())
}
