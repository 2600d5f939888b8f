//! Posture correction: from where the markers are to what the joints are told next, until a stated reason to stop.
//!
//! Algorithm 1 of Hayashi et al. (2013): `θ ← θ + λ J⁺ (p_ref − p_now)`, J at the reference posture. Here:
//!
//! | file | what |
//! | --- | --- |
//! | `step` | one step as a pure function: damped, whitened, within limits, nothing allocated |
//! | `damping` | how strongly the pseudo-inverse is damped, and why |
//! | `jacobian` | J of all markers: at the reference posture, at the command, or learnt while correcting |
//! | `bounds` | how far off a marker may really be, given what was measured |
//! | `plausible` | whether a reading can be believed after what was commanded |
//! | `response` | how far each joint did what it was told |
//! | `stop` | why a correction ends, with the evidence |
//! | `feed_forward` | the first command, shifted against what a diagnosis found |
//! | `corrector` | the state of one correction: readings in, a decision out |
//!
//! Positions of markers are in the frame of one link, the board's, which neither the mirror's place nor the robot's stand moves.

mod bounds;
mod cholesky;
mod corrector;
mod damping;
mod feed_forward;
mod jacobian;
mod judge;
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
