//! Free-form errors of lens, board and mirror, linear in their parameters, for errors that the vocabulary lacks.
//!
//! * Lens: a smooth warp of the image, `Δu = f Σ w_k m_k(x, y)` in u and in v, with m_k all monomials of degree 1 to
//!   3 of the normalised image point: decentring, a rolling shutter, any aspect.
//! * Board: its corners out of plane by a quadric, `z = W (a X² + b X Y + c Y²)`, and stretched unevenly or sheared,
//!   with `X = x/W` and W the board's half width.
//! * Mirror: astigmatism, heights `½ κ_a (x² − y²) + κ_b x y` over its plane. The seen point shifts sideways by `2 h
//!   ∇`, h the distance of the point from the mirror and ∇ the height's gradient where the ray meets it.

use crate::diagnose::model::camera_and_mirror::Eye;
use crate::diagnose::model::free_values::{ASTIGMATISM, BOARD_SHAPE, MONOMIALS};
use crate::diagnose::model::problem::Problem;
use nalgebra::{Matrix2x3, SMatrix, Vector2, Vector3};

/// How a pixel moves with each of them, px.
pub(crate) type FreeColumns = SMatrix<f64, 2, { ASTIGMATISM.end }>;

/// Where a corner lies, in the board's frame, m: scaled and bent.
pub(crate) fn corner_point(problem: &Problem, eye: &Eye, index: usize, scale: f64) -> Vector3<f64> {
    let flat = problem.corners[index] * scale;
    match &eye.free {
        Some(free) => flat + shape(problem, index) * free.fixed_rows::<5>(BOARD_SHAPE.start),
        None => flat,
    }
}

/// A corner's displacement by each number of the board's shape, m.
fn shape(problem: &Problem, index: usize) -> SMatrix<f64, 3, 5> {
    let width = problem.corners.iter().map(|c| c.x.abs()).fold(1e-9, f64::max);
    let (x, y) = (problem.corners[index].x / width, problem.corners[index].y / width);
    let z = |value: f64| Vector3::new(0.0, 0.0, value);
    SMatrix::<f64, 3, 5>::from_columns(&[
        z(x * x),
        z(x * y),
        z(y * y),
        Vector3::new(x, -y, 0.0),
        Vector3::new(y, x, 0.0),
    ]) * width
}

/// A seen point: the camera sees `seen` (its image in the mirror, or itself) at `pixel`.
pub(crate) struct SeenPoint<'a> {
    pub eye: &'a Eye,
    pub seen: &'a Vector3<f64>,
    pub pixel: &'a Vector2<f64>,
    pub by_seen: &'a Matrix2x3<f64>,
    /// The mirror's foot point, where it is seen in it.
    pub foot: Option<&'a Vector3<f64>>,
}

impl SeenPoint<'_> {
    /// How the pixel moves with the lens' warp and the mirror's astigmatism.
    pub fn columns(&self) -> FreeColumns {
        let mut out = FreeColumns::zeros();
        let focal = self.eye.nominal_focal;
        let at = (self.pixel - self.eye.camera.center_px()).component_div(&focal);
        let (x, y) = (at.x, at.y);
        let monomials = [x, y, x * x, x * y, y * y, x * x * x, x * x * y, x * y * y, y * y * y];
        for (k, m) in monomials.into_iter().enumerate() {
            out[(0, k)] = focal.x * m;
            out[(1, MONOMIALS + k)] = focal.y * m;
        }
        if let Some(foot) = self.foot {
            let distance = foot.norm();
            let normal = foot / distance;
            // The seen point lies as far behind the mirror as the point lies before it.
            let behind = normal.dot(self.seen) - distance;
            let ray_share = distance / (distance + behind).max(1e-9);
            let meets = self.seen * ray_share - foot;
            let first = (Vector3::x() - normal * normal.x).normalize();
            let second = normal.cross(&first);
            let (a, b) = (first.dot(&meets), second.dot(&meets));
            for (k, gradient) in [first * a - second * b, first * b + second * a].into_iter().enumerate() {
                out.set_column(ASTIGMATISM.start + k, &(self.by_seen * gradient * (2.0 * behind)));
            }
        }
        out
    }
}

/// How a corner's pixel moves with the board's shape, given how it moves with the point in the board's frame.
pub(crate) fn board_columns(
    problem: &Problem,
    index: usize,
    by_point_in_board: &Matrix2x3<f64>,
    out: &mut FreeColumns,
) {
    out.fixed_view_mut::<2, 5>(0, BOARD_SHAPE.start).copy_from(&(by_point_in_board * shape(problem, index)));
}
