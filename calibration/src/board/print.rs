//! How a `ChArUco` board is printed.

/// How a `ChArUco` board is printed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Print {
    /// White on black (Caliscope's `inverted`).
    pub is_negative: bool,
    /// As `OpenCV` drew boards before 4.6: of an even number of rows the first square is white. Odd numbers are the same in both.
    pub is_legacy: bool,
}

impl Print {
    /// What is unusual about it, in words.
    pub(super) fn in_words(self) -> Option<&'static str> {
        match (self.is_negative, self.is_legacy) {
            (false, false) => None,
            (true, false) => Some("white on black"),
            (false, true) => Some("as OpenCV drew boards before 4.6 (its first square is white)"),
            (true, true) => Some("as OpenCV drew boards before 4.6, and white on black"),
        }
    }
}
