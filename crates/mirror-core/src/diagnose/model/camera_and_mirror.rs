//! The camera and the mirror of a deformation.

use crate::camera::Camera;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::free_values::FreeValues;
use crate::diagnose::model::pose::{self, Pose};
use crate::diagnose::model::problem::Problem;
use crate::error::Result;
use crate::mirror::{Curvature, GlassPane, MirrorOptics};
use nalgebra::{Matrix3, Vector2, Vector3, Vector6};

/// The mirror's foot point in each frame at its best, m.
pub(crate) type FootPoints = Vec<Option<Vector3<f64>>>;

/// The camera and the mirror of a deformation.
#[derive(Debug, Clone)]
pub(crate) struct Eye {
    pub camera: Camera,
    pub mirror: MirrorOptics,
    pub camera_from_mount: Pose,
    /// The right Jacobian `J_r(ω)` of the mount's rotation vector: `∂(Exp(ω)ᵀ p)/∂ω = hat(Exp(ω)ᵀ p) J_r(ω)`.
    pub mount_jacobian: Matrix3<f64>,
    pub nominal_focal: Vector2<f64>,
    nominal_center: Vector2<f64>,
    /// Free-form errors of lens, board and mirror, where there are any.
    pub free: Option<FreeValues>,
}

impl Eye {
    /// 1, and a pixel's distance from the principal point that the session states, in u and in v, px.
    #[inline]
    pub fn in_picture(&self, pixel: &Vector2<f64>) -> Vector3<f64> {
        let from_center = pixel - self.nominal_center;
        Vector3::new(1.0, from_center.x, from_center.y)
    }

    /// The same in one frame of a session in which mount or focal length vary.
    ///
    /// # Errors
    /// As [`Problem::eye`].
    pub fn in_frame(&self, deformation: &Deformation, frame: usize) -> Result<Self> {
        let focal_px = self.nominal_focal * (1.0 + deformation.focal_scale_error_in(frame));
        let camera = self.camera.clone().with_intrinsics(focal_px, self.camera.center_px())?;
        let (camera_from_mount, mount_jacobian) = mounted(&deformation.camera_mount_in(frame));
        Ok(Self { camera, camera_from_mount, mount_jacobian, ..self.clone() })
    }
}

impl Problem {
    /// Camera and mirror of a deformation; none where the session has no camera.
    ///
    /// # Errors
    /// Invalid parameters of the camera or mirror (for example a focal length below zero).
    pub fn eye(&self, deformation: &Deformation) -> Result<Option<Eye>> {
        self.cancel.check()?;
        let Some(nominal) = &self.camera else { return Ok(None) };
        // Where a lens is one-to-one takes long to find, so a lens is made only where it is another one.
        let lens = if deformation.dk1 == 0.0 {
            nominal.clone()
        } else {
            let distortion = nominal.distortion().with_k1_changed(deformation.dk1);
            Camera::new(nominal.size_px(), nominal.focal_px(), nominal.center_px(), distortion)?
        };
        let center_px = nominal.center_px() + deformation.center_px;
        let focal_px = nominal.focal_px() * (1.0 + deformation.focal_scale_error);
        let camera = lens.with_intrinsics(focal_px, center_px)?;
        let thickness = (self.scene.glass_thickness_m + deformation.glass_thickness_m).max(0.0);
        let mirror = MirrorOptics {
            pane: GlassPane::new(thickness, self.refractive_index)?,
            curvature: Curvature::new(deformation.curvature_per_m)?,
        };
        let (camera_from_mount, mount_jacobian) = mounted(&deformation.camera_mount);
        Ok(Some(Eye {
            camera,
            mirror,
            camera_from_mount,
            mount_jacobian,
            nominal_focal: nominal.focal_px(),
            nominal_center: nominal.center_px(),
            free: (deformation.free_optics != FreeValues::zeros()).then_some(deformation.free_optics),
        }))
    }
}

/// Where a camera is whose mount is displaced by (ω, v), and the derivative of ω's turn: real camera = nominal ∘ (Exp ω, v), so `p_real =
/// Exp(ω)ᵀ (p_nominal − v)`.
fn mounted(displacement: &Vector6<f64>) -> (Pose, Matrix3<f64>) {
    let omega = displacement.fixed_rows::<3>(0).into_owned();
    let shift = displacement.fixed_rows::<3>(3).into_owned();
    let mount = Pose { r: pose::exp(&omega), t: shift };
    (mount.inverse(), crate::geometry::rotation::right_jacobian(&omega))
}
