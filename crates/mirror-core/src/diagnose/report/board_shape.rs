//! Whether the board is flat: corners that lie beside their grid in the same way in all pictures, or in each picture in
//! another way.
//!
//! Each picture's mirror is found from its corners alone here: wrong markers would turn it, and bend the board.
//!
//! A board that is bent, or on paper that flutters, gives a wrong mirror in each picture. No effect of the vocabulary has
//! its shape, and the noise of the corners, estimated from the views of one posture, contains it. In the board's frame:
//!
//! * a corner's displacement over pictures, `d = H⁻¹ g`, `H = Σ JᵀJ / σ²`, `g = Σ Jᵀ r / σ²` ([`super::fields`]), of the first
//!   half of the session and of the second: `d₁ᵀ (H₁ + H₂) d₂`, summed over the corners, is what the shape gains if it is the
//!   same in both. By noise it is 0 on average, also where a corner's errors persist over some pictures;
//! * in each picture a bend `z = b₁ x² + b₂ xy + b₃ y²`, fitted to its corners: its gain is a chi-squared of 3 degrees of freedom by
//!   noise alone. The median over the pictures is compared with that distribution's.
//!
//! Both fits have the weights `w = 1/(1 + (r/(c σ))²)` of their own residuals r (Cauchy), so that some corners that were found beside
//! their place are no shape. Either is told where the excess is significant and a noticeable share of the corners' noise.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::criteria::lack_of_fit::noticeable_excess;
use crate::diagnose::data::depends_on::DependsOn;
use crate::diagnose::data::diagnosis::{Diagnosis, Field, Verdict, Where};
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::frame::{FrameWork, SeenCorner, Task};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::{A_GAP, FAR_DEVIATIONS, Guard, SURE_DEVIATIONS};
use crate::diagnose::report::fields::{Over, field};
use crate::error::Result;
use crate::statistics::{CHI_SQUARED_MEDIANS, median};
use nalgebra::{Matrix2x3, Matrix3, Vector2, Vector3};
use rayon::prelude::*;

const BOARD: &str = "board";
/// Times its noise a marker counts for nothing beside a board's corners.
const UNHEARD: Guard = 1e4;

/// What contradicts a flat board.
#[derive(Debug, Clone)]
pub(crate) struct NotFlat {
    told: String,
    /// The corners' displacements, where they are the same in all pictures.
    field: Option<Field>,
}

/// Whether a gain is more than noise gives, of so many numbers, by a share of the rows' squares.
fn is_seen(excess: f64, numbers: f64, least: f64) -> bool {
    excess > FAR_DEVIATIONS * (2.0 * numbers).sqrt() && excess > least
}

/// How much a residual (px) counts beside the noise.
fn weight(residual_px: Vector2<f64>, noise_px: f64) -> f64 {
    1.0 / (1.0 + residual_px.norm_squared() / (SURE_DEVIATIONS * noise_px).powi(2))
}

/// Three numbers that fit residuals (px) with robust weights: rows by the numbers and residuals. Their information and gradient at 0, and
/// the numbers; none where the rows do not show them.
fn robustly(rows: &[(Matrix2x3<f64>, Vector2<f64>)], noise_px: f64) -> Option<Robustly> {
    let mut at = None;
    for _ in 0..=SOLVER.rounds {
        let (mut information, mut gradient) = (Matrix3::zeros(), Vector3::zeros());
        for (by, residual_px) in rows {
            let left = |numbers: &Vector3<f64>| weight(residual_px - by * numbers, noise_px);
            let w = at.as_ref().map_or(1.0, |found: &Robustly| left(&found.numbers));
            information += by.tr_mul(by) * w;
            gradient += by.tr_mul(residual_px) * w;
        }
        let numbers = information.cholesky()?.solve(&gradient);
        at = Some(Robustly { information, gain: gradient.dot(&numbers), numbers });
    }
    at
}

/// A robust fit of three numbers.
struct Robustly {
    information: Matrix3<f64>,
    numbers: Vector3<f64>,
    /// What it lowers the weighted sum of squares by, px².
    gain: f64,
}

/// What each corner gains by a displacement that is the same in both halves, times the variance of the noise.
fn same_in_both(corners: usize, first: &[Picture], second: &[Picture], noise_px: f64) -> Vec<f64> {
    let fits = |half: &[Picture]| -> Vec<Option<Robustly>> {
        let mut of_corner = vec![Vec::new(); corners];
        for seen in half.iter().flat_map(|picture| &picture.corners) {
            of_corner[seen.index].push((seen.by_board, seen.residual_px));
        }
        of_corner.iter().map(|rows| robustly(rows, noise_px)).collect()
    };
    let both = fits(first).into_iter().zip(fits(second));
    let gain = |(a, b): (Option<Robustly>, Option<Robustly>)| {
        let (a, b) = (a?, b?);
        Some(a.numbers.dot(&((a.information + b.information) * b.numbers)))
    };
    both.filter_map(gain).collect()
}

/// Whether the corners contradict a flat board, at the model found.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn not_flat(findings: &Findings<'_>) -> Result<Option<NotFlat>> {
    let search = &findings.search;
    let (problem, noise) = (&search.problem, search.detector_noise());
    if problem.board.is_none() {
        return Ok(None);
    }
    let deformation = search.deformation(&findings.found.fit.model);
    let pictures = pictures(problem, &deformation, noise)?;
    // Corners are found better than markers: what is within a marker's noise matters to nothing.
    let matters = (noise.marker_px / noise.corner_px).max(1.0).powi(2);
    let rows = matters * 2.0 * pictures.iter().map(|picture| picture.corners.len() as f64).sum::<f64>();
    let (first, second) = pictures.split_at(pictures.len() / 2);
    let gains = same_in_both(problem.corners.len(), first, second, noise.corner_px);
    let gained = gains.iter().sum::<f64>() / noise.corner_px.powi(2);
    // Errors of a corner that persist over most of a session have a tenth of the rows' squares.
    if is_seen(gained, 3.0 * gains.len() as f64, noticeable_excess() * rows) {
        let Some(field) = field(problem, noise, Over::Board, &deformation, None)? else { return Ok(None) };
        let off = |k: usize| field.points.iter().map(move |p| p.without[k].abs()).fold(0.0, f64::max) * 1e3;
        let told = format!(
            "the corners of the board lie beside a flat grid, in all pictures alike: by up to {:.1} mm out of its plane and {:.1} mm in it. Lay a ruler on it: \
             fix it to a plate of glass or aluminium, or print it again; until then each mirror is a little wrong",
            off(2),
            off(0).max(off(1))
        );
        return Ok(Some(NotFlat { told, field: Some(Field { at: BOARD.into(), ..field }) }));
    }
    let bends: Vec<&Bend> = pictures.iter().filter_map(|picture| picture.bend.as_ref()).collect();
    let count = bends.len() as f64;
    let usual = median(bends.iter().map(|bend| bend.gain).collect()) / CHI_SQUARED_MEDIANS[2];
    let usual_mm = median(bends.iter().map(|bend| bend.largest_m).collect()) * 1e3;
    // Of flat boards it is at most a hundredth.
    Ok(is_seen(3.0 * count * (usual - 1.0), 3.0 * count, (A_GAP - 1.0) * rows).then(|| NotFlat {
        told: format!(
            "the board is bent in each picture in another way, by {usual_mm:.1} mm (median): paper that moves, or a plate that is too thin. Fix it to a \
             plate of glass or aluminium and record again; until then each mirror is a little wrong"
        ),
        field: None,
    }))
}

/// What a picture shows of the board's shape.
struct Picture {
    corners: Vec<SeenCorner>,
    bend: Option<Bend>,
}

/// A picture's bend of the board.
struct Bend {
    gain: f64,
    /// The largest displacement out of the plane that it gives a corner, m.
    largest_m: f64,
}

fn pictures(problem: &Problem, deformation: &Deformation, noise: Noise) -> Result<Vec<Picture>> {
    let eye = problem.eye(deformation)?;
    let noise = Noise { marker_px: UNHEARD * noise.marker_px, ..noise };
    let task = Task { with_board: true, ..Task::of_residuals(problem, deformation, eye.as_ref(), noise) };
    let half = problem.corners.iter().map(|c| c.x.abs().max(c.y.abs())).fold(f64::MIN_POSITIVE, f64::max);
    let modes = |index: usize| {
        let (x, y) = (problem.corners[index].x / half, problem.corners[index].y / half);
        Vector3::new(x * x, x * y, y * y)
    };
    let bend_of = |corners: &[SeenCorner]| {
        let row = |c: &SeenCorner| (c.by_board.column(2) * modes(c.index).transpose(), c.residual_px);
        let rows: Vec<_> = corners.iter().map(row).collect();
        let fit = robustly(&rows, noise.corner_px)?;
        let bent = |c| modes(c).dot(&fit.numbers).abs();
        let largest_m = (0..problem.corners.len()).map(bent).fold(0.0, f64::max);
        Some(Bend { gain: fit.gain / noise.corner_px.powi(2), largest_m })
    };
    let of_frame = |work: &mut FrameWork, frame: usize| {
        work.evaluate(problem, &task, frame).then(|| {
            let corners: Vec<SeenCorner> = work.seen_corners(problem).collect();
            let bend = bend_of(&corners);
            Picture { corners, bend }
        })
    };
    Ok((0..problem.frames.len())
        .into_par_iter()
        .map_init(|| FrameWork::new(problem), of_frame)
        .flatten()
        .collect())
}

/// Says so: a session with such a board is neither without a fault nor explained.
pub(crate) fn tell(diagnosis: &mut Diagnosis, not_flat: NotFlat) {
    let depends_on = if not_flat.field.is_some() { DependsOn::Nothing } else { DependsOn::EachPosture };
    match diagnosis.verdict {
        Verdict::None => {
            diagnosis.verdict = Verdict::Unknown;
            diagnosis.sentence = format!("Markers show nothing wrong, but {}.", not_flat.told);
        }
        Verdict::Explained => {
            diagnosis.verdict = Verdict::Partial;
            diagnosis.sentence += &format!(" But {}.", not_flat.told);
        }
        Verdict::Partial | Verdict::Unknown => diagnosis.warnings.push(not_flat.told),
        Verdict::Insufficient => return,
    }
    diagnosis.fields.extend(not_flat.field);
    let places = &mut diagnosis.r#where;
    match places.iter_mut().find(|place| place.at == BOARD) {
        Some(board) => board.depends_on = board.depends_on.take().or(Some(depends_on)),
        None => {
            let share = if places.is_empty() { 1.0 } else { 0.0 };
            places.push(Where { at: BOARD.into(), share, depends_on: Some(depends_on) });
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// A displacement of 20 σ is found as it is, and a twentieth of the residuals far off makes no other one of it, nor one of none.
    #[test]
    fn a_displacement_is_found_beside_false_residuals() {
        let noise_px = 0.2;
        let found = |true_m: Vector3<f64>, off_px: f64| {
            let mut random = Random::new(9);
            let rows: Vec<_> = (0..60)
                .map(|i| {
                    let by = Matrix2x3::from_fn(|_, _| random.normal() * 1e3);
                    let noise = Vector2::new(random.normal(), random.normal()) * noise_px;
                    let off = if i % 20 == 7 { off_px } else { 0.0 };
                    (by, by * true_m + noise + Vector2::new(off, -off))
                })
                .collect();
            robustly(&rows, noise_px).unwrap()
        };
        let (none, displaced) = (Vector3::zeros(), Vector3::new(0.0, 0.001, -0.004));
        for off_px in [0.0, 4.0, 15.0] {
            assert!(found(none, off_px).gain < 16.0 * noise_px.powi(2), "{}", found(none, off_px).gain);
            let numbers = found(displaced, off_px).numbers;
            assert!((numbers - displaced).norm() < 2e-4, "{numbers}");
        }
    }
}
