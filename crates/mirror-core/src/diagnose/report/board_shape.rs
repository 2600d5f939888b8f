//! Whether the board is flat: corners that lie beside their grid in the same way in all pictures, or in each picture in
//! another way.
//!
//! A board that is bent, or on paper that flutters, gives a wrong mirror in each picture. No effect of the vocabulary has
//! its shape, and the noise of the corners, estimated from the views of one posture, contains it. In the board's frame:
//!
//! * a corner's displacement over pictures, `d = H⁻¹ g`, `H = Σ JᵀJ / σ²`, `g = Σ Jᵀ r / σ²` ([`super::fields`]), of the first
//!   half of the session and of the second: `d₁ᵀ (H₁ + H₂) d₂`, summed over the corners, is what the shape gains if it is the
//!   same in both. By noise it is 0 on average, also where a corner's errors persist over some pictures;
//! * in each picture a bend `z = b₁ x² + b₂ xy + b₃ y²`, fitted to its corners: it gains 3 by noise alone.
//!
//! Either is told where the excess is significant and a noticeable share of the corners' noise.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::criteria::lack_of_fit::noticeable_excess;
use crate::diagnose::data::diagnosis::{Diagnosis, Field, Verdict, Where};
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::frame::{FrameWork, SeenCorner, Task};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::principles::{A_GAP, FAR_DEVIATIONS};
use crate::diagnose::report::fields::{Over, field};
use crate::error::Result;
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

const BOARD: &str = "board";

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

/// What each corner gains by a displacement that is the same in both halves, times the variance of the noise.
fn same_in_both(corners: usize, first: &[Picture], second: &[Picture]) -> Vec<f64> {
    let sums = |half: &[Picture]| {
        let mut of_corner = vec![(Matrix3::zeros(), Vector3::zeros()); corners];
        for seen in half.iter().flat_map(|picture| &picture.corners) {
            let (h, g) = &mut of_corner[seen.index];
            *h += seen.by_board.tr_mul(&seen.by_board);
            *g += seen.by_board.tr_mul(&seen.residual_px);
        }
        of_corner
    };
    let solved = |(h, g): &(Matrix3<f64>, Vector3<f64>)| h.cholesky().map(|factor| factor.solve(g));
    let both = sums(first).into_iter().zip(sums(second));
    both.filter_map(|(a, b)| Some(solved(&a)?.dot(&((a.0 + b.0) * solved(&b)?)))).collect()
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
    let gains = same_in_both(problem.corners.len(), first, second);
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
    let gained: f64 = bends.iter().map(|bend| bend.gain).sum();
    let rms_mm = (bends.iter().map(|b| b.largest_m.powi(2)).sum::<f64>() / count.max(1.0)).sqrt() * 1e3;
    // Of flat boards it is at most a hundredth.
    Ok(is_seen(gained - 3.0 * count, 3.0 * count, (A_GAP - 1.0) * rows).then(|| NotFlat {
        told: format!(
            "the board is bent in each picture in another way, by {rms_mm:.1} mm (root mean square): paper that moves, or a plate that is too thin. Fix it to a \
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
    let task = Task { with_board: true, ..Task::of_residuals(problem, deformation, eye.as_ref(), noise) };
    let half = problem.corners.iter().map(|c| c.x.abs().max(c.y.abs())).fold(f64::MIN_POSITIVE, f64::max);
    let modes = |index: usize| {
        let (x, y) = (problem.corners[index].x / half, problem.corners[index].y / half);
        Vector3::new(x * x, x * y, y * y)
    };
    let bend_of = |corners: &[SeenCorner]| {
        let (mut h, mut g) = (Matrix3::zeros(), Vector3::zeros());
        for corner in corners {
            let (m, j) = (modes(corner.index), corner.by_board.column(2) / noise.corner_px);
            h += m * m.transpose() * j.norm_squared();
            g += m * j.dot(&corner.residual_px) / noise.corner_px;
        }
        let bend = h.cholesky()?.solve(&g);
        let largest_m = (0..problem.corners.len()).map(|c| modes(c).dot(&bend).abs()).fold(0.0, f64::max);
        Some(Bend { gain: g.dot(&bend), largest_m })
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
    let depends_on = if not_flat.field.is_some() { "nothing" } else { "posture, each by itself" };
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
        Some(board) => board.depends_on = board.depends_on.take().or(Some(depends_on.into())),
        None => {
            let share = if places.is_empty() { 1.0 } else { 0.0 };
            places.push(Where { at: BOARD.into(), share, depends_on: Some(depends_on.into()) });
        }
    }
}
