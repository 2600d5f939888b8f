//! The maximum-likelihood estimate of a session, its iteration and its results.

use super::elimination::{FrameTerms, PointTerms, SharedTerms, Solution, Step, solve};
use super::problem::{JointFrame, JointOptions, Layout, PointStatus, spheres};
use super::start::{Start, start};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::geometry::Plane;
use crate::geometry::rotation::{difference, hat, log, right_jacobian_inverse};
use crate::least_squares::{Damping, LeastSquares, Minimum, Stop, minimise};
use crate::mirror::Via;
use crate::mirror::{Board, Sphere};
use nalgebra::{
    Isometry3, Matrix2x3, Matrix3, Matrix6, Point3, SMatrix, Translation3, UnitQuaternion, Vector2, Vector3,
};
use rayon::prelude::*;

const WHAT: &str = "joint estimate";
/// Steps of the planes alone after a failed step of everything.
const FOLLOWING_STEPS: usize = 3;
/// One marker in one posture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointPoint {
    /// The posture's number.
    pub posture: i64,
    /// Which marker.
    pub marker: usize,
    /// Measured, or why not: then position and covariance are `None`.
    pub status: PointStatus,
    /// In the camera frame, m.
    pub point_in_camera: Option<Point3<f64>>,
    /// 3×3, m²: of everything, the camera–board transform's uncertainty included.
    pub covariance_m2: Option<Matrix3<f64>>,
}

/// The result of the joint estimate, with covariances.
#[derive(Debug, Clone, PartialEq)]
pub struct JointEstimate {
    /// The correction of the camera–board transform: `camera_from_board = camera_from_nominal_camera ∘ nominal`,
    /// the same in all frames (the camera is displaced on the head).
    pub camera_from_nominal_camera: Isometry3<f64>,
    /// The corrected transform, by frame.
    pub camera_from_board: Vec<Isometry3<f64>>,
    /// Its covariance at the first frame, 6×6 in the tangent of [`crate::geometry::rotation::moved`] (rotation rad, translation m); zero where it was given as exact.
    pub camera_from_board_covariance: Matrix6<f64>,
    /// The mirror in the camera frame, by frame (its front face, where it has glass).
    pub planes: Vec<Plane>,
    /// 3×3 of the planes' foot points, m².
    pub plane_covariances_m2: Vec<Matrix3<f64>>,
    /// The markers, by posture, then marker: all that any frame sees.
    pub points: Vec<JointPoint>,
    /// Root mean square length of the corners' residuals, px, by frame.
    pub corner_rms_px: Vec<f64>,
    /// The same of all markers that were used; 0 where there are none.
    pub marker_rms_px: f64,
    /// Sum of the weighted squared residuals over their variances, the prior included.
    pub chi_squared: f64,
    /// How many of them are free: what χ² should be.
    pub degrees_of_freedom: usize,
    /// Steps taken.
    pub steps: usize,
}

/// The unknowns.
#[derive(Clone)]
pub(super) struct State {
    /// `camera_from_nominal_camera`.
    correction: Isometry3<f64>,
    planes: Vec<Plane>,
    /// By posture and slot.
    points: Vec<Vec<Point3<f64>>>,
}

/// What the iteration needs in addition to the state.
struct Problem<'a> {
    camera: &'a Camera,
    spheres: &'a [Sphere],
    frames: &'a [JointFrame],
    options: &'a JointOptions,
    frames_of: &'a [Vec<usize>],
    posture_of_frame: Vec<usize>,
    /// How many points each posture has.
    points_of: Vec<usize>,
    /// (slot, sphere, pixel, via) of the sightings that count, by frame.
    sightings: Vec<Vec<Sighting>>,
    information: Option<Matrix6<f64>>,
}

#[derive(Clone, Copy)]
struct Sighting {
    slot: usize,
    marker: usize,
    pixel: Vector2<f64>,
    via: Via,
}

/// The result of the iteration, before it is put in order.
pub(crate) struct Adjusted {
    pub correction: Isometry3<f64>,
    pub planes: Vec<Plane>,
    pub plane_covariances_m2: Vec<Matrix3<f64>>,
    /// Of the correction in the tangent `p ↦ Exp(ω) p + v`.
    pub correction_covariance: Matrix6<f64>,
    points: Vec<Vec<(Point3<f64>, Matrix3<f64>)>>,
    pub corner_px2: Vec<f64>,
    marker_px2: f64,
    sighting_count: usize,
    pub chi_squared: f64,
    pub degrees_of_freedom: usize,
    pub steps: usize,
}

impl Problem<'_> {
    /// Terms of one frame at a state, `Σ w Jᵀ J` and `Σ w Jᵀ e`, in units of variance.
    fn frame_terms(&self, index: usize, state: &State, terms: &mut FrameTerms) -> Result<()> {
        self.options.cancel.check()?;
        terms.clear();
        let frame = &self.frames[index];
        let plane = &state.planes[index];
        let camera_from_board = state.correction * frame.nominal_camera_from_board;
        let noise = self.options.corner_std_px;
        let per_variance = 1.0 / (noise * noise);
        for corner in frame.corners.corners() {
            let at = Point3::new(corner.point_in_board.x, corner.point_in_board.y, 0.0);
            let point = camera_from_board * at;
            let seen = self.options.optics.apparent_point_in_loop(plane, &point)?;
            let (pixel, by) = self.camera.project_with_point_jacobian(&seen.point)?;
            let residual = pixel - corner.pixel;
            let squared = residual.norm_squared();
            let weighed = self.options.loss.weigh(squared, noise);
            terms.corner_px2 += squared;
            terms.cost += weighed.cost * per_variance;
            let weight = weighed.weight * per_variance;
            let by_plane = by * seen.by_foot_point;
            let by_shared = by_rigid(&(by * seen.by_point), &point.coords);
            let weighted_plane = by_plane.transpose() * weight;
            terms.plane += weighted_plane * by_plane;
            terms.plane_by_shared += weighted_plane * by_shared;
            terms.shared += by_shared.transpose() * by_shared * weight;
            terms.plane_gradient += weighted_plane * residual;
            terms.shared_gradient += by_shared.transpose() * residual * weight;
        }
        let noise = self.options.marker_std_px;
        let per_variance = 1.0 / (noise * noise);
        let posture = self.posture_of_frame[index];
        for sight in &self.sightings[index] {
            let point = state.points[posture][sight.slot];
            let sphere = &self.spheres[sight.marker];
            let (centroid, by_point, by_plane) = match sight.via {
                Via::Direct => {
                    let seen = sphere.project_with_jacobian(self.camera, &point)?;
                    (seen.centroid_px, seen.by_center, Matrix2x3::zeros())
                }
                Via::Mirror => {
                    let apparent = self.options.optics.apparent_point_in_loop(plane, &point)?;
                    let seen = sphere.project_with_jacobian(self.camera, &apparent.point)?;
                    (
                        seen.centroid_px,
                        seen.by_center * apparent.by_point,
                        seen.by_center * apparent.by_foot_point,
                    )
                }
            };
            let residual = centroid - sight.pixel;
            let squared = residual.norm_squared();
            let weighed = self.options.loss.weigh(squared, noise);
            terms.marker_px2 += squared;
            terms.cost += weighed.cost * per_variance;
            let weight = weighed.weight * per_variance;
            let weighted_plane = by_plane.transpose() * weight;
            let weighted_point = by_point.transpose() * weight;
            terms.plane += weighted_plane * by_plane;
            terms.plane_gradient += weighted_plane * residual;
            terms.points.push(PointTerms {
                slot: sight.slot,
                plane_by_point: weighted_plane * by_point,
                point: weighted_point * by_point,
                gradient: weighted_point * residual,
            });
        }
        Ok(())
    }

    /// The prior's cost and terms: residual `difference(camera_from_board, nominal)` at the first frame.
    fn prior(&self, state: &State) -> Option<(f64, SharedTerms)> {
        let information = self.information?;
        let nominal = &self.frames.first()?.nominal_camera_from_board;
        let current = state.correction * nominal;
        let residual = difference(&current, nominal);
        // moved(current, e) changes the residual by (J_r⁻¹(φ) e_ω, R_nᵀ R_c e_v); e is the camera-side step taken to the board's side.
        let step = nominal.rotation.inverse() * current.rotation;
        let mut by_board_side = Matrix6::zeros();
        by_board_side.fixed_view_mut::<3, 3>(0, 0).copy_from(&right_jacobian_inverse(&log(&step)));
        by_board_side.fixed_view_mut::<3, 3>(3, 3).copy_from(step.to_rotation_matrix().matrix());
        let jacobian = by_board_side * board_side_from_camera_side(&current);
        let gradient = jacobian.transpose() * information * residual;
        Some((
            residual.dot(&(information * residual)),
            SharedTerms { information: jacobian.transpose() * information * jacobian, gradient },
        ))
    }

    fn solve(&self, terms: &[FrameTerms], prior: Option<&SharedTerms>, damping: f64) -> Option<Solution> {
        solve(terms, self.frames_of, &self.points_of, prior, damping)
    }
}

impl LeastSquares for Problem<'_> {
    type State = State;
    type Equations = Vec<FrameTerms>;
    type Step = Step;
    const WHAT: &'static str = WHAT;
    /// The start value is low because the direction that needs damping is weak: by yaw alone the transform is known
    /// a thousand times worse along one direction than along the others, its share of the diagonal is 1e-6, and the
    /// valley along it is curved.
    const DAMPING: Damping = Damping { least: 0.0, first: 1e-8, rise: 10.0, fall: 4.0 };
    /// The covariances are of the equations at the estimate.
    const LAST_STEP_UNSEEN: bool = false;

    /// All terms, both cores; the cost with the prior's share.
    fn evaluate(&self, state: &State, terms: &mut Vec<FrameTerms>) -> Result<f64> {
        terms.par_iter_mut().enumerate().try_for_each(|(i, t)| self.frame_terms(i, state, t))?;
        let prior = self.prior(state).map_or(0.0, |(cost, _)| cost);
        Ok(terms.iter().map(|t| t.cost).sum::<f64>() + prior)
    }

    fn step(&self, state: &State, terms: &Vec<FrameTerms>, damping: f64) -> Result<Option<(Step, f64)>> {
        // A step that failed since it was cancelled ends here.
        self.options.cancel.check()?;
        let prior = self.prior(state).map(|(_, terms)| terms);
        let solution = self.solve(terms, prior.as_ref(), damping);
        Ok(solution.map(|s| s.step(terms, self.frames_of, prior.as_ref())))
    }

    fn moved(&self, state: &State, step: &Step) -> Result<State> {
        let omega = step.shared.fixed_rows::<3>(0).into_owned();
        let shift = step.shared.fixed_rows::<3>(3).into_owned();
        let delta = Isometry3::from_parts(Translation3::from(shift), UnitQuaternion::from_scaled_axis(omega));
        let mut correction = delta * state.correction;
        correction.rotation.renormalize();
        let planes = state
            .planes
            .iter()
            .zip(&step.planes)
            .map(|(plane, df)| Plane::from_foot_point(&(plane.foot_point() + df)))
            .collect::<Result<_>>()?;
        let points = state
            .points
            .iter()
            .zip(&step.points)
            .map(|(at, by)| at.iter().zip(by).map(|(p, d)| p + d).collect())
            .collect();
        Ok(State { correction, planes, points })
    }

    /// The planes follow the transform and the points non-linearly.
    ///
    /// By yaw alone, the valley of the cost along the weak direction is curved: a long step of the transform is
    /// right only if each plane turns along with it. The planes are one 3×3 problem each, so this is cheap.
    fn mended(
        &self,
        mut next: State,
        mut lower: f64,
        cost: f64,
        trial: &mut Vec<FrameTerms>,
    ) -> Result<(State, f64)> {
        for _ in 0..FOLLOWING_STEPS {
            for (plane, terms) in next.planes.iter_mut().zip(trial.iter()) {
                let factor = terms.plane.cholesky().ok_or(Error::Undetermined { what: WHAT })?;
                *plane = Plane::from_foot_point(&(plane.foot_point() - factor.solve(&terms.plane_gradient)))?;
            }
            lower = self.evaluate(&next, trial)?;
            if lower <= cost {
                break;
            }
        }
        Ok((next, lower))
    }
}

/// `∂pixel/∂(ω, v)` of a point moved as `p ↦ Exp(ω) p + v`: `B [−p̂ | I]`.
#[inline]
fn by_rigid(by_point: &Matrix2x3<f64>, point: &Vector3<f64>) -> SMatrix<f64, 2, 6> {
    let mut by = SMatrix::<f64, 2, 6>::zeros();
    by.fixed_columns_mut::<3>(0).copy_from(&(-by_point * hat(point)));
    by.fixed_columns_mut::<3>(3).copy_from(by_point);
    by
}

/// From a step on the camera's side (`p ↦ Exp(ω) p + v` after the transform) to the same step in the tangent of `moved`,
/// before it: `ω′ = Rᵀ ω`, `v′ = Rᵀ (ω × t + v)`.
pub(crate) fn board_side_from_camera_side(camera_from_board: &Isometry3<f64>) -> Matrix6<f64> {
    let back = camera_from_board.rotation.inverse().to_rotation_matrix().into_inner();
    let mut by = Matrix6::zeros();
    by.fixed_view_mut::<3, 3>(0, 0).copy_from(&back);
    by.fixed_view_mut::<3, 3>(3, 0).copy_from(&(-back * hat(&camera_from_board.translation.vector)));
    by.fixed_view_mut::<3, 3>(3, 3).copy_from(&back);
    by
}

/// Runs the iteration from a given start. Points whose status is not `Measured` are not used.
pub(crate) fn adjust(
    camera: &Camera,
    spheres: &[Sphere],
    frames: &[JointFrame],
    layout_frames_of: &[Vec<usize>],
    start: Start,
    options: &JointOptions,
) -> Result<Adjusted> {
    let mut posture_of_frame = vec![0; frames.len()];
    for (posture, members) in layout_frames_of.iter().enumerate() {
        for &member in members {
            posture_of_frame[member] = posture;
        }
    }
    let mut sightings = vec![Vec::new(); frames.len()];
    let mut points = vec![Vec::new(); layout_frames_of.len()];
    let mut sighting_count = 0;
    for point in start.points {
        let slot = points[point.posture].len();
        points[point.posture].push(point.at);
        for view in point.views {
            sighting_count += 1;
            sightings[view.frame].push(Sighting {
                slot,
                marker: point.marker,
                pixel: view.pixel,
                via: view.via,
            });
        }
    }
    let information = options.prior.information()?;
    let problem = Problem {
        camera,
        spheres,
        frames,
        options,
        frames_of: layout_frames_of,
        posture_of_frame,
        points_of: points.iter().map(Vec::len).collect(),
        sightings,
        information,
    };
    let point_count: usize = problem.points_of.iter().sum();
    let corner_count: usize = frames.iter().map(|f| f.corners.corners().len()).sum();
    // The prior adds as many measurements as it has unknowns; without it they cost six degrees of freedom.
    let shared_cost = if matches!(options.prior, super::BoardPrior::Unknown) { 6 } else { 0 };
    let unknowns = 3 * (frames.len() + point_count) + shared_cost;
    let measurements = 2 * (corner_count + sighting_count);
    if measurements < unknowns {
        return Err(Error::Undetermined { what: WHAT });
    }
    let begin = State { correction: start.correction, planes: start.planes, points };
    let stop = Stop { steps: options.most_steps, decrease: options.least_decrease, share: 0.0 };
    let places = std::array::from_fn(|_| vec![FrameTerms::zero(); frames.len()]);
    let Minimum { state, equations: terms, cost: chi_squared, steps, .. } =
        minimise(&problem, begin, places, stop)?;
    let prior = problem.prior(&state).map(|(_, terms)| terms);
    let solution = problem.solve(&terms, prior.as_ref(), 0.0).ok_or(Error::Undetermined { what: WHAT })?;
    let (plane_covariances_m2, point_covariances) = solution.covariances(&terms, layout_frames_of);
    let points = state
        .points
        .into_iter()
        .zip(point_covariances)
        .map(|(at, covariances)| at.into_iter().zip(covariances).collect())
        .collect();
    Ok(Adjusted {
        correction: state.correction,
        planes: state.planes,
        plane_covariances_m2,
        correction_covariance: solution.shared_inverse,
        points,
        corner_px2: terms.iter().map(|t| t.corner_px2).collect(),
        marker_px2: terms.iter().map(|t| t.marker_px2).sum(),
        sighting_count,
        chi_squared,
        degrees_of_freedom: measurements - unknowns,
        steps,
    })
}

/// Estimates mirrors, camera–board transform and markers of all views at once.
///
/// Minimises `Σ ρ(|pixel − observed|/σ) + rᵀ Σ₀⁻¹ r` over each frame's plane, each posture's markers and the transform's
/// correction; r is its deviation from the nominal one in the pose tangent, Σ₀ its prior. Corners and balls are projected through
/// [`crate::mirror::MirrorOptics`] (glass, curvature) and [`Sphere`] (the ellipse's centre). Start: the single-view maximum-likelihood
/// planes and the nearest point of the virtual rays. Covariance: the inverse of `Σ w JᵀJ / σ²` by the same elimination.
///
/// `marker_diameters_m` has one entry for each marker, 0 for an ideal point.
///
/// # Errors
/// [`Error::HeadMoved`] where the camera moved against the board between the views of one posture; [`Error::Undetermined`] where the views
/// cannot show the transform and no prior does; [`Error::NotConverged`]; and all of the single-view estimator, of the frame that it fails for.
pub fn joint_estimate(
    camera: &Camera,
    board: &Board,
    marker_diameters_m: &[f64],
    frames: &[JointFrame],
    options: &JointOptions,
) -> Result<JointEstimate> {
    options.validated()?;
    let spheres = spheres(marker_diameters_m)?;
    let layout = Layout::new(frames, spheres.len())?;
    let mut points: Vec<JointPoint> = layout
        .points
        .iter()
        .map(|p| JointPoint {
            posture: layout.postures[p.posture],
            marker: p.marker,
            status: PointStatus::Measured,
            point_in_camera: None,
            covariance_m2: None,
        })
        .collect();
    let frames_of = layout.frames_of.clone();
    let (begin, statuses) = start(camera, board, frames, layout, options)?;
    for (point, status) in points.iter_mut().zip(statuses) {
        point.status = status;
    }
    let adjusted = adjust(camera, &spheres, frames, &frames_of, begin, options)?;

    let measured = points.iter_mut().filter(|p| p.status == PointStatus::Measured);
    for (point, (at, covariance)) in measured.zip(adjusted.points.iter().flatten()) {
        point.point_in_camera = Some(*at);
        point.covariance_m2 = Some(*covariance);
    }
    let camera_from_board: Vec<Isometry3<f64>> =
        frames.iter().map(|f| adjusted.correction * f.nominal_camera_from_board).collect();
    let by = camera_from_board.first().map_or_else(Matrix6::zeros, board_side_from_camera_side);
    Ok(JointEstimate {
        camera_from_nominal_camera: adjusted.correction,
        camera_from_board_covariance: by * adjusted.correction_covariance * by.transpose(),
        camera_from_board,
        planes: adjusted.planes,
        plane_covariances_m2: adjusted.plane_covariances_m2,
        points,
        corner_rms_px: adjusted
            .corner_px2
            .iter()
            .zip(frames)
            .map(|(sum, frame)| (sum / frame.corners.corners().len() as f64).sqrt())
            .collect(),
        marker_rms_px: (adjusted.marker_px2 / adjusted.sighting_count.max(1) as f64).sqrt(),
        chi_squared: adjusted.chi_squared,
        degrees_of_freedom: adjusted.degrees_of_freedom,
        steps: adjusted.steps,
    })
}
