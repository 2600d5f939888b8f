//! Posture correction: from the measured markers to the next command, until a stated stop reason.
//!
//! Algorithm 1 of Hayashi et al. (2013): `θ ← θ + λ J⁺ (p_ref − p_now)`, J at the reference posture. Here:
//!
//! | file | what |
//! | --- | --- |
//! | `step` | one step as a pure function: damped, whitened, within limits, without allocation |
//! | `damping` | how strongly the pseudo-inverse is damped, and why |
//! | `jacobian` | J of all markers: at the reference posture, at the command, or updated during the correction |
//! | `bounds` | upper bound of a marker's true distance from its target |
//! | `plausible` | whether a reading is plausible after what was commanded |
//! | `response` | how far each joint followed its commands |
//! | `limits` | how far each position may go, followers counted |
//! | `stop` | why a correction ends, with the evidence |
//! | `feed_forward` | the first command, compensated for what a diagnosis found |
//! | `corrector` | the state of one correction: readings in, a decision out |
//!
//! Positions of markers are in the frame of one link, the board's. Neither the mirror's place nor the robot's stand
//! moves it.

mod bounds;
mod cholesky;
mod corrector;
mod damping;
mod feed_forward;
mod jacobian;
mod judge;
mod limits;
mod options;
mod plausible;
mod response;
mod step;
mod stop;
mod target;

pub use bounds::DistanceBounds;
pub use corrector::{Corrector, Decision, LookRecord, MarkerError, Reading};
pub use damping::Damping;
pub use feed_forward::{FeedForward, JointError};
pub use jacobian::{JacobianSource, broyden_update, marker_jacobian};
pub use options::{CorrectOptions, JudgeOptions};
pub use plausible::{Implausible, Surprise};
pub use response::JointResponse;
pub use step::{Step, StepOptions, StepProblem, StepWorkspace, correction_step};
pub use stop::{
    BudgetSpent, Converged, Diverging, Inconsistent, LimitHit, LimitReached, MarkerLost, StallCause, Stalled,
    Stop,
};
pub use target::Target;
