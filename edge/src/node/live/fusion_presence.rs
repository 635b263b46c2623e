//! Messages about fusion's presence for the edge's log: one when it goes, and one when it is back.

use crate::live::{Micros, SECOND_US};

/// Boxes that arrive sooner after a disconnection were already on their way, microseconds.
const UNDER_WAY_US: Micros = SECOND_US / 2;

/// The last reported state.
#[derive(Debug, Default)]
pub(super) struct FusionPresence {
    /// Set while fusion is gone.
    gone: Option<Gone>,
}

/// Data of an absence.
#[derive(Debug, Clone, Copy)]
struct Gone {
    /// Time of the notice; the lease ends seconds after the last message.
    noticed_us: Micros,
    /// Time since which no message came.
    silent_since_us: Micros,
}

impl FusionPresence {
    /// Records at `now_us` that fusion is gone. Its last boxes came `silent_us` before, `None` if
    /// there were none. Returns the message for the log, if the state is new.
    pub(super) fn gone(&mut self, silent_us: Option<Micros>, now_us: Micros) -> Option<String> {
        if self.gone.is_some() {
            return None;
        }
        self.gone = Some(Gone {
            noticed_us: now_us,
            silent_since_us: now_us.saturating_sub(silent_us.unwrap_or(0).max(0)),
        });
        let Some(silent_us) = silent_us else {
            return Some("fusion is gone: waiting for it".to_owned());
        };
        let silent_s = silent_us.max(0) as f64 / 1e6;
        Some(format!(
            "fusion is gone (last heard {silent_s:.1} s ago): following people by its own boxes for a while, and waiting for it"
        ))
    }

    /// Records boxes of fusion at `now_us`. Returns the message for the log, if fusion was gone.
    pub(super) fn returned(&mut self, now_us: Micros) -> Option<String> {
        let gone = self.gone?;
        if now_us.saturating_sub(gone.noticed_us) < UNDER_WAY_US {
            return None;
        }
        self.gone = None;
        let silent_s = now_us.saturating_sub(gone.silent_since_us) as f64 / 1e6;
        Some(format!("fusion is back after {silent_s:.1} s"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn absence_and_return_of_fusion_are_reported_once() {
        let mut fusion = FusionPresence::default();
        assert_eq!(fusion.returned(0), None, "it was there all along");
        let message = fusion.gone(Some(180_000), SECOND_US).unwrap();
        assert!(
            message.starts_with("fusion is gone (last heard 0.2 s ago): "),
            "{message}"
        );
        assert_eq!(fusion.gone(Some(0), 2 * SECOND_US), None);
        let message = fusion.returned(8 * SECOND_US).unwrap();
        assert_eq!(message, "fusion is back after 7.2 s");
        assert_eq!(fusion.returned(9 * SECOND_US), None);
        assert!(fusion.gone(Some(0), 9 * SECOND_US).is_some(), "once more");
    }

    #[test]
    fn an_absence_starts_with_the_last_message() {
        // Symptom to prevent: stopped for 5 s, noticed after 4 s, "back after 1 s".
        let mut fusion = FusionPresence::default();
        fusion.gone(Some(4 * SECOND_US), 10 * SECOND_US).unwrap();
        let message = fusion.returned(11 * SECOND_US).unwrap();
        assert_eq!(message, "fusion is back after 5.0 s");
    }

    #[test]
    fn boxes_in_transit_do_not_end_an_absence() {
        let mut fusion = FusionPresence::default();
        fusion.gone(Some(0), SECOND_US).unwrap();
        assert_eq!(fusion.returned(SECOND_US + 3_000), None);
        assert!(fusion.returned(2 * SECOND_US).is_some());
    }

    #[test]
    fn absence_before_the_first_boxes_is_reported() {
        let mut fusion = FusionPresence::default();
        let message = fusion.gone(None, SECOND_US).unwrap();
        assert_eq!(message, "fusion is gone: waiting for it");
    }
}
