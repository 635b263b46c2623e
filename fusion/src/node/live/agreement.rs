//! Whether the cameras of a live venue agree: judged every ten seconds, on a thread of its own; more rarely where that takes long,
//! so that it never takes much of what fusion computes with.

use std::collections::BTreeSet;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use farfield_node::clock;
use farfield_node::process::say;
use farfield_proto::id::CameraIndex;
use farfield_proto::message::agreement::{AgreementOfCamera, MAX_AGREEMENTS};
use farfield_proto::venue::Venue;
use tracing::debug;

use crate::camera_agreement::{AgreementReport, AgreementSamples, JudgedBefore};

/// Judging takes at most one part in so many of a core's time.
const ONE_PART_IN: u32 = 100;

/// What came out last.
#[derive(Default)]
struct Judged {
    report: AgreementReport,
    /// Until when nothing is judged, after how long that took.
    rests_until: Option<Instant>,
}

/// Judges what is handed to it, and keeps what came out last.
pub(super) struct AgreementJudge {
    newest: SyncSender<AgreementSamples>,
    judged: Arc<Mutex<Judged>>,
    /// The causes and cameras that were told of.
    told: BTreeSet<String>,
}

impl AgreementJudge {
    /// Starts the thread; it ends when this is dropped.
    ///
    /// # Errors
    /// When the system has no thread left.
    pub(super) fn start() -> std::io::Result<Self> {
        let (newest, samples) = sync_channel(1);
        let judged = Arc::new(Mutex::new(Judged::default()));
        let kept = Arc::clone(&judged);
        let thread = std::thread::Builder::new().name("agreement".to_owned());
        thread.spawn(move || judge_all(&samples, &kept))?;
        Ok(Self {
            newest,
            judged,
            told: BTreeSet::new(),
        })
    }

    /// Has these judged; they are left out while others are, and for some time after that took long.
    pub(super) fn judge(&self, samples: AgreementSamples) {
        let rests_until = self.judged().rests_until;
        let rests = rests_until.is_some_and(|until| clock::now() < until);
        if rests || self.newest.try_send(samples).is_err() {
            debug!("the agreement of the cameras was judged a short while ago, or still is");
        }
    }

    fn judged(&self) -> MutexGuard<'_, Judged> {
        self.judged.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// How each camera of `venue` agrees, those of which anything is known.
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

    /// Says once of everything that does not fit what it is, and what to do about it; returns what does not fit now.
    pub(super) fn warnings(&mut self) -> Vec<String> {
        let judged = self.judged.lock().unwrap_or_else(PoisonError::into_inner);
        let mut warnings = Vec::new();
        for disagreement in &judged.report.disagreements {
            let words = format!("{}; {}", disagreement.found, disagreement.remedy);
            if self.told.insert(disagreement.name()) {
                say(format_args!("warning: {words}"));
            }
            warnings.push(words);
        }
        warnings
    }
}

fn judge_all(samples: &Receiver<AgreementSamples>, kept: &Mutex<Judged>) {
    let mut before = JudgedBefore::default();
    while let Ok(samples) = samples.recv() {
        let start = clock::now();
        let report = samples.report_after(&mut before);
        let now = clock::now();
        let judged = Judged {
            report,
            rests_until: Some(now + rest_after(now - start)),
        };
        *kept.lock().unwrap_or_else(PoisonError::into_inner) = judged;
    }
}

/// How long nothing is judged after that has taken `took`.
fn rest_after(took: Duration) -> Duration {
    took * (ONE_PART_IN - 1)
}
