//! Robots: URDF to a validated tree; forward kinematics, Jacobians, gravity torques.
//!
//! A [`Robot`] is immutable. A [`Poses`] is the workspace with the links' poses at one posture; it is reused from
//! posture to posture without allocation. Batches compute several postures in a vector, on all cores.
//!
//! Frames are the URDF's: `root_from_link`, `parent_from_joint`. Units: m, rad, kg, N m.

mod batch;
mod chain;
mod fault;
mod frame;
mod gravity;
mod jacobian;
mod joint;
mod joint_law;
mod lanes;
mod model;
mod poses;
mod sine;
mod step;
mod tidy;
mod tree;
mod upright;
mod urdf;

pub use chain::{Chain, ChainStep, Direction};
pub use fault::ModelFault;
pub use gravity::{GravityLoad, GravityLoads};
pub use jacobian::{JointTwist, TwistJacobian};
pub use joint::{Drive, Joint, JointKind, Limits, Mimic};
pub use joint_law::JointTerm;
pub use model::{Link, Robot};
pub use poses::Poses;
pub use upright::JointErrors;
