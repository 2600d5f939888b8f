//! Where the outline crosses one ray of a ball.

/// Fewer rays with an edge than this make no outline.
pub(super) const MIN_EDGE_POINTS: usize = 8;

/// The edge on one ray.
#[derive(Clone, Copy)]
pub(super) struct RayEdge {
    /// Offset from the expected outline, px.
    pub offset: f64,
    pub std: f64,
    pub found: bool,
    /// How far misjudged light may have moved it, px: along the ray the ball's or the background's light changes towards the edge other than thought (signed),
    /// and what the ball's rim is doubted anyway.
    pub trend: f64,
    pub doubt: f64,
    /// Second moment of what is covered by half, px²: the blur's variance.
    pub moment: f64,
    /// The two colours.
    pub ball: [f64; 3],
    pub behind: [f64; 3],
}
