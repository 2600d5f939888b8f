//! Corners of a board that a detector found beside its grid.
//!
//! A board's corners lie on a grid, so that whatever the mirror, the pose of the board and to first order the lens, their residuals r
//! are a homography's eight columns X beside the noise. With `H = X (XᵀX)⁻¹ Xᵀ` and `Hᵢ` the 2×2 block of corner i, leaving it out lowers the
//! sum of squares by `rᵢᵀ (I − Hᵢ)⁻¹ rᵢ`: a chi-squared of two degrees of freedom, times the variance of the noise, if the corner is
//! right. One corner in fifty that is a square's width off would turn the mirror of its frame.

use crate::diagnose::model::frame::FrameWork;
use crate::diagnose::model::problem::{FRAMES_A_CHUNK, FalseCorner, Problem};
use crate::diagnose::principles::{FAR_DEVIATIONS, FEWEST_OBSERVATIONS, NEARLY_ALL};
use crate::error::Result;
use crate::statistics::{CHI_SQUARED_MEDIANS, median};
use nalgebra::{Matrix2, SMatrix, SVector, Vector2};
use rayon::prelude::*;

/// Numbers of a homography.
type Numbers = SVector<f64, 8>;

/// The middle of a board in the picture and its size, px.
pub(crate) fn extent(pixels: impl Iterator<Item = Vector2<f64>> + Clone) -> (Vector2<f64>, f64) {
    let count = pixels.clone().count().max(1) as f64;
    let center = pixels.clone().sum::<Vector2<f64>>() / count;
    (center, pixels.map(|pixel| (pixel - center).norm()).fold(1e-9, f64::max))
}

/// How a picture moves in u and in v with the eight numbers of a homography, at a place whose distance from the board's middle is a
/// part of the board's size.
pub(crate) fn homography_rows(p: Vector2<f64>) -> [Numbers; 2] {
    [
        Numbers::from([1.0, p.x, p.y, 0.0, 0.0, 0.0, p.x * p.x, p.x * p.y]),
        Numbers::from([0.0, 0.0, 0.0, 1.0, p.x, p.y, p.x * p.y, p.y * p.y]),
    ]
}

/// What each of some corners lowers the sum of squares by if it is left out, px²; none where they show no homography.
fn gains(rows: &[[Numbers; 2]], residuals: &[Vector2<f64>], kept: &[usize]) -> Option<Vec<f64>> {
    let mut information = SMatrix::<f64, 8, 8>::zeros();
    let mut gradient = Numbers::zeros();
    for &i in kept {
        let ([u, v], r) = (&rows[i], &residuals[i]);
        information += u * u.transpose() + v * v.transpose();
        gradient += u * r.x + v * r.y;
    }
    let factor = information.cholesky()?;
    let fitted = factor.solve(&gradient);
    let of = |&i: &usize| {
        let ([u, v], r) = (&rows[i], &residuals[i]);
        let (by_u, by_v) = (factor.solve(u), factor.solve(v));
        let hat = Matrix2::new(u.dot(&by_u), u.dot(&by_v), v.dot(&by_u), v.dot(&by_v));
        let left = r - Vector2::new(u.dot(&fitted), v.dot(&fitted));
        // A corner that the homography needs shows nothing of itself.
        (Matrix2::identity() - hat).cholesky().map_or(0.0, |own| left.dot(&own.solve(&left)))
    };
    Some(kept.iter().map(of).collect())
}

/// Which corners of a board lie beside the grid of the others, one after the other, with their deviations: of the noise, or of the
/// others' scatter where that is more. None where it would be more than a few: then it is another grid.
///
/// `seen`: where each was seen, and its residual at the board's own mirror, px.
fn beside_their_grid(seen: &[(Vector2<f64>, Vector2<f64>)], noise_px: f64) -> Vec<(usize, f64)> {
    let least = ((NEARLY_ALL * seen.len() as f64).ceil() as usize).max(FEWEST_OBSERVATIONS);
    let predicted = seen.iter().map(|(pixel, residual)| pixel - residual);
    let (center, size) = extent(predicted.clone());
    let rows: Vec<_> = predicted.map(|at| homography_rows((at - center) / size)).collect();
    let residuals: Vec<_> = seen.iter().map(|s| s.1).collect();
    let mut kept: Vec<usize> = (0..seen.len()).collect();
    let mut out = Vec::new();
    let Some(mut with) = gains(&rows, &residuals, &kept) else { return out };
    loop {
        let Some((place, &gain)) = with.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)) else {
            return out;
        };
        if gain <= (FAR_DEVIATIONS * noise_px).powi(2) {
            return out;
        }
        if kept.len() <= least {
            return Vec::new();
        }
        let which = kept.remove(place);
        // The scatter is the others': one that is false is in all residuals.
        let Some(without) = gains(&rows, &residuals, &kept) else { return out };
        let scatter = median(without.clone()) / CHI_SQUARED_MEDIANS[1];
        let deviations = (gain / scatter.max(noise_px.powi(2))).sqrt();
        if deviations <= FAR_DEVIATIONS {
            return out;
        }
        out.push((which, deviations));
        with = without;
    }
}

impl Problem {
    /// Leaves out the corners that lie beside the grid of the others, and fits the mirrors of these frames again.
    ///
    /// # Errors
    /// Invalid parameters of the camera or mirror.
    pub(super) fn leave_out_false_corners(&mut self) -> Result<()> {
        let nominal = self.nominal();
        let Some(eye) = self.eye(&nominal)? else { return Ok(()) };
        let of_frame = |work: &mut FrameWork, frame: usize| {
            let seen = work.board_residuals(self, &nominal, &eye, frame);
            // In step with the corners only where each is predicted.
            let all = seen.len() == self.frames[frame].corners.len();
            if all { beside_their_grid(&seen, self.noise.corner_px) } else { Vec::new() }
        };
        let found: Vec<Vec<(usize, f64)>> = (0..self.frames.len())
            .into_par_iter()
            .with_min_len(FRAMES_A_CHUNK)
            .map_init(|| FrameWork::new(self), of_frame)
            .collect();
        if found.iter().all(Vec::is_empty) {
            return Ok(());
        }
        for (frame, out) in found.iter().enumerate().filter(|(_, out)| !out.is_empty()) {
            let corners = &mut self.frames[frame].corners;
            let of = |&(place, deviations): &(usize, f64)| FalseCorner {
                frame,
                index: corners[place].0,
                deviations,
            };
            let told: Vec<FalseCorner> = out.iter().map(of).collect();
            corners.retain(|(index, _)| told.iter().all(|corner| corner.index != *index));
            self.false_corners.extend(told);
            // Where it was is no start.
            self.boards[frame] = None;
        }
        self.fit_boards()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// A grid of corners, their residuals a homography's and noise.
    fn board(noise_px: f64) -> Vec<(Vector2<f64>, Vector2<f64>)> {
        let mut random = Random::new(5);
        (0..24)
            .map(|i| {
                let at = Vector2::new(300.0 + 20.0 * f64::from(i % 6), 200.0 + 22.0 * f64::from(i / 6));
                let p = (at - Vector2::new(350.0, 233.0)) / 60.0;
                let of_homography = Vector2::new(0.4 + p.x * (0.5 + 0.3 * p.x), p.y * (0.3 * p.x - 0.2));
                let noise = Vector2::new(random.normal(), random.normal()) * noise_px;
                (at + of_homography + noise, of_homography + noise)
            })
            .collect()
    }

    fn displaced(places: &[usize], by: Vector2<f64>) -> Vec<usize> {
        let mut seen = board(0.2);
        for &place in places {
            seen[place].0 += by;
            seen[place].1 += by;
        }
        let mut found: Vec<usize> = beside_their_grid(&seen, 0.2).iter().map(|out| out.0).collect();
        found.sort_unstable();
        found
    }

    #[test]
    fn corners_beside_their_grid_are_found_and_no_others() {
        let by = Vector2::new(9.0, -12.0);
        assert_eq!(displaced(&[], by), Vec::<usize>::new());
        // Of the grid's corner a homography takes most.
        assert_eq!(displaced(&[0], by), vec![0]);
        assert_eq!(displaced(&[9], by), vec![9]);
        assert_eq!(displaced(&[3, 17], by), vec![3, 17]);
        assert_eq!(displaced(&[9], by * 20.0), vec![9]);
    }

    #[test]
    fn another_grid_keeps_its_corners_and_so_does_a_board_in_larger_noise() {
        let all: Vec<usize> = (0..24).step_by(2).collect();
        assert_eq!(displaced(&all, Vector2::new(9.0, -12.0)), Vec::<usize>::new());
        assert!(beside_their_grid(&board(3.0), 0.2).is_empty());
    }
}
