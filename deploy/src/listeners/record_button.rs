//! Recordings that pages start and stop, and their state on pages.

use std::sync::{Arc, Weak};
use std::time::Duration;

use farfield_fusion_node::{RecordingOnDemand, RecordingsOnDemand};
use farfield_page::protocol::status::RecordingState;
use farfield_page::{Action, ActionKind, PageActions, PageState};
use tokio::task::spawn_blocking;
use tokio::time::interval;

/// Interval of state updates for pages.
const REPORT_INTERVAL: Duration = Duration::from_millis(500);

/// Executes the actions of pages: names and recordings.
pub(super) struct Operator {
    pub(super) names: Arc<dyn PageActions>,
    pub(super) recordings: Arc<RecordingsOnDemand>,
}

impl PageActions for Operator {
    fn kinds(&self) -> Vec<ActionKind> {
        let mut kinds = self.names.kinds();
        kinds.push(ActionKind::Record);
        kinds
    }

    fn act(&self, action: &Action) -> Result<(), String> {
        let done = match action {
            Action::StartRecording => self.recordings.start().map(drop),
            Action::StopRecording => self.recordings.stop(),
            Action::NamePerson { .. } => return self.names.act(action),
        };
        done.map_err(|error| format!("{error:#}"))
    }
}

/// Task: sends the state of recordings to `page` as long as the page exists.
pub(super) async fn report_state(recordings: Arc<RecordingsOnDemand>, page: Weak<PageState>) {
    let mut due = interval(REPORT_INTERVAL);
    loop {
        due.tick().await;
        // A blocking thread, so that a disk that hangs does not delay the page.
        let recordings = Arc::clone(&recordings);
        let Ok(now) = spawn_blocking(move || recordings.now()).await else {
            return;
        };
        let Some(page) = page.upgrade() else { return };
        page.set_recording(now.map(|recording| state(&recording)));
    }
}

fn state(recording: &RecordingOnDemand) -> RecordingState {
    let name = recording.file.file_name().unwrap_or_default();
    let name = name.to_string_lossy();
    let lost = match recording.lost {
        0 => String::new(),
        lost => format!(", which lacks {lost} messages: the disk is too slow"),
    };
    let text = match &recording.failure {
        Some(failure) => format!("failed: {failure}"),
        None if recording.is_running => format!("{name}{lost}"),
        None => format!("{}{lost}", recording.file.display()),
    };
    RecordingState {
        running: recording.is_running,
        text,
        since_us: Some(recording.since_us),
        bytes: Some(recording.bytes),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recording() -> RecordingOnDemand {
        RecordingOnDemand {
            file: "out/hall_2026-03-01_18-30-05.mcap".into(),
            is_running: true,
            since_us: 7,
            bytes: 1024,
            lost: 0,
            failure: None,
        }
    }

    #[test]
    fn a_running_recording_is_shown_by_name_and_a_finished_one_by_path() {
        let running = state(&recording());
        assert!(running.running);
        assert_eq!(running.text, "hall_2026-03-01_18-30-05.mcap");
        assert_eq!((running.since_us, running.bytes), (Some(7), Some(1024)));
        let whole = state(&RecordingOnDemand {
            is_running: false,
            ..recording()
        });
        assert_eq!(whole.text, "out/hall_2026-03-01_18-30-05.mcap");
    }

    #[test]
    fn lost_messages_and_failures_are_shown() {
        let lossy = state(&RecordingOnDemand {
            lost: 3,
            ..recording()
        });
        assert!(lossy.text.contains("3 messages"), "{}", lossy.text);
        let failed = state(&RecordingOnDemand {
            is_running: false,
            failure: Some("the disk is full".to_owned()),
            ..recording()
        });
        // The page raises an alarm by the first word.
        assert_eq!(failed.text, "failed: the disk is full");
    }
}
