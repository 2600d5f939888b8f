//! What a further session shows of the result.

use serde::Serialize;

/// A further session, predicted with nothing of it fitted but its own nuisances.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Checked {
    /// Its name.
    pub session: String,
    /// RMS distance of the nominal model, m; none where no marker can be compared.
    pub before_m: Option<f64>,
    /// With the causes, m.
    pub after_m: Option<f64>,
    /// How its base yields otherwise than in the first session; none where it does not, or where that is not seen.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ground: Option<Ground>,
    /// What was left out of both figures as false; none where nothing was.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub left_out: Option<LeftOutThere>,
}

/// What of another session was left out as false, as a diagnosis of it would.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct LeftOutThere {
    /// Observations of markers.
    pub points: usize,
    /// Of how many.
    pub points_given: usize,
    /// Boards that no flat mirror explains.
    pub boards: usize,
}

/// How another session's base turns under the robot's weight beyond what the causes say, `ω = diag(c) M` with the moment M of the
/// weight about the root's origin, in its frame: the robot stands on other ground there, or is bolted down otherwise.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Ground {
    /// RMS distance with the causes and this, m.
    pub after_m: f64,
    /// c about x, y and z, rad/(N m).
    pub yields_rad_per_nm: [f64; 3],
    /// Their standard deviations.
    pub std_rad_per_nm: [f64; 3],
}
