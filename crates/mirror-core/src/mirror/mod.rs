//! The mirror: its forward optics, the board and its pose, the mirror estimators behind one interface, the virtual
//! camera.
//!
//! A mirror is a [`crate::geometry::Plane`] in the camera frame with its normal away from the camera. Its three
//! parameters are the foot point `f = d n` (m); its covariance is 3×3 in m².
//!
//! The estimators: `pose_map` (Eq. 1 of the paper), `point_pair` (Eq. 2), `likelihood` (maximum likelihood).

mod axial;
mod batch;
mod board;
mod corner_fit;
mod curved;
mod estimate;
mod estimators;
mod glass;
mod likelihood;
mod loss;
mod optics;
mod options;
mod planar;
mod planar_start;
mod point_pair;
mod pose_map;
mod rig;
mod sphere;
mod via;
mod virtual_camera;

pub(crate) use axial::AxialDepths;
pub use batch::{estimate_rows, planar_pose_rows, view_from_row};
pub use board::{Board, BoardView, DetectedCorner, FEWEST_CORNERS, SeenCorner};
pub use curved::Curvature;
pub use estimate::{MirrorEstimate, MirrorEstimator};
pub use glass::GlassPane;
pub use loss::Loss;
pub use optics::{ApparentPoint, MirrorOptics, SeenPixel};
pub use options::EstimatorOptions;
pub use planar::{AlternativePose, PlanarPose, planar_pose};
pub(crate) use planar_start::closed_form_poses;
pub use point_pair::{PointPairPlane, point_pair_plane};
pub use rig::Rig;
pub use sphere::{Sphere, SphereProjection};
pub use via::Via;
pub use virtual_camera::{
    ImproperEstimate, RayJacobians, VirtualCamera, VirtualRay, virtual_ray, virtual_ray_with_jacobians,
};
