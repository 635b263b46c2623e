//! Whether the cameras of a live venue agree: judged every ten seconds, on a thread of its own.

use std::collections::BTreeSet;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};

use farfield_node::process::say;
use farfield_proto::id::CameraIndex;
use farfield_proto::message::agreement::{AgreementOfCamera, MAX_AGREEMENTS};
use farfield_proto::venue::Venue;
use tracing::debug;

use crate::camera_agreement::{AgreementReport, AgreementSamples};

/// Judges what is handed to it, and keeps what came out last.
pub(super) struct AgreementJudge {
    newest: SyncSender<AgreementSamples>,
    report: Arc<Mutex<AgreementReport>>,
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
        let report = Arc::new(Mutex::new(AgreementReport::default()));
        let kept = Arc::clone(&report);
        let thread = std::thread::Builder::new().name("agreement".to_owned());
        thread.spawn(move || judge_all(&samples, &kept))?;
        Ok(Self {
            newest,
            report,
            told: BTreeSet::new(),
        })
    }

    /// Has these judged; they are left out while others are.
    pub(super) fn judge(&self, samples: AgreementSamples) {
        if self.newest.try_send(samples).is_err() {
            debug!("the agreement of the cameras is still being judged");
        }
    }

    /// How each camera of `venue` agrees, those of which anything is known.
    pub(super) fn cameras(&self, venue: &Venue) -> Vec<AgreementOfCamera> {
        let report = self.report.lock().unwrap_or_else(PoisonError::into_inner);
        let cameras = (0..).zip(&venue.cameras).filter_map(|(index, camera)| {
            let agreement = *report.cameras.get(camera.model.name())?;
            agreement.is_known().then_some(AgreementOfCamera {
                camera: CameraIndex(index),
                agreement,
            })
        });
        cameras.take(MAX_AGREEMENTS).collect()
    }

    /// Says once of everything that does not fit what it is, and what to do about it; returns what does not fit now.
    pub(super) fn warnings(&mut self) -> Vec<String> {
        let report = self.report.lock().unwrap_or_else(PoisonError::into_inner);
        let mut warnings = Vec::new();
        for disagreement in &report.disagreements {
            let words = format!("{}; {}", disagreement.found, disagreement.remedy);
            if self.told.insert(disagreement.name()) {
                say(format_args!("warning: {words}"));
            }
            warnings.push(words);
        }
        warnings
    }
}

fn judge_all(samples: &Receiver<AgreementSamples>, kept: &Mutex<AgreementReport>) {
    while let Ok(samples) = samples.recv() {
        let report = samples.report();
        *kept.lock().unwrap_or_else(PoisonError::into_inner) = report;
    }
}
