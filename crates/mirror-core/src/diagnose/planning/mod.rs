//! The design of a session before it is recorded: which postures show most, and what they will show.
//!
//! In: a robot's model and a [`Recording`] of postures that could be taken, with the pixels that the model predicts.
//! Out: the most informative ones ([`PlannedSession::choose`]); the smallest size of each effect at each place that
//! will be found, and from which size on two causes are separated ([`PlannedSession::foresee`]). All of it comes from
//! the columns, priors and criteria of the diagnosis itself: what is planned for is what will be searched for.

mod choice;
mod expected;
mod foreseen;
mod twins;

pub use choice::Pool;
pub use expected::PlannedSession;
pub use foreseen::{Foreseen, Twin};
