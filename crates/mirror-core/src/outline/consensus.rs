//! Which edges round an expected outline belong to one moved and grown copy of it: consensus of random triples.
//!
//! Near the expected outline another one of the same shape lies at offsets `a + b cos θ + c sin θ`: grown by a, moved by (b, c). That holds for a circle and for the
//! ellipse of a sphere off the axis alike. What hides a part of the ball, or touches it, has edges of its own.

use super::circle::Indices;
use nalgebra::{Matrix3, Vector3};

/// Random triples that are tried.
const TRIALS: usize = 120;
/// Edges count less from this standard deviation on, px.
const FULL_WEIGHT_STD_PX: f64 = 0.15;
/// Triples whose directions are nearer to each other than this determine no copy (determinant).
const LEAST_SPREAD: f64 = 0.05;

/// Edges within twice the tolerance (px) of the copy with most agreement, by MSAC (Torr and Zisserman 2000); None
/// where no triple determines one.
///
/// `offset_px`, `std_px` and `found` by evenly spaced ray; the copy may be grown by `growth_px` (least, most).
pub(super) fn of_one_outline(
    offset_px: &[f64],
    std_px: &[f64],
    found: &[bool],
    tolerance_px: f64,
    growth_px: (f64, f64),
) -> Option<Vec<bool>> {
    let turn = core::f64::consts::TAU / offset_px.len() as f64;
    let rows: Vec<(Vector3<f64>, f64, f64)> = (0..offset_px.len())
        .filter(|i| found[*i])
        .map(|i| {
            let (sine, cosine) = (turn * i as f64).sin_cos();
            (Vector3::new(1.0, cosine, sine), offset_px[i], (FULL_WEIGHT_STD_PX / std_px[i]).min(1.0))
        })
        .collect();
    if rows.len() < 3 {
        return None;
    }
    let mut random = Indices::new(rows.len() as u64);
    let mut best: Option<(f64, Vector3<f64>)> = None;
    for _ in 0..TRIALS {
        let [a, b, c] = core::array::from_fn(|_| &rows[random.next(rows.len())]);
        let matrix = Matrix3::from_rows(&[a.0.transpose(), b.0.transpose(), c.0.transpose()]);
        if !(matrix.determinant().abs() > LEAST_SPREAD) {
            continue;
        }
        let Some(inverse) = matrix.try_inverse() else { continue };
        let copy = inverse * Vector3::new(a.1, b.1, c.1);
        if !(copy.x >= growth_px.0 && copy.x <= growth_px.1) {
            continue;
        }
        let votes: f64 = rows
            .iter()
            .map(|(row, offset, weight)| {
                let away = (offset - row.dot(&copy)) / tolerance_px;
                weight * (1.0 - away * away).max(0.0)
            })
            .sum();
        if best.is_none_or(|(most, _)| votes > most) {
            best = Some((votes, copy));
        }
    }
    let (_, copy) = best?;
    Some(
        (0..offset_px.len())
            .map(|i| {
                let (sine, cosine) = (turn * i as f64).sin_cos();
                let away = offset_px[i] - copy.x - copy.y * cosine - copy.z * sine;
                found[i] && away.abs() <= 2.0 * tolerance_px
            })
            .collect(),
    )
}
