//! A log of joint positions over time, beside pictures that have a clock of their own.
//!
//! | file | what it is |
//! | --- | --- |
//! | `log` | [`JointLog`]: times and positions, validated; positions at any time |
//! | `rest` | [`rests`]: the moments in which no joint moves |
//! | `clock` | [`match_clocks`]: the offset between the joints' clock and the pictures' |
//!
//! A recording of a moving robot becomes a session of postures by these: of each [`Rest`] one picture is taken, at
//! picture time = joint time + [`ClockMatch::offset_s`]. The order in which joints are given does not matter; rad and m
//! may be mixed.

mod clock;
mod log;
mod rest;

pub use clock::{ClockMatch, match_clocks};
pub use log::JointLog;
pub use rest::{Rest, rests};
