//! Fields: mean residuals of corners and markers over the image, and of corners over the board, over all frames.
//!
//! In each frame the mirror's plane is fitted to what the frame shows, and the residuals are averaged. Over the
//! image they are averaged in cells of a grid, corners and markers separately: a wrong lens moves what is seen at a
//! place of the picture; a wrong mirror mainly moves the markers, because its plane is fitted to the corners. Over
//! the board they are given as the displacement of each corner, `d = (Σ JᵀJ + 1/s²)⁻¹ Σ Jᵀ r` with J the pixel's derivative
//! by the corner in the board's frame and s the usual size of a free displacement: a wrong board moves its corners. What a shift of the mirror can absorb is in
//! neither.

use crate::diagnose::data::diagnosis::{Field, FieldPoint};
use crate::diagnose::likelihood::normal_equations::chunks;
use crate::diagnose::likelihood::saturated::FREE_STD;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::frame::{FrameWork, Task};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::principles::{FEWEST_OBSERVATIONS, Size};
use crate::error::Result;
use nalgebra::{Matrix3, Vector2, Vector3};
use rayon::prelude::*;

/// Cells of the image's grid from left to right.
const CELLS_ACROSS: Size = 16;

/// The surface of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Over {
    Image,
    Board,
}

/// Residuals in a cell of the image.
#[derive(Debug, Clone, Copy)]
struct Cell {
    count: usize,
    at_px: Vector2<f64>,
    residual_px: Vector2<f64>,
}

/// The normal equations of one corner's displacement in the board's frame.
#[derive(Debug, Clone, Copy)]
struct Corner {
    count: usize,
    information: Matrix3<f64>,
    gradient: Vector3<f64>,
}

/// Sums over all frames.
#[derive(Debug, Clone)]
struct Sums {
    /// Of corners, then of markers.
    cells: [Vec<Cell>; 2],
    corners: Vec<Corner>,
}

impl Sums {
    fn zero(cells: usize, corners: usize) -> Self {
        let cell = Cell { count: 0, at_px: Vector2::zeros(), residual_px: Vector2::zeros() };
        let corner = Corner { count: 0, information: Matrix3::zeros(), gradient: Vector3::zeros() };
        Self { cells: [vec![cell; cells], vec![cell; cells]], corners: vec![corner; corners] }
    }

    fn add(&mut self, other: &Self) {
        for (sum, part) in self.cells.iter_mut().flatten().zip(other.cells.iter().flatten()) {
            sum.count += part.count;
            sum.at_px += part.at_px;
            sum.residual_px += part.residual_px;
        }
        for (sum, part) in self.corners.iter_mut().zip(&other.corners) {
            sum.count += part.count;
            sum.information += part.information;
            sum.gradient += part.gradient;
        }
    }
}

/// Residuals of corners and markers without a cause, and with it.
///
/// None where the session has no camera or no board.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn field(
    problem: &Problem,
    noise: Noise,
    over: Over,
    without: &Deformation,
    with: Option<&Deformation>,
) -> Result<Option<Field>> {
    let Some(camera) = &problem.camera else { return Ok(None) };
    if problem.board.is_none() {
        return Ok(None);
    }
    let (w, h) = camera.size_px();
    let size_px = Vector2::new(f64::from(w), f64::from(h));
    let first = sums(problem, without, noise, size_px)?;
    let second = with.map(|d| sums(problem, d, noise, size_px)).transpose()?;
    Ok(Some(match over {
        Over::Image => over_image(&first, second.as_ref(), noise, size_px),
        Over::Board => over_board(problem, &first, second.as_ref(), noise),
    }))
}

/// Square cells that cover the image.
struct Grid {
    side_px: f64,
    down: usize,
}

impl Grid {
    fn new(size_px: Vector2<f64>) -> Self {
        let side_px = (size_px.x / CELLS_ACROSS as f64).max(1.0);
        Self { side_px, down: (size_px.y / side_px).ceil().max(1.0) as usize }
    }

    /// The cell of a pixel; beyond the edge the nearest.
    fn cell(&self, pixel: &Vector2<f64>) -> usize {
        let index = |at: f64, cells: usize| ((at / self.side_px).max(0.0) as usize).min(cells - 1);
        index(pixel.y, self.down) * CELLS_ACROSS + index(pixel.x, CELLS_ACROSS)
    }
}

fn add_to_cell(cells: &mut [Cell], grid: &Grid, pixel: &Vector2<f64>, residual_px: &Vector2<f64>) {
    let cell = &mut cells[grid.cell(pixel)];
    cell.count += 1;
    cell.at_px += pixel;
    cell.residual_px += residual_px;
}

fn sums(problem: &Problem, deformation: &Deformation, noise: Noise, size_px: Vector2<f64>) -> Result<Sums> {
    let grid = Grid::new(size_px);
    let zero = Sums::zero(CELLS_ACROSS * grid.down, problem.corners.len());
    let eye = problem.eye(deformation)?;
    let task = Task { with_board: true, ..Task::of_residuals(problem, deformation, eye.as_ref(), noise) };
    let parts: Vec<Sums> = chunks(problem.frames.len())
        .into_par_iter()
        .map_init(
            || FrameWork::new(problem),
            |work, frames| {
                let mut out = zero.clone();
                for frame in frames {
                    if !work.evaluate(problem, &task, frame) {
                        continue;
                    }
                    for corner in work.seen_corners(problem) {
                        add_to_cell(&mut out.cells[0], &grid, &corner.pixel, &corner.residual_px);
                        let sum = &mut out.corners[corner.index];
                        sum.count += 1;
                        sum.information += corner.by_board.tr_mul(&corner.by_board);
                        sum.gradient += corner.by_board.tr_mul(&corner.residual_px);
                    }
                    for marker in work.pictured_markers(problem) {
                        add_to_cell(&mut out.cells[1], &grid, &marker.pixel, &marker.residual_px);
                    }
                }
                out
            },
        )
        .collect();
    let mut total = zero;
    parts.iter().for_each(|part| total.add(part));
    Ok(total)
}

fn over_image(first: &Sums, second: Option<&Sums>, noise: Noise, size_px: Vector2<f64>) -> Field {
    let mean = |cell: &Cell| -> Vec<f64> { (cell.residual_px / cell.count as f64).as_slice().to_vec() };
    let mut points = Vec::new();
    for (k, (of, std_px)) in
        [("corners", noise.corner_px), ("markers", noise.marker_px)].into_iter().enumerate()
    {
        for (i, cell) in first.cells[k].iter().enumerate() {
            // With the cause a frame may be predicted that is not without it, or the other way round.
            let other = second.map(|s| &s.cells[k][i]);
            if cell.count < FEWEST_OBSERVATIONS || other.is_some_and(|c| c.count < FEWEST_OBSERVATIONS) {
                continue;
            }
            points.push(FieldPoint {
                of: of.into(),
                at: (cell.at_px / cell.count as f64).into(),
                count: cell.count,
                without: mean(cell),
                with: other.map(mean),
                std: vec![std_px / (cell.count as f64).sqrt(); 2],
            });
        }
    }
    Field {
        cause: None,
        at: String::new(),
        over: "image".into(),
        unit: "px".into(),
        size: size_px.into(),
        points,
    }
}

fn over_board(problem: &Problem, first: &Sums, second: Option<&Sums>, noise: Noise) -> Field {
    let variance = noise.corner_px * noise.corner_px;
    let solved = |corner: &Corner| -> Option<(Vector3<f64>, Vector3<f64>)> {
        let prior = Matrix3::from_diagonal_element(FREE_STD.powi(-2));
        let covariance = (corner.information / variance + prior).try_inverse()?;
        Some((covariance * corner.gradient / variance, covariance.diagonal().map(f64::sqrt)))
    };
    let points = first
        .corners
        .iter()
        .enumerate()
        .filter(|(_, corner)| corner.count >= FEWEST_OBSERVATIONS)
        .filter_map(|(i, corner)| {
            let (without, std) = solved(corner)?;
            let with = second.map(|s| solved(&s.corners[i]));
            if with == Some(None) {
                return None;
            }
            Some(FieldPoint {
                of: "corners".into(),
                at: problem.corners[i].xy().into(),
                count: corner.count,
                without: without.as_slice().to_vec(),
                with: with.flatten().map(|w| w.0.as_slice().to_vec()),
                std: std.as_slice().to_vec(),
            })
        })
        .collect();
    let extent = |k: usize| 2.0 * problem.corners.iter().map(|c| c[k].abs()).fold(0.0, f64::max);
    Field {
        cause: None,
        at: String::new(),
        over: "board".into(),
        unit: "m".into(),
        size: [extent(0), extent(1)],
        points,
    }
}
