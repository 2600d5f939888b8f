//! The deviation of a real joint from its command, as a sum of terms.
//!
//! `θ = q + a + e q + s sin q + c (cos q − 1) + k τ(θ) + Σ κ_K q_K + r t ± w/2 ± d`
//!
//! Each effect at a joint names the terms of its parameters. The feed-forward inverts them, and a simulator's joint
//! is built from them.

use serde::Serialize;

/// One term of a joint's law, with the unit of its size (of a prismatic joint m in place of rad).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum JointTerm {
    /// a, rad: a wrong zero.
    Offset,
    /// e: a share of its own position.
    Share,
    /// s, rad: once a turn.
    Sine,
    /// c, rad: once a turn, zero at q = 0.
    CosineLessOne,
    /// k, rad/(N m): under gravity's torque.
    Compliance,
    /// κ: a share of another joint's position.
    Coupling,
    /// r, rad/s: with time.
    Rate,
    /// w, rad: the whole width of a play; the output rests on one of its sides.
    Play,
    /// d, rad: half the width of the band in which friction stops a servo.
    DeadBand,
}

impl JointTerm {
    /// All terms.
    pub const ALL: [Self; 9] = [
        Self::Offset,
        Self::Share,
        Self::Sine,
        Self::CosineLessOne,
        Self::Compliance,
        Self::Coupling,
        Self::Rate,
        Self::Play,
        Self::DeadBand,
    ];

    /// Its name in files, for example `dead_band`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Offset => "offset",
            Self::Share => "share",
            Self::Sine => "sine",
            Self::CosineLessOne => "cosine_less_one",
            Self::Compliance => "compliance",
            Self::Coupling => "coupling",
            Self::Rate => "rate",
            Self::Play => "play",
            Self::DeadBand => "dead_band",
        }
    }

    /// The term with this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|term| term.name() == name)
    }

    /// Whether a command can be shifted against it: not against what grows with time.
    pub fn is_fed_forward(self) -> bool {
        self != Self::Rate
    }
}
