//! Fetches what an outage kept from the recording from the edges' rings: in the background, at the lowest priority, within a
//! share of the link's budget.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use farfield_fusion::recording::channels::filled_topic;
use farfield_fusion::recording::holes::Holes;
use farfield_node::clock::VenueClock;
use farfield_proto::id::{SessionId, ViewpointIndex};
use farfield_proto::key::Keys;
use farfield_proto::message::fill::{FillRequest, Filled, MAX_ANSWER_BYTES, SetKind, StoredSet};
use farfield_proto::message::{PatchSet, SightingSet};
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;
use farfield_proto::wire;
use tokio::time::{Instant, sleep, timeout};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tracing::debug;
use zenoh::Session;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::query::ConsolidationMode;

use super::queue::RecordingQueue;

/// Budget of a link for a venue without one, bytes per second: 1 Mbit/s.
const DEFAULT_BUDGET_BYTES_PER_S: f64 = 125_000.0;
/// Size of a request, seconds of the share.
const PACE_S: f64 = 0.25;
/// Least size of a request, bytes.
const MIN_ANSWER_BYTES: f64 = 512.0;
/// Approximate overhead of request and answer on the wire, bytes.
const EXCHANGE_BYTES: f64 = 200.0;
/// Timeout of an answer.
const PATIENCE: Duration = Duration::from_secs(3);
/// Pause between checks for holes, and after an answer that a link had no room for.
const REST: Duration = Duration::from_millis(250);

/// The holes, shared by recorder and fillers.
#[derive(Clone)]
pub(crate) struct SharedHoles(Arc<Mutex<Holes>>);

impl SharedHoles {
    pub(crate) fn new(holes: Holes) -> Self {
        Self(Arc::new(Mutex::new(holes)))
    }

    pub(crate) fn lock(&self) -> MutexGuard<'_, Holes> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The state that all fillers of a recording share.
#[derive(Clone)]
pub(crate) struct Fillers {
    pub(super) session: SessionId,
    pub(super) queue: Arc<RecordingQueue>,
    pub(super) holes: SharedHoles,
    pub(super) clock: VenueClock,
}

impl Fillers {
    /// Starts one task per viewpoint of `venue`; none if the venue disables filling.
    pub(crate) fn spawn(
        &self,
        zenoh: &Session,
        venue: &Venue,
        tasks: &TaskTracker,
        stop: &CancellationToken,
    ) {
        let share = venue.parameters.recording.fill_share;
        if share <= 0.0 {
            return;
        }
        let stated = venue.parameters.link.budget_bytes_per_s;
        let budget = if stated > 0.0 {
            stated
        } else {
            DEFAULT_BUDGET_BYTES_PER_S
        };
        let keys = Keys::new(&venue.name);
        for (index, viewpoint) in venue.viewpoints.iter().enumerate() {
            let filler = Filler {
                shared: self.clone(),
                zenoh: zenoh.clone(),
                viewpoint: ViewpointIndex(index as u16),
                key: keys.fill(&viewpoint.name),
                topics: [SetKind::Patches, SetKind::Sightings]
                    .map(|kind| filled_topic(&keys, &viewpoint.name, kind)),
                bytes_per_s: share * budget,
            };
            let stop = stop.clone();
            tasks.spawn(async move {
                stop.run_until_cancelled(filler.run()).await;
            });
        }
    }

    /// Waits after the run until its holes are filled, at most for `patience`.
    pub(crate) async fn finish(&self, patience: Duration) {
        self.holes.lock().over();
        let deadline = Instant::now() + patience;
        let n_viewpoints = self.holes.lock().viewpoints();
        while Instant::now() < deadline && !self.has_failed() {
            let open = (0..n_viewpoints).any(|v| self.holes.lock().oldest(v).is_some());
            if !open {
                return;
            }
            sleep(Duration::from_millis(20)).await;
        }
    }

    /// Whether the recording has failed.
    fn has_failed(&self) -> bool {
        self.queue.state().failure().is_some()
    }
}

/// Fills the holes of one viewpoint.
struct Filler {
    shared: Fillers,
    zenoh: Session,
    viewpoint: ViewpointIndex,
    key: String,
    /// Topics of filled patches and sightings.
    topics: [String; 2],
    bytes_per_s: f64,
}

impl Filler {
    async fn run(self) {
        let index = usize::from(self.viewpoint.0);
        while !self.shared.has_failed() {
            let hole = self.shared.holes.lock().oldest(index);
            let Some([from, to]) = hole else {
                sleep(REST).await;
                continue;
            };
            let wanted = (PACE_S * self.bytes_per_s).max(MIN_ANSWER_BYTES) as u32;
            let request = FillRequest {
                session: self.shared.session,
                from,
                to,
                max_bytes: wanted.min(MAX_ANSWER_BYTES),
            };
            let answer = timeout(PATIENCE, self.request(&request)).await;
            let Some((filled, bytes)) = answer.ok().flatten() else {
                sleep(REST).await;
                continue;
            };
            if filled.to <= from || filled.to > to {
                // The edge's link has no room.
                sleep(REST).await;
                continue;
            }
            self.take(&filled, [from, filled.to]);
            self.shared.holes.lock().answered(index, [from, filled.to]);
            let cost = bytes as f64 + EXCHANGE_BYTES;
            sleep(Duration::from_secs_f64(cost / self.bytes_per_s)).await;
        }
    }

    /// The edge's answer, and its length in bytes.
    async fn request(&self, request: &FillRequest) -> Option<(Filled, usize)> {
        let replies = self
            .zenoh
            .get(&self.key)
            .payload(wire::encode_for_anyone(request))
            .priority(Priority::Background)
            .congestion_control(CongestionControl::Drop)
            .consolidation(ConsolidationMode::None)
            .timeout(PATIENCE)
            .await
            .ok()?;
        while let Ok(reply) = replies.recv_async().await {
            let Ok(sample) = reply.result() else { continue };
            let payload = sample.payload().to_bytes();
            match wire::decode::<Filled>(&payload) {
                Ok(filled) => return Some((filled, payload.len())),
                Err(error) => debug!(key = self.key, %error, "unreadable answer"),
            }
        }
        None
    }

    /// Records the sets that belong to the request.
    fn take(&self, filled: &Filled, ticks: [Tick; 2]) {
        let at_us = self.shared.clock.now_us();
        for set in &filled.stored {
            if self.belongs(set, ticks) {
                let topic = match set.kind {
                    SetKind::Patches => &self.topics[0],
                    SetKind::Sightings => &self.topics[1],
                };
                self.shared.queue.note(topic, &set.bytes, at_us);
            }
        }
    }

    fn belongs(&self, set: &StoredSet, [from, to]: [Tick; 2]) -> bool {
        let decoded = match set.kind {
            SetKind::Patches => wire::decode::<PatchSet>(&set.bytes)
                .map(|set| (set.session, set.viewpoint, set.tick)),
            SetKind::Sightings => wire::decode::<SightingSet>(&set.bytes)
                .map(|set| (set.session, set.viewpoint, set.tick)),
        };
        decoded.is_ok_and(|(session, viewpoint, tick)| {
            session == self.shared.session
                && viewpoint == self.viewpoint
                && (from..to).contains(&tick)
        })
    }
}

#[cfg(test)]
#[path = "filler_tests.rs"]
mod tests;
