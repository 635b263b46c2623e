//! Content of fisheye cameras beyond the used part of their view.

use std::fmt;

/// Content left out since the start, because it was beyond the used part of a camera's view
/// ([`farfield_proto::camera::FISHEYE_HALF_VIEW_RAD`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BeyondView {
    /// Detections completely outside the used view.
    pub detections: u64,
    /// Keypoints of detected people.
    pub keypoints: u64,
}

impl BeyondView {
    /// Text that identifies such a line of output.
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
