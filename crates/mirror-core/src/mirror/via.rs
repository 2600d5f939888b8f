//! How a point is seen: in the mirror, or without it.

/// How a point was seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Via {
    /// In the mirror.
    #[default]
    Mirror,
    /// Without the mirror: straight from the point to the camera.
    Direct,
}
