//! What fisheye cameras showed beyond the part of their view that is used.

use std::fmt;

/// What was left out because it lay beyond the part of a camera's view that is used
/// ([`farfield_proto::camera::FISHEYE_HALF_VIEW_RAD`]), since the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BeyondView {
    /// Detections of which no part lay in it.
    pub detections: u64,
    /// Keypoints of detected people.
    pub keypoints: u64,
}

impl BeyondView {
    /// Words by which a line that says it is known.
    pub const WORDS: &str = "beyond 120 degrees of view (60 off its axis) were left out";

    /// Whether nothing was left out.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }
}

impl fmt::Display for BeyondView {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} detections and {} keypoints {}",
            self.detections,
            self.keypoints,
            Self::WORDS
        )
    }
}
