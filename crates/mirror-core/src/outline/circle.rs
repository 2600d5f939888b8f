//! A circle by consensus: random triples of points, the best refined by least squares.

use nalgebra::{Matrix3, Vector2, Vector3};

/// Random triples that are tried.
const TRIALS: usize = 160;
/// Twice the triangle's area below which three points count as in line, px².
const IN_LINE_PX2: f64 = 1e-6;

/// A circle in the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circle {
    /// Its centre, px.
    pub center_px: Vector2<f64>,
    /// Its radius, px.
    pub radius_px: f64,
}

/// A generator of indices that gives the same answer each time (SplitMix64; Steele et al. 2014).
pub(super) struct Indices(u64);

impl Indices {
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    pub fn next(&mut self, below: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) % below as u64) as usize
    }
}

/// The circle of a radius in the range with the most points (px) within the tolerance, or None; the same for the same points.
///
/// Points count as `1 − (distance / tolerance)²` (MSAC, Torr and Zisserman 2000); the winner is refined by least squares over its points
/// (Kåsa 1976).
pub fn fit_circle(
    points_px: &[Vector2<f64>],
    min_radius_px: f64,
    max_radius_px: f64,
    tolerance_px: f64,
) -> Option<Circle> {
    let count = points_px.len();
    if count < 3 {
        return None;
    }
    let fits = |radius: f64| radius >= min_radius_px && radius <= max_radius_px;
    let mut random = Indices(count as u64);
    let mut best: Option<(f64, Circle)> = None;
    for _ in 0..TRIALS {
        let [a, b, c] = core::array::from_fn(|_| points_px[random.next(count)]);
        let (ab, ac) = (b - a, c - a);
        let cross = 2.0 * ab.perp(&ac);
        if !(cross.abs() > IN_LINE_PX2) {
            continue;
        }
        let (ab2, ac2) = (ab.norm_squared(), ac.norm_squared());
        let offset = Vector2::new(ac.y * ab2 - ab.y * ac2, ab.x * ac2 - ac.x * ab2) / cross;
        let radius = offset.norm();
        if !fits(radius) {
            continue;
        }
        let circle = Circle { center_px: a + offset, radius_px: radius };
        let votes: f64 =
            points_px.iter().map(|p| (1.0 - (away(p, &circle) / tolerance_px).powi(2)).max(0.0)).sum();
        if best.is_none_or(|(most, _)| votes > most) {
            best = Some((votes, circle));
        }
    }
    let (_, circle) = best?;
    let near: Vec<_> = points_px.iter().filter(|p| away(p, &circle).abs() <= tolerance_px).copied().collect();
    match least_squares(&near) {
        Some(refined) if fits(refined.radius_px) => Some(refined),
        _ => Some(circle),
    }
}

fn away(point: &Vector2<f64>, circle: &Circle) -> f64 {
    (point - circle.center_px).norm() - circle.radius_px
}

/// Least squares of `|p|² = 2 p·c + k` about the points' middle.
fn least_squares(points: &[Vector2<f64>]) -> Option<Circle> {
    if points.len() < 3 {
        return None;
    }
    let middle = points.iter().sum::<Vector2<f64>>() / points.len() as f64;
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for point in points {
        let local = point - middle;
        let row = Vector3::new(2.0 * local.x, 2.0 * local.y, 1.0);
        normal += row * row.transpose();
        right += row * local.norm_squared();
    }
    let solution = normal.cholesky()?.solve(&right);
    let square = solution.z + solution.x.powi(2) + solution.y.powi(2);
    (square > 0.0).then(|| Circle { center_px: middle + solution.xy(), radius_px: square.sqrt() })
}
