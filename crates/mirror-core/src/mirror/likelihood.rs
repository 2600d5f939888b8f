//! The maximum-likelihood mirror of one view: three parameters, all corners.

use super::board::{BoardView, SeenCorner};
use super::corner_fit::{CornerModel, Predicted, effective_variance, fit_state};
use super::estimate::{Found, MirrorEstimate, MirrorEstimator, before_both};
use super::optics::MirrorOptics;
use super::options::EstimatorOptions;
use super::planar_start::closed_form_poses;
use super::rig::Rig;
use crate::camera::Camera;
use crate::error::Result;
use crate::geometry::Plane;
use crate::least_squares::inverse_information;
use nalgebra::{Matrix3, Point3, SMatrix, Vector3};

struct PlaneModel<'a> {
    camera: &'a Camera,
    optics: &'a MirrorOptics,
    ideal: bool,
    /// First two columns of the board's rotation, and its origin.
    axes: [Vector3<f64>; 2],
    origin: Point3<f64>,
}

impl PlaneModel<'_> {
    #[inline]
    fn point_in_camera(&self, corner: &SeenCorner) -> Point3<f64> {
        self.origin + self.axes[0] * corner.point_in_board.x + self.axes[1] * corner.point_in_board.y
    }
}

impl CornerModel<3> for PlaneModel<'_> {
    type State = Plane;
    const WHAT: &'static str = "mirror plane";

    #[inline]
    fn predict(&self, plane: &Self::State, corner: &SeenCorner) -> Result<Predicted<3>> {
        let point = self.point_in_camera(corner);
        if self.ideal {
            // The chain of the general case multiplied out, two vectors instead of two 3×3 matrices: with
            // h = n·x and l = x − h n, `∂pixel/∂f = 2 (P n)(n − l/d)ᵀ + 2 (d − h)/d (P − (P n) nᵀ)`.
            let (n, d) = (plane.normal().into_inner(), plane.offset_m());
            let height = n.dot(&point.coords);
            let before = 2.0 * (d - height);
            let (pixel, p) = self.camera.project_with_point_jacobian(&(point + n * before))?;
            let along = p * n;
            let share = before / d;
            let row = n * (2.0 - share) - (point.coords - n * height) * (2.0 / d);
            return Ok(Predicted { pixel, jacobian: p * share + along * row.transpose() });
        }
        let seen = self.optics.apparent_point_in_loop(plane, &point)?;
        let (pixel, by_apparent) = self.camera.project_with_point_jacobian(&seen.point)?;
        Ok(Predicted { pixel, jacobian: by_apparent * seen.by_foot_point })
    }

    #[inline]
    fn moved(&self, plane: &Self::State, step: &Vector3<f64>) -> Result<Self::State> {
        Plane::from_foot_point(&(plane.foot_point() + step))
    }
}

/// The foot point that minimises the reprojection error of all reflected corners, the camera–board transform given.
///
/// The mirror may have known glass and curvature ([`Rig::optics`]); the plane is then the glass's front face.
/// Start: Eq. 2 on the translation of the closed-form pose. Covariance: `σ² (Σ JᵀJ)⁻¹`; the effect of the
/// camera–board transform by the implicit function theorem, `∂f/∂δ = −(Σ JᵀJ)⁻¹ Σ Jᵀ ∂pixel/∂δ`.
///
/// # Errors
/// As [`MirrorEstimator::estimate`].
pub(crate) fn estimate(rig: &Rig, view: &BoardView, options: &EstimatorOptions) -> Result<MirrorEstimate> {
    let corners = view.corners();
    let rotation = rig.camera_from_board.rotation.to_rotation_matrix().into_inner();
    let model = PlaneModel {
        camera: &rig.camera,
        optics: &rig.optics,
        ideal: rig.optics.is_ideal(),
        axes: [rotation.column(0).into_owned(), rotation.column(1).into_owned()],
        origin: Point3::from(rig.camera_from_board.translation.vector),
    };
    // Both closed-form poses have the same depth of the board's centroid; either starts well.
    let [start, _] = closed_form_poses(&rig.camera, corners)?;
    let between = Plane::between(&model.origin, &Point3::from(start.translation.vector))?;
    let start = before_both(between, rig)?;
    let (plane, noise_px) = fit_state(&model, corners, start, options)?;
    let plane = before_both(plane, rig)?;

    let mut squares = 0.0;
    let mut information = Matrix3::zeros();
    let mut mixed = SMatrix::<f64, 3, 6>::zeros();
    for corner in corners {
        let seen = rig.optics.apparent_point_in_loop(&plane, &model.point_in_camera(corner))?;
        let (pixel, by_apparent) = rig.camera.project_with_point_jacobian(&seen.point)?;
        let by_foot = by_apparent * seen.by_foot_point;
        squares += (pixel - corner.pixel).norm_squared();
        let (x, y) = (corner.point_in_board.x, corner.point_in_board.y);
        // As in the planar pose: p = R (Exp(ω) x + v) + t.
        let q = by_apparent * seen.by_point * rotation;
        let mut by_tangent = SMatrix::<f64, 2, 6>::zeros();
        by_tangent.set_column(0, &(q.column(2) * y));
        by_tangent.set_column(1, &(q.column(2) * -x));
        by_tangent.set_column(2, &(q.column(1) * x - q.column(0) * y));
        by_tangent.fixed_columns_mut::<3>(3).copy_from(&q);
        information += by_foot.transpose() * by_foot;
        mixed += by_foot.transpose() * by_tangent;
    }
    let inverse = inverse_information("mirror plane", &information)?;
    let variance = effective_variance(&model, corners, &plane, options, noise_px)?;
    let found = Found {
        plane,
        measurement_covariance_m2: inverse * variance,
        foot_by_camera_from_board: -(inverse * mixed),
        optics: rig.optics,
        rms_px: (squares / corners.len() as f64).sqrt(),
        noise_px,
    };
    Ok(found.into_estimate(MirrorEstimator::MaximumLikelihood, rig))
}
