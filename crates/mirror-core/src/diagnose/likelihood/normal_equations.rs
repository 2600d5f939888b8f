//! Reduced normal equations over all frames: the mirror of each frame is projected out on the way.

use crate::diagnose::model::camera_and_mirror::FootPoints;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::elementary::Column;
use crate::diagnose::model::frame::{FrameWork, PROJECTED, Span, Task, Wanted};
use crate::diagnose::model::problem::{FRAMES_A_CHUNK, Noise, Problem};
use crate::error::Result;
use multiversion::multiversion;
use nalgebra::{DMatrix, DVector, Vector3};
use rayon::prelude::*;

/// `H = Σ ⟨x, xᵀ⟩`, `g = Σ ⟨x, r⟩`, and the cost (−2 log likelihood).
#[derive(Debug, Clone)]
pub(crate) struct Normal {
    pub h: DMatrix<f64>,
    pub g: DVector<f64>,
    pub cost: f64,
    /// Each frame's plane, and how it moves with the columns' parameters; none where no column needs fresh boards.
    pub planes: Planes,
}

/// The frames' mirror planes to first order in the parameters.
#[derive(Debug, Clone, Default)]
pub(crate) struct Planes {
    pub feet: FootPoints,
    /// By frame, then by column.
    by_parameter: Vec<Vector3<f64>>,
}

impl Planes {
    /// Where the planes will be once the parameters have moved by `step`.
    pub fn after(&self, step: &[f64]) -> FootPoints {
        let by_frame = self.by_parameter.chunks(step.len().max(1));
        let moved = |by: &[Vector3<f64>]| by.iter().zip(step).map(|(b, s)| b * *s).sum::<Vector3<f64>>();
        self.feet.iter().zip(by_frame).map(|(foot, by)| foot.map(|f| f + moved(by))).collect()
    }
}

/// Sums that a dot product keeps apart, so that it need not wait for each addition and can use vector registers.
const LANES: usize = 8;

/// The dot product.
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
#[inline]
pub(crate) fn inner(x: &[f64], y: &[f64]) -> f64 {
    let rows = x.len() - PROJECTED;
    let along = dot(&x[..rows], &y[..rows]);
    let plane: f64 = x[rows..].iter().zip(&y[rows..]).map(|(a, b)| a * b).sum();
    along - plane
}

/// [`inner`] of two columns that are 0 outside their spans.
#[inline(always)]
pub(crate) fn inner_in(x: &[f64], in_x: Span, y: &[f64], in_y: Span) -> f64 {
    let rows = x.len() - PROJECTED;
    let (start, end) = (in_x.start.max(in_y.start), in_x.end.min(in_y.end));
    let along = if start < end { dot(&x[start..end], &y[start..end]) } else { 0.0 };
    let plane: f64 = x[rows..].iter().zip(&y[rows..]).map(|(a, b)| a * b).sum();
    along - plane
}

/// Whether any column moves how the board's corners are seen.
pub(crate) fn needs_board(problem: &Problem, columns: &[Column]) -> bool {
    let Some(board) = problem.board else { return false };
    columns.iter().any(|c| moves_board(problem, c.atom, board.node))
}

fn moves_board(
    problem: &Problem,
    atom: crate::diagnose::model::elementary::Atom,
    board: Option<usize>,
) -> bool {
    if atom.is_optical() {
        return true;
    }
    if let crate::diagnose::model::elementary::Atom::BoardMount(_) = atom {
        return !problem.camera_beside_board();
    }
    let camera = problem.camera_site.and_then(|s| s.node);
    crate::diagnose::model::elementary::moves(atom, &problem.scene, board)
        != crate::diagnose::model::elementary::moves(atom, &problem.scene, camera)
}

/// Whether a frame counts.
pub(crate) fn counts(mask: Option<&[bool]>, frame: usize) -> bool {
    mask.is_none_or(|m| m[frame])
}

impl Normal {
    /// Of no frame, by so many parameters.
    pub fn zeros(count: usize) -> Self {
        Self {
            h: DMatrix::zeros(count, count),
            g: DVector::zeros(count),
            cost: 0.0,
            planes: Planes::default(),
        }
    }

    /// Linearises all frames that `mask` lets count, at a deformation, by the given columns.
    ///
    /// # Errors
    /// A camera or mirror that cannot be.
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
        };
        let count = columns.len();
        let fresh = with_board && problem.needs_fresh_board(deformation);
        let chunks: Vec<Self> = chunks(problem.frames.len())
            .into_par_iter()
            .map_init(
                || (FrameWork::new(problem), Vec::new()),
                |(work, buffer), frames| {
                    let mut sum = Self::zeros(count);
                    for frame in frames {
                        if fresh {
                            sum.planes.feet.push(None);
                            sum.planes.by_parameter.resize(sum.planes.feet.len() * count, Vector3::zeros());
                        }
                        if counts(mask, frame) {
                            sum.add_frame(problem, &task, columns, frame, work, buffer);
                        }
                    }
                    sum
                },
            )
            .collect();
        let mut total = Self::zeros(count);
        for chunk in chunks {
            total.h += chunk.h;
            total.g += chunk.g;
            total.cost += chunk.cost;
            total.planes.feet.extend(chunk.planes.feet);
            total.planes.by_parameter.extend(chunk.planes.by_parameter);
        }
        total.h.fill_lower_triangle_with_upper_triangle();
        Ok(total)
    }

    fn add_frame(
        &mut self,
        problem: &Problem,
        task: &Task<'_>,
        columns: &[Column],
        frame: usize,
        work: &mut FrameWork,
        buffer: &mut Vec<f64>,
    ) {
        if !work.evaluate(problem, task, frame) {
            return;
        }
        self.cost += work.cost;
        let with_plane = work.has_plane() && !self.planes.feet.is_empty();
        if let Some(foot) = self.planes.feet.last_mut().filter(|_| with_plane) {
            *foot = Some(work.best_foot());
        }
        let of_frame = self.planes.by_parameter.len().saturating_sub(columns.len());
        let stride = work.row_count + PROJECTED;
        buffer.resize(stride * columns.len(), 0.0);
        let mut present: Vec<(usize, Span)> = Vec::with_capacity(columns.len());
        for (i, column) in columns.iter().enumerate() {
            let weight = column.weight.at(&problem.scene, frame);
            if weight == 0.0 {
                continue;
            }
            let out = &mut buffer[i * stride..(i + 1) * stride];
            if let Some(span) = work.column_in(problem, task.deformation, frame, column.atom, out) {
                if weight != 1.0 {
                    out.iter_mut().for_each(|x| *x *= weight);
                }
                present.push((i, span));
                if with_plane {
                    self.planes.by_parameter[of_frame + i] = work.foot_by(out);
                }
            }
        }
        add_products(buffer, stride, &present, &work.residual, &mut self.h, &mut self.g);
    }
}

/// Adds a frame's products of columns with columns (the upper triangle) and with the residual.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn add_products(
    columns: &[f64],
    stride: usize,
    present: &[(usize, Span)],
    residual: &[f64],
    h: &mut DMatrix<f64>,
    g: &mut DVector<f64>,
) {
    let everywhere = Span { start: 0, end: stride - PROJECTED };
    for (at, &(i, span)) in present.iter().enumerate() {
        let x = &columns[i * stride..(i + 1) * stride];
        g[i] += inner_in(x, span, residual, everywhere);
        for &(j, other) in &present[at..] {
            h[(i, j)] += inner_in(x, span, &columns[j * stride..(j + 1) * stride], other);
        }
    }
}

/// The frames in chunks of a fixed size.
pub(crate) fn chunks(frames: usize) -> Vec<core::ops::Range<usize>> {
    (0..frames.div_ceil(FRAMES_A_CHUNK))
        .map(|c| c * FRAMES_A_CHUNK..((c + 1) * FRAMES_A_CHUNK).min(frames))
        .collect()
}

/// Chunks whose sums are held at once: enough for many cores, and no more memory for long sessions than for short ones.
const CHUNKS_A_ROUND: usize = 16;

/// The chunks in rounds: each round's sums are added up, in order, before the next begins.
pub(crate) fn rounds(frames: usize) -> impl Iterator<Item = Vec<core::ops::Range<usize>>> {
    let chunks = chunks(frames);
    (0..chunks.len())
        .step_by(CHUNKS_A_ROUND)
        .map(move |first| chunks[first..(first + CHUNKS_A_ROUND).min(chunks.len())].to_vec())
}
