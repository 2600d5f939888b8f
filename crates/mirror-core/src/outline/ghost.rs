//! The ghost of a pane in a picture of the board: its strength and where it lies.
//!
//! The board's pattern M is known: `P(x) = c M(x) + s (M(x − d) + M(x + d)) + a (M(x − d) − M(x + d))`, in linear light. A lens, a shake and a codec spread light to
//! both sides alike (s); a ghost lies on one side (a). Near the edges of the squares the drawn pattern is never quite right, and a ghost stands beside them: a
//! pixel's variance is `s₀² + s₁² |∇M|²`, both numbers from what is left.

use super::pattern_rows::{Row, Rows, dot, dots, weighted};
use crate::error::{Error, Result};
use crate::statistics::median;
use nalgebra::{Matrix2, Vector2};

/// Nearer than this a ghost looks like blur, px.
const NEAREST_PX: f64 = 1.9;
/// The most pixels that are read: more take time and tell no more.
const MOST_PIXELS: usize = 1500;
/// Least strength of a ghost, as a share of all light, and least share of the residual's squares that its lying on one side explains.
const LEAST_STRENGTH: f64 = 0.012;
const MOST_STRENGTH: f64 = 0.5;
const LEAST_EXPLAINED: f64 = 0.015;
/// Shifts at which the weakest ghost that is told is taken, px.
const USUAL_SHIFT_PX: (f64, f64) = (2.4, 4.2);
/// A pane's front returns some hundredths of the light: the strength's deviation before the picture is seen. So many pixels share their errors.
const USUAL_STRENGTH: f64 = 0.05;
const SHARED_PIXELS: f64 = 10.0;
/// Shifts up to so many px beside the best one count in its place by what they explain beyond this share of what it does.
const BESIDE: (f64, f64) = (1.5, 0.6);
/// So many times the pixels are weighted again, by what is left when the ghost has been told.
const REWEIGHTINGS: usize = 1;
/// Least share of a variance that is the same everywhere, against the median of what is left.
const LEAST_EVEN: f64 = 0.2;

/// A part of a picture, and the pattern drawn there; rows of pixels.
#[derive(Debug, Clone, Copy)]
pub struct PatternView<'a> {
    /// Pixels across.
    pub width: usize,
    /// And down.
    pub height: usize,
    /// Linear light, less its mean over two squares each way.
    pub light: &'a [f32],
    /// The farthest ghost that is looked for, px.
    pub reach: usize,
}

/// What a view of the pattern shows of a ghost.
#[derive(Debug, Clone)]
pub struct PatternGhost {
    /// As a share of all light; 0 where none is told.
    pub strength: f64,
    /// Where it lies, px.
    pub shift_px: Vector2<f64>,
    /// The weakest that would be told.
    pub weakest: f64,
    model: Vec<f32>,
    width: usize,
    height: usize,
    kept: Vec<usize>,
    part: Row,
    basis: Rows,
    root: Row,
}

/// The ghost in a view of the pattern; None where nothing of the pattern is seen. `models` are the pattern with several blurs, as the light less their means: the
/// one that fits best is taken.
///
/// # Errors
/// [`Error::LengthMismatch`] for another number of pixels.
pub fn pattern_ghost(view: &PatternView<'_>, models: &[&[f32]]) -> Result<Option<PatternGhost>> {
    let needed = view.width * view.height;
    for got in models.iter().chain([&view.light]).map(|pixels| pixels.len()) {
        if got != needed {
            return Err(Error::LengthMismatch {
                what: format!("pixels of a view of {} × {} px", view.width, view.height),
                got,
                needed,
            });
        }
    }
    let around = view.reach.saturating_mul(2);
    if view.width <= around || view.height <= around || view.reach < 1 {
        return Ok(None);
    }
    let kept = kept_pixels(view);
    let part = Row::of(&kept, |at| view.light[at]);
    let tried = models.iter().filter_map(|model| {
        let basis = Rows::of_pattern(model, view.width, view.height, &kept);
        let left = basis.flat()?.rest(&part);
        let square = dot(&left, &left);
        Some((*model, basis, left, square))
    });
    Ok(tried.min_by(|a, b| a.3.total_cmp(&b.3)).and_then(|(model, basis, left, _)| {
        let mut found = PatternGhost {
            strength: 0.0,
            shift_px: Vector2::zeros(),
            weakest: 0.0,
            model: model.to_vec(),
            width: view.width,
            height: view.height,
            kept,
            part,
            basis,
            root: left.clone(),
        };
        found.tell(view.reach, &left).map(|()| found)
    }))
}

/// Every so many pixels beyond the reach from the border, in the order of rows; not in columns.
fn kept_pixels(view: &PatternView<'_>) -> Vec<usize> {
    let (across, down) = (view.width - 2 * view.reach, view.height - 2 * view.reach);
    let stride = match (across * down / MOST_PIXELS).max(1) {
        stride if stride > 1 && across.is_multiple_of(stride) => stride + 1,
        stride => stride,
    };
    (0..across * down)
        .step_by(stride)
        .map(|i| (view.reach + i / across) * view.width + view.reach + i % across)
        .collect()
}

/// The best of all shifts: its index, the parts that lie on both and on one side, its strength as a share of all light, the share of the squares that the latter
/// explains, and that in squares of independent pixels; and for every shift its part on one side, what that explains, and the strength that it must have to be told.
struct Found {
    index: usize,
    even: f64,
    difference: f64,
    strength: f64,
    explained: f64,
    told: f64,
    differences: Vec<f64>,
    gained: Vec<f64>,
    weakest: Vec<f64>,
}

impl PatternGhost {
    /// Least squares by the pattern and, for each shift, the sum and the difference of the pattern there and opposite; the most probable difference.
    fn tell(&mut self, reach: usize, left: &Row) -> Option<()> {
        let most = reach as isize;
        let shifts: Vec<Vector2<f64>> = (0..=most)
            .flat_map(|down| (-most..=most).map(move |across| (across, down)))
            .filter(|(across, down)| *down > 0 || *across > 0)
            .map(|(across, down)| Vector2::new(across as f64, down as f64))
            .filter(|shift| (NEAREST_PX..=reach as f64).contains(&shift.norm()))
            .collect();
        let pairs: Vec<[Row; 2]> = shifts
            .iter()
            .map(|shift| {
                let by = shift.y as isize * self.width as isize + shift.x as isize;
                let opposite = |at: &usize| {
                    (self.model[at.wrapping_add_signed(-by)], self.model[at.wrapping_add_signed(by)])
                };
                let (both, apart): (Vec<f32>, Vec<f32>) =
                    self.kept.iter().map(opposite).map(|(one, other)| (one + other, one - other)).unzip();
                [Row::from_values(both.into_iter()), Row::from_values(apart.into_iter())]
            })
            .collect();
        self.root = weights(left, &self.basis.steepness);
        let mut found = self.best(&pairs)?;
        for _ in 0..REWEIGHTINGS {
            // (A strong ghost is no error of the pattern.)
            let [both, apart] = &pairs[found.index];
            let without = self.part.less(found.even, both).less(found.difference, apart);
            let left = self.basis.times(&self.root).flat()?.rest(&without.times(&self.root));
            self.root = weights(&left.over(&self.root), &self.basis.steepness);
            found = self.best(&pairs)?;
        }
        let usual = |shift: &Vector2<f64>| (USUAL_SHIFT_PX.0..=USUAL_SHIFT_PX.1).contains(&shift.norm());
        let of_usual: Vec<f64> =
            found.weakest.iter().zip(&shifts).filter(|(_, s)| usual(s)).map(|(w, _)| *w).collect();
        self.weakest = median(if of_usual.is_empty() { found.weakest.clone() } else { of_usual });
        if found.explained < LEAST_EXPLAINED
            || !(LEAST_STRENGTH..MOST_STRENGTH).contains(&found.strength.abs())
        {
            return Some(());
        }
        // Between the pixels: by what the shifts beside it explain.
        let least = BESIDE.1 * found.gained[found.index];
        let (mut place, mut total) = (Vector2::zeros(), 0.0);
        for (i, shift) in shifts.iter().enumerate() {
            let beside = (shift - shifts[found.index]).norm() < BESIDE.0;
            if beside && found.gained[i] > least && found.differences[i] * found.difference > 0.0 {
                place += shift * (found.gained[i] - least);
                total += found.gained[i] - least;
            }
        }
        self.strength = found.strength.abs();
        self.shift_px = place * (found.strength.signum() / total);
        Some(())
    }

    /// What a ghost explains, in squares of independent pixels, that lies `ends_px` from the first, second, third and fourth corner of the view (rows from above),
    /// and evenly changing between them.
    pub fn explained_by(&self, ends_px: &[Vector2<f64>; 4]) -> f64 {
        let (right, bottom) = (self.width as f64 - 1.0, self.height as f64 - 1.0);
        let at = |pixel: usize, side: f64| {
            let (u, v) = ((pixel % self.width) as f64, (pixel / self.width) as f64);
            let (x, y) = (u / right, v / bottom);
            let way = (ends_px[0] * (1.0 - x) + ends_px[1] * x) * (1.0 - y)
                + (ends_px[2] * (1.0 - x) + ends_px[3] * x) * y;
            self.model_at(u - side * way.x, v - side * way.y)
        };
        let pair = [
            Row::of(&self.kept, |pixel| at(pixel, 1.0) + at(pixel, -1.0)),
            Row::of(&self.kept, |pixel| at(pixel, 1.0) - at(pixel, -1.0)),
        ];
        self.best(&[pair]).map_or(0.0, |found| found.told)
    }

    /// The pattern between pixels, bilinear.
    fn model_at(&self, u: f64, v: f64) -> f32 {
        let (u, v) = (u.clamp(0.0, self.width as f64 - 1.001), v.clamp(0.0, self.height as f64 - 1.001));
        let (column, row) = (u as usize, v as usize);
        let (a, b) = ((u - column as f64) as f32, (v - row as f64) as f32);
        let at = row * self.width + column;
        let m = &self.model;
        (m[at] * (1.0 - a) + m[at + 1] * a) * (1.0 - b)
            + (m[at + self.width] * (1.0 - a) + m[at + self.width + 1] * a) * b
    }

    /// The most probable of shifts, by their sums and differences.
    fn best(&self, pairs: &[[Row; 2]]) -> Option<Found> {
        let (part, basis) = (self.part.times(&self.root), self.basis.times(&self.root));
        let flat = basis.flat()?;
        let rest = flat.rest(&part);
        let all_squares = dot(&rest, &rest);
        let main = basis.main_of(&part)?;
        if !(all_squares > 0.0 && main.abs() > 0.0) {
            return None;
        }
        let count = part.len() as f64;
        let (mut differences, mut gained, mut telling) = (Vec::new(), Vec::new(), Vec::new());
        let mut parts = Vec::new();
        let (mut both, mut apart) = (part.clone(), part.clone());
        for pair in pairs {
            weighted(pair, &self.root, &mut both, &mut apart);
            let mut squares = dot(&both, &both);
            let mut mixed = dot(&both, &apart);
            let mut own = dot(&apart, &apart);
            for row in &flat.rows {
                let (of_both, of_apart) = dots(&both, &apart, row);
                squares -= of_both * of_both;
                mixed -= of_both * of_apart;
                own -= of_apart * of_apart;
            }
            let squares = squares.max(1e-9);
            let (with_both, with_apart) = dots(&both, &apart, &rest);
            let tells = (own - mixed * mixed / squares).max(1e-6 * own);
            let difference = (with_apart - mixed * with_both / squares) / tells;
            differences.push(difference);
            gained.push(difference * difference * tells);
            telling.push(tells);
            parts.push((squares, mixed, with_both));
        }
        let independent = count / all_squares / SHARED_PIXELS;
        // Near shifts are much like slopes and bends, and need a strong second picture to explain what a farther, weaker one does.
        let value =
            |i: usize| gained[i] * independent - (2.0 * differences[i] / main / USUAL_STRENGTH).powi(2);
        let index = (0..pairs.len()).max_by(|a, b| value(*a).total_cmp(&value(*b)))?;
        let (squares, mixed, with_both) = parts[index];
        let even = (with_both - differences[index] * mixed) / squares;
        // The light of all: the pattern's own, and twice the even part.
        weighted(&pairs[index], &self.root, &mut both, &mut apart);
        let other = part.less(even, &both).less(differences[index], &apart);
        let total = basis.main_of(&other)? + 2.0 * even;
        let explained = gained[index] / (all_squares - with_both * with_both / squares).max(1e-12);
        let least = |tells: &f64| {
            (2.0 * (LEAST_EXPLAINED * all_squares / tells).sqrt() / total.abs()).max(LEAST_STRENGTH)
        };
        Some(Found {
            index,
            even,
            difference: differences[index],
            strength: 2.0 * differences[index] / total,
            explained,
            told: gained[index] * independent,
            weakest: telling.iter().map(least).collect(),
            differences,
            gained,
        })
    }
}

/// Roots of the pixels' weights, by the variance `s₀² + s₁² |∇M|²` that what is left of them shows; 1 on average.
fn weights(left: &Row, steepness: &Row) -> Row {
    let square: Vec<f64> = left.values().map(|l| l * l).collect();
    let steep: Vec<f64> = steepness.values().collect();
    let least = LEAST_EVEN * median(square.clone()) + 1e-12;
    let (mut even, mut by_slope) = (0.0, 0.0);
    let mut weight = vec![1.0; square.len()];
    for _ in 0..3 {
        let (mut normal, mut told) = (Matrix2::zeros(), Vector2::zeros());
        for ((w, t), q) in weight.iter().zip(&steep).zip(&square) {
            normal += Matrix2::new(*w, w * t, w * t, w * t * t);
            told += Vector2::new(w * q, w * q * t);
        }
        let solved = normal.try_inverse().map_or(Vector2::new(least, 0.0), |inverse| inverse * told);
        (even, by_slope) = (solved.x.max(least), solved.y.max(0.0));
        weight = steep.iter().map(|t| (even + by_slope * t).powi(-2)).collect();
    }
    let root: Vec<f64> = steep.iter().map(|t| (even + by_slope * t).powf(-0.5)).collect();
    let mean = (root.iter().map(|r| r * r).sum::<f64>() / root.len() as f64).sqrt();
    Row::from_values(root.iter().map(|r| (r / mean) as f32))
}
