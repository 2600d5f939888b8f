//! A closed-form camera–board transform from three or more reflected poses of the board.
//!
//! View i shows the board's reflection at the improper pose `(L_i, t_i) = (H_i R, t + c_i n_i)`, where (R, t) is the
//! transform and `H_i = I − 2 n_i n_iᵀ`. So:
//!
//! 1. `L_i L_jᵀ = H_i H_j` is a rotation about `n_i × n_j`: each normal is orthogonal to the axes of all pairs that it
//!    takes part in (the orthogonality that Takahashi et al. 2012, "TNM", build on);
//! 2. `R` is the rotation nearest to the mean of `H_i L_i`;
//! 3. t is the point nearest to the lines through `t_i` along `n_i`.
//!
//! Where the mirror only turns about one axis (yaw), all axes of step 1 are the same and leave one angle open; the
//! lines of step 3 then fix it: it is searched. A view whose planar pose is ambiguous offers both poses, and
//! candidates from triples of views withstand a wrong one; what fits all pictures best, wins.

use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::geometry::rotation::nearest;
use crate::mirror::{Board, BoardView, EstimatorOptions, MirrorEstimator, PlanarPose, Rig};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use rayon::prelude::*;

/// Fewest mirror poses that determine the transform.
pub(super) const FEWEST_VIEWS: usize = 3;
/// Most triples of views that are tried.
const MOST_TRIPLES: usize = 24;
/// A second pose counts as possible where its residual is below this multiple of the better one's.
const AMBIGUOUS_RATIO: f64 = 2.0;
/// Steps of the search for the angle that a mirror turning about one axis leaves open (one degree).
const ANGLE_STEPS: usize = 180;
/// How many of the best angles are judged on the pictures.
const ANGLES_JUDGED: usize = 6;
/// Upper bound of a residual (px) when candidates are compared, so that one bad view does not decide.
const JUDGE_CAP_PX: f64 = 10.0;

/// The improper pose of the reflected board.
#[derive(Clone, Copy)]
struct Reflected {
    linear: Matrix3<f64>,
    at: Vector3<f64>,
}

impl Reflected {
    /// Of a planar pose D with true labels: `B′ = D diag(1, 1, −1)`.
    fn of(camera_from_d: &Isometry3<f64>) -> Self {
        let mut linear = camera_from_d.rotation.to_rotation_matrix().into_inner();
        linear.column_mut(2).neg_mut();
        Self { linear, at: camera_from_d.translation.vector }
    }
}

fn reflection(n: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::identity() - n * n.transpose() * 2.0
}

/// Steps 2 and 3, with the squared distances of t from its lines.
fn transform(poses: &[Reflected], normals: &[Vector3<f64>]) -> Option<(Isometry3<f64>, f64)> {
    let mut mean = Matrix3::zeros();
    let (mut matrix, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for (pose, n) in poses.iter().zip(normals) {
        mean += reflection(n) * pose.linear;
        let across = Matrix3::identity() - n * n.transpose();
        matrix += across;
        right += across * pose.at;
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(nearest(&mean)?));
    let t = matrix.cholesky()?.solve(&right);
    let misses = poses
        .iter()
        .zip(normals)
        .map(|(pose, n)| {
            let away = t - pose.at;
            (away - n * n.dot(&away)).norm_squared()
        })
        .sum();
    Some((Isometry3::from_parts(Translation3::from(t), rotation), misses))
}

/// The rotation vector of `L_i L_jᵀ = H_i H_j`: twice the angle from n_j to n_i, about `n_j × n_i`.
fn turn_between(a: &Reflected, b: &Reflected) -> Vector3<f64> {
    let turn = Rotation3::from_matrix_unchecked(a.linear * b.linear.transpose());
    UnitQuaternion::from_rotation_matrix(&turn).scaled_axis()
}

/// Step 1: the normal orthogonal to all axes, for each view.
fn normals_by_orthogonality(poses: &[Reflected]) -> Vec<Vector3<f64>> {
    poses
        .iter()
        .map(|a| {
            let mut axes = Matrix3::zeros();
            for b in poses {
                // Weighted with the angle: two nearly parallel mirrors have hardly an axis.
                let axis = turn_between(a, b);
                axes += axis * axis.transpose();
            }
            let eigen = axes.symmetric_eigen();
            eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned()
        })
        .collect()
}

/// A mirror that turns about one axis: each angle of the first normal gives all others; the best by the lines of step 3.
fn transforms_by_angle(poses: &[Reflected]) -> Vec<Isometry3<f64>> {
    let Some(first) = poses.first() else { return Vec::new() };
    let turns: Vec<Vector3<f64>> = poses.iter().map(|p| turn_between(first, p)).collect();
    let axes = turns.iter().fold(Matrix3::zeros(), |sum, t| sum + t * t.transpose());
    let eigen = axes.symmetric_eigen();
    let axis: Vector3<f64> = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned();
    let e1 = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    let e2 = axis.cross(&e1);
    let mut found: Vec<(f64, Isometry3<f64>)> = (0..ANGLE_STEPS)
        .filter_map(|step| {
            let angle = std::f64::consts::PI * step as f64 / ANGLE_STEPS as f64;
            let n0 = e1 * angle.cos() + e2 * angle.sin();
            let normals: Vec<Vector3<f64>> =
                turns.iter().map(|t| UnitQuaternion::from_scaled_axis(t * -0.5) * n0).collect();
            transform(poses, &normals).map(|(pose, misses)| (misses, pose))
        })
        .collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found.into_iter().take(ANGLES_JUDGED).map(|(_, pose)| pose).collect()
}

/// Both possible poses of a view.
fn possible(pose: &PlanarPose) -> Vec<Reflected> {
    let mut all = vec![Reflected::of(&pose.camera_from_pattern)];
    if let Some(other) = &pose.alternative
        && other.rms_px < AMBIGUOUS_RATIO * pose.rms_px
    {
        all.push(Reflected::of(&other.camera_from_pattern));
    }
    all
}

/// The three rising numbers below `count` of a rank in lexicographic order.
fn triple(mut rank: usize, count: usize) -> [usize; 3] {
    let pairs = |of: usize| of * of.saturating_sub(1) / 2;
    let mut i = 0;
    while rank >= pairs(count - i - 1) {
        rank -= pairs(count - i - 1);
        i += 1;
    }
    let mut j = i + 1;
    while rank >= count - j - 1 {
        rank -= count - j - 1;
        j += 1;
    }
    [i, j, j + 1 + rank]
}

/// Candidates from triples of views, every combination of their possible poses.
fn transforms_by_triples(possible: &[Vec<Reflected>]) -> Vec<Isometry3<f64>> {
    let count = possible.len();
    let total = count * count.saturating_sub(1) / 2 * count.saturating_sub(2) / 3;
    let stride = total.div_ceil(MOST_TRIPLES).max(1);
    let mut found = Vec::new();
    for [i, j, k] in (0..total).step_by(stride).map(|rank| triple(rank, count)) {
        for a in &possible[i] {
            for b in &possible[j] {
                for c in &possible[k] {
                    let poses = [*a, *b, *c];
                    found.extend(transform(&poses, &normals_by_orthogonality(&poses)).map(|(pose, _)| pose));
                }
            }
        }
    }
    found
}

/// How well a transform explains all pictures, each with its own best plane: capped mean square, px².
fn judge(camera: &Camera, board: &Board, views: &[&BoardView], candidate: &Isometry3<f64>) -> f64 {
    let rig = Rig::new(camera.clone(), *board, *candidate);
    let cap = JUDGE_CAP_PX * JUDGE_CAP_PX;
    let options = EstimatorOptions::default();
    let sum: f64 = views
        .iter()
        .map(|view| match MirrorEstimator::MaximumLikelihood.estimate(&rig, view, &options) {
            Ok(found) => (found.rms_px * found.rms_px).min(cap),
            Err(_) => cap,
        })
        .sum();
    sum / views.len() as f64
}

/// The transform that explains the views best, among all closed-form candidates.
pub(super) fn closed_form(
    camera: &Camera,
    board: &Board,
    views: &[&BoardView],
    poses: &[&PlanarPose],
) -> Result<Isometry3<f64>> {
    if views.len() < FEWEST_VIEWS {
        return Err(Error::LengthMismatch {
            what: "mirror views (at least)".into(),
            got: views.len(),
            needed: FEWEST_VIEWS,
        });
    }
    let best: Vec<Reflected> = poses.iter().map(|p| Reflected::of(&p.camera_from_pattern)).collect();
    let mut candidates = transforms_by_angle(&best);
    candidates.extend(transform(&best, &normals_by_orthogonality(&best)).map(|(pose, _)| pose));
    candidates.extend(transforms_by_triples(&poses.iter().map(|p| possible(p)).collect::<Vec<_>>()));
    candidates.retain(|c| c.translation.vector.iter().all(|x| x.is_finite()));
    candidates
        .par_iter()
        .map(|candidate| (judge(camera, board, views, candidate), candidate))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .filter(|(score, _)| *score < JUDGE_CAP_PX * JUDGE_CAP_PX)
        .map(|(_, candidate)| *candidate)
        .ok_or(Error::Undetermined { what: "camera-board transform from mirror views" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triples_are_counted_in_lexicographic_order() {
        for count in 3..8 {
            let mut rank = 0;
            for i in 0..count {
                for j in i + 1..count {
                    for k in j + 1..count {
                        assert_eq!(triple(rank, count), [i, j, k]);
                        rank += 1;
                    }
                }
            }
        }
        assert_eq!(triple(2000 * 1999 / 2 * 1998 / 3 - 1, 2000), [1997, 1998, 1999]);
    }
}
