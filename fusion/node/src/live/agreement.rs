//! Judges the agreement of the cameras in a live run: every ten seconds on its own thread, less often if it takes long, so that
//! it uses little of the computing time.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use farfield_node::clock;
use farfield_proto::id::CameraIndex;
use farfield_proto::message::agreement::{AgreementOfCamera, MAX_AGREEMENTS};
use farfield_proto::venue::Venue;
use tracing::debug;

use farfield_fusion::camera_agreement::{AgreementReport, AgreementSamples, JudgedBefore};

use super::conditions::Condition;

/// Judging takes at most one part in this many of a core's time.
const ONE_PART_IN: u32 = 100;

/// The newest result.
#[derive(Default)]
struct Judged {
    report: AgreementReport,
    /// End of the pause after the last judgement.
    rests_until: Option<Instant>,
}

/// Judges samples, and stores the newest result.
pub(super) struct AgreementJudge {
    newest: SyncSender<AgreementSamples>,
    judged: Arc<Mutex<Judged>>,
}

impl AgreementJudge {
    /// Starts the thread, which ends when this is dropped.
    ///
    /// # Errors
    /// The system cannot start a thread.
    pub(super) fn start() -> std::io::Result<Self> {
        let (newest, samples) = sync_channel(1);
        let judged = Arc::new(Mutex::new(Judged::default()));
        let result = Arc::clone(&judged);
        let thread = std::thread::Builder::new().name("agreement".to_owned());
        thread.spawn(move || judge_all(&samples, &result))?;
        Ok(Self { newest, judged })
    }

    /// Sends samples to the thread; drops them while it is busy or pauses.
    pub(super) fn judge(&self, samples: AgreementSamples) {
        let rests_until = self.judged().rests_until;
        let rests = rests_until.is_some_and(|until| clock::now() < until);
        if rests || self.newest.try_send(samples).is_err() {
            debug!("the cameras' agreement is being judged, or was a short while ago");
        }
    }

    fn judged(&self) -> MutexGuard<'_, Judged> {
        self.judged.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The agreement of each camera of `venue`, as far as it is known.
    pub(super) fn cameras(&self, venue: &Venue) -> Vec<AgreementOfCamera> {
        let judged = self.judged();
        let cameras = (0..).zip(&venue.cameras).filter_map(|(index, camera)| {
            let agreement = *judged.report.cameras.get(camera.model.name())?;
            agreement.is_known().then_some(AgreementOfCamera {
                camera: CameraIndex(index),
                agreement,
            })
        });
        cameras.take(MAX_AGREEMENTS).collect()
    }

    /// The current disagreements with their remedies.
    pub(super) fn conditions(&self) -> Vec<Condition> {
        let judged = self.judged();
        let disagreements = judged.report.disagreements.iter().map(|disagreement| {
            let words = format!("{}; {}", disagreement.found, disagreement.remedy);
            Condition::of(disagreement.name())
                .begins(format!("warning: {words}"))
                .notice(words)
        });
        disagreements.collect()
    }
}

fn judge_all(samples: &Receiver<AgreementSamples>, result: &Mutex<Judged>) {
    let mut before = JudgedBefore::default();
    while let Ok(samples) = samples.recv() {
        let start = clock::now();
        let report = samples.report_after(&mut before);
        let now = clock::now();
        let judged = Judged {
            report,
            rests_until: Some(now + rest_after(now - start)),
        };
        *result.lock().unwrap_or_else(PoisonError::into_inner) = judged;
    }
}

/// The pause after a judgement that took `took`.
fn rest_after(took: Duration) -> Duration {
    took * (ONE_PART_IN - 1)
}
