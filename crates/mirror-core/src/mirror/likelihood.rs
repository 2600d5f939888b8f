//! The maximum-likelihood mirror of one view: three parameters, all corners.

use super::board::{BoardView, SeenCorner};
use super::corner_fit::{CornerModel, Predicted, fit};
use super::estimate::{Found, MirrorEstimate, MirrorEstimator, Rig, before_both};
use super::optics::MirrorOptics;
use super::options::EstimatorOptions;
use super::planar_start::closed_form_poses;
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::geometry::Plane;
use nalgebra::{Matrix3, Point3, SMatrix, Vector3};

struct PlaneModel<'a> {
    camera: &'a Camera,
    optics: &'a MirrorOptics,
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
        let seen = self.optics.apparent_point_in_loop(plane, &self.point_in_camera(corner))?;
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
        axes: [rotation.column(0).into_owned(), rotation.column(1).into_owned()],
        origin: Point3::from(rig.camera_from_board.translation.vector),
    };
    // Both closed-form poses have the same depth of the board's centroid; either starts well.
    let [start, _] = closed_form_poses(&rig.camera, corners)?;
    let between = Plane::between(&model.origin, &Point3::from(start.translation.vector))?;
    let start = before_both(between, rig)?;
    let fitted = fit(&model, corners, start, options)?;
    let plane = before_both(fitted.state, rig)?;

    let mut information = Matrix3::zeros();
    let mut mixed = SMatrix::<f64, 3, 6>::zeros();
    for corner in corners {
        let seen = rig.optics.apparent_point_in_loop(&plane, &model.point_in_camera(corner))?;
        let (_, by_apparent) = rig.camera.project_with_point_jacobian(&seen.point)?;
        let by_foot = by_apparent * seen.by_foot_point;
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
    let factor = information.cholesky().ok_or(Error::Undetermined { what: "mirror plane" })?;
    let found = Found {
        plane,
        measurement_covariance_m2: fitted.covariance,
        foot_by_camera_from_board: -factor.solve(&mixed),
        optics: rig.optics,
        rms_px: fitted.rms_px,
        noise_px: fitted.noise_px,
    };
    Ok(found.into_estimate(MirrorEstimator::MaximumLikelihood, rig))
}
