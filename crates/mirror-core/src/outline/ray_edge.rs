//! Where the outline crosses one ray of a ball.

use super::channels::Parted;

/// Fewer rays with an edge than this make no outline.
pub(super) const MIN_EDGE_POINTS: usize = 8;

/// The ball's light at the rim is extrapolated: its change from the zone on counts by this power. Measured on drawn balls that are lit from one side: with 1 dark rims
/// before shadows are drawn too far, with 0 all balls towards their lamp.
const RIM_POWER: f64 = 0.6;

/// Standard deviation of normal numbers by the median of their sizes.
pub(super) const NORMAL_SPREAD: f64 = 1.4826;

/// The edge on one ray.
#[derive(Clone, Copy)]
pub(super) struct RayEdge {
    /// Offset from the expected outline, px.
    pub offset: f64,
    pub std: f64,
    pub found: bool,
    /// How far another curve of the camera than thought moves it, px, along the ray.
    pub by_curve: f64,
    /// How its channels lie apart.
    pub parted: Parted,
    /// Whether a channel of one of the two colours is as bright as can be.
    pub clipped: bool,
    /// How much the coverage exceeds 1 inside of the edge and falls below 0 beyond it, an effect of sharpening.
    pub overshoot: [f64; 2],
    /// Second moment of what is covered by half, px²: the blur's variance.
    pub moment: f64,
    /// The difference of the ball's and the background's colour where they are distinguished, in the patch's
    /// values: noise divided by it is noise of the share.
    pub contrast: f64,
    /// How much each channel has in the share that is read, together 1.
    pub channels: [f64; 3],
    /// The two colours.
    pub ball: [f64; 3],
    pub behind: [f64; 3],
    /// Their light at the edge against that of the zones in which they are read.
    pub at_rim: f64,
    pub beside_rim: f64,
}

impl RayEdge {
    /// The ball's colour at the rim.
    pub fn rim(&self) -> [f64; 3] {
        let change = self.at_rim.powf(RIM_POWER);
        self.ball.map(|value| value * change)
    }

    /// The background's colour at the edge.
    pub fn beside(&self) -> [f64; 3] {
        self.behind.map(|value| value * self.beside_rim)
    }
}
