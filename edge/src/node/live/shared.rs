//! The data shared by the threads of a live edge, and the output: publishers and the sending of a
//! tick's results to the link and the ring.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;

use farfield_node::clock::VenueClock;
use farfield_node::histogram::Histogram;
use farfield_node::session::{self, Delivery, has_listener, put_status};
use farfield_proto::id::{CameraIndex, SessionId};
use farfield_proto::key::Keys;
use farfield_proto::message::fill::SetKind;
use farfield_proto::message::live::LiveStatus;
use farfield_proto::message::thumbnail::Thumbnail;
use farfield_proto::message::{BoxSet, StageTime};
use farfield_proto::tick::Tick;
use farfield_proto::wire::{self, Message, SpokenVersion};
use tokio_util::sync::CancellationToken;
use tracing::debug;
use zenoh::pubsub::Publisher;
use zenoh::{Session, Wait as _};

use super::frames::FrameStore;
use super::ledger::Ledger;
use super::thumbnails::PictureSlot;
use super::work_watch::{Caller, WorkWatch};
use crate::live::newest_boxes::BoxSetArrival;
use crate::live::rate::{MessageKind, SendPlan};
use crate::live::{Micros, SECOND_US};
use crate::node::acceleration::Workers;
use crate::node::ring::RingHandle;
use crate::node::worker::Parts;
use crate::pipeline::EdgeOutput;
use crate::ring::record::Label;

/// Longest time until a sleeping thread notices that it must stop.
const MAX_SLEEP: Duration = Duration::from_millis(50);

/// The clock, the state, the frames and the output.
pub(super) struct Shared {
    pub(super) clock: VenueClock,
    pub(super) frames: FrameStore,
    /// Pictures for thumbnails.
    pub(super) picture_slot: PictureSlot,
    ledger: Mutex<Ledger>,
    stages: Mutex<BTreeMap<&'static str, Histogram>>,
    publishers: EdgePublishers,
    spoken: Arc<SpokenVersion>,
    ring: Option<RingHandle>,
    workers: OnceLock<Workers>,
    /// Running calls of networks.
    pub(super) works: WorkWatch,
    stop: CancellationToken,
}

impl Shared {
    /// For the cameras of `parts`. Messages go to `publishers`, in the version that fusion reads,
    /// and to `ring` if present.
    pub(super) fn new(
        parts: &Parts,
        clock: VenueClock,
        (publishers, spoken): (EdgePublishers, Arc<SpokenVersion>),
        ring: Option<RingHandle>,
    ) -> Self {
        let venue = &parts.venue;
        let period_us = (1e6 / venue.rate_hz).round() as Micros;
        let most_lag_us = (venue.parameters.link.deadline_ms * 1e3) as Micros;
        Self {
            clock,
            frames: FrameStore::new(&parts.cameras, period_us, most_lag_us),
            picture_slot: PictureSlot::default(),
            ledger: Mutex::new(Ledger::new(venue.rate_hz, &venue.parameters.link)),
            stages: Mutex::default(),
            publishers,
            spoken,
            ring,
            workers: OnceLock::new(),
            works: WorkWatch::default(),
            stop: CancellationToken::new(),
        }
    }

    /// The state; hold the lock for microseconds only.
    pub(super) fn ledger(&self) -> MutexGuard<'_, Ledger> {
        // Each part is valid on its own, even after a panic of another thread.
        self.ledger.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds boxes that have just arrived.
    pub(super) fn take_boxes(&self, boxes: BoxSet) -> BoxSetArrival {
        let now_us = self.clock.now_us();
        self.ledger().take_boxes(boxes, now_us)
    }

    /// Fusion's session, once known.
    pub(super) fn session(&self) -> Option<SessionId> {
        self.ledger().boxes.session()
    }

    /// Time since the last boxes of fusion, microseconds; `None` before the first.
    pub(super) fn silent_us(&self) -> Option<Micros> {
        let now_us = self.clock.now_us();
        self.ledger().boxes.silent_us(now_us)
    }

    /// The message version that fusion reads.
    pub(super) fn message_version(&self) -> u8 {
        self.spoken.get()
    }

    /// Encodes a message for fusion.
    pub(super) fn encode<M: Message>(&self, message: &M) -> Vec<u8> {
        wire::encode_as(message, self.message_version())
    }

    /// Sends a message if the budget has room; returns whether it was sent.
    pub(super) fn send(&self, message: MessageKind, bytes: Vec<u8>) -> bool {
        let now_us = self.clock.now_us();
        let admitted = self.ledger().admit(message, bytes.len(), now_us);
        if admitted {
            self.publishers.put(message, bytes);
        }
        admitted
    }

    /// Whether pictures may leave the edge.
    pub(super) fn has_pictures(&self) -> bool {
        self.publishers.has_pictures()
    }

    /// Whether thumbnails have a subscriber.
    pub(super) fn has_thumbnail_subscriber(&self) -> bool {
        self.publishers.has_thumbnail_subscriber()
    }

    /// Sends a thumbnail if there is room. It is not stored.
    pub(super) fn send_thumbnail(&self, thumbnail: &Thumbnail) {
        let bytes = self.encode(thumbnail);
        let (picture, payload) = (thumbnail.jpeg.len(), bytes.len());
        let now_us = self.clock.now_us();
        if self.ledger().admit_thumbnail(picture, payload, now_us) {
            self.publishers.put(MessageKind::Thumbnail, bytes);
        }
    }

    /// Stores a message on disk, whether sent or not.
    pub(super) fn keep(&self, label: Label, message: &[u8]) {
        if let Some(ring) = &self.ring {
            ring.store(label, message);
        }
    }

    /// Why some messages are not stored, if so.
    pub(super) fn ring_failure(&self) -> Option<String> {
        self.ring.as_ref().and_then(RingHandle::failure)
    }

    /// Whether the budget has room for this many bytes in addition to the patches.
    pub(super) fn admits(&self, bytes: usize) -> bool {
        let now_us = self.clock.now_us();
        self.ledger().admit(MessageKind::Status, bytes, now_us)
    }

    /// Records the duration of a stage.
    pub(super) fn count(&self, stage: &'static str, us: u32) {
        self.lock_stages().entry(stage).or_default().record(us);
    }

    /// The durations of all stages.
    pub(super) fn stages(&self) -> Vec<StageTime> {
        let stages = self.lock_stages();
        let times = stages.iter().filter_map(|(stage, h)| h.stage_time(stage));
        times.collect()
    }

    /// The live status without the cameras.
    pub(super) fn describe(&self, now_us: Micros) -> LiveStatus {
        self.ledger().describe(now_us)
    }

    /// A message if the computer is too slow for all people at every tick.
    pub(super) fn overload(&self) -> Option<String> {
        self.ledger().overload()
    }

    /// Records a call of the networks for at most this many crops.
    pub(super) fn begin_work(&self, caller: Caller, crops: usize) {
        let crops_per_s = self.workers().map_or(f64::INFINITY, |it| it.crops_per_s);
        let expected_us = crops as f64 / crops_per_s * SECOND_US as f64;
        self.works
            .begin(caller, self.clock.now_us(), expected_us as Micros);
    }

    /// Records a finished tick, its crops and its duration.
    pub(super) fn count_work(&self, crops: usize, took_us: u32) {
        let now_us = self.clock.now_us();
        let mut ledger = self.ledger();
        ledger.rate.worked(crops, took_us, now_us);
        if crops > 0 {
            ledger.failures.worked();
        }
    }

    /// Records a failed tick.
    pub(super) fn note_failure(&self, error: &anyhow::Error) {
        let now_us = self.clock.now_us();
        let mut ledger = self.ledger();
        ledger.missed += 1;
        ledger.failures.failed(format!("{error:#}"), now_us);
    }

    /// Messages about late and failing networks, each with a flag that the edge should give up.
    pub(super) fn trouble(&self) -> [Option<(String, bool)>; 2] {
        let now_us = self.clock.now_us();
        [
            self.works.late(now_us),
            self.ledger().failures.recent(now_us),
        ]
    }

    /// Sets the workers of the network, once.
    pub(super) fn set_workers(&self, workers: Workers) {
        self.workers.get_or_init(|| workers);
    }

    /// The workers of the network, once measured.
    pub(super) fn workers(&self) -> Option<Workers> {
        self.workers.get().copied()
    }

    pub(super) fn last_tick(&self) -> Option<Tick> {
        self.ledger().last
    }

    pub(super) fn stop(&self) {
        self.stop.cancel();
        self.frames.wake();
    }

    pub(super) fn is_stopped(&self) -> bool {
        self.stop.is_cancelled()
    }

    /// Sleeps until `until_us`; `false` if the edge must stop.
    pub(super) fn sleep_until(&self, until_us: Micros) -> bool {
        while !self.is_stopped() {
            let left_us = until_us - self.clock.now_us();
            if left_us <= 0 {
                return true;
            }
            std::thread::sleep(Duration::from_micros(left_us.unsigned_abs()).min(MAX_SLEEP));
        }
        false
    }

    /// Sleeps; `false` if the edge must stop.
    pub(super) fn pause(&self, us: Micros) -> bool {
        self.sleep_until(self.clock.now_us().saturating_add(us))
    }

    fn lock_stages(&self) -> MutexGuard<'_, BTreeMap<&'static str, Histogram>> {
        self.stages.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// State at the start of a tick.
pub(super) struct TickStart {
    pub(super) tick: Tick,
    pub(super) boxes: Arc<BoxSet>,
    pub(super) detection_cameras: Vec<CameraIndex>,
    /// Whether fusion is silent, so that this edge must follow people itself.
    pub(super) is_watched: bool,
    pub(super) plan: SendPlan,
    pub(super) may_send: bool,
    /// Whether there is time for the second crops of tilted people.
    pub(super) has_time_for_second_crops: bool,
}

/// Sends and stores the results of `start`. Sightings first: the patches state how many sightings
/// fusion must wait for.
pub(super) fn send_output(shared: &Shared, start: &TickStart, output: EdgeOutput) {
    let label = |session, kind| Label {
        session,
        tick: start.tick,
        kind,
    };
    for set in &output.sighting_sets {
        let bytes = shared.encode(set);
        shared.keep(label(set.session, SetKind::Sightings), &bytes);
        shared.send(MessageKind::Sightings, bytes);
    }
    let messages = output.patch_sets.len();
    let (mut persons, mut payload) = (0, 0);
    for mut set in output.patch_sets {
        let now_us = shared.clock.now_us();
        set.timing = shared.ledger().timing(start.tick, now_us);
        let bytes = shared.encode(&set);
        shared.keep(label(set.session, SetKind::Patches), &bytes);
        persons += set.persons.len();
        payload += bytes.len();
        if start.may_send {
            shared.send(MessageKind::Patches(start.tick), bytes);
        }
    }
    let mut ledger = shared.ledger();
    ledger
        .rate
        .packed(start.plan.level, persons, messages, payload);
}

/// The publishers of a live edge. Patches are best effort, because newer ones follow. Sightings and
/// statuses are reliable, because the next one comes a second later. Thumbnails have the lowest
/// priority.
pub(in crate::node) struct EdgePublishers {
    patches: Publisher<'static>,
    sightings: Publisher<'static>,
    status: Publisher<'static>,
    /// Set if pictures may leave the edge.
    thumbnails: Option<Publisher<'static>>,
}

impl EdgePublishers {
    /// Declares the publishers of a venue and viewpoint; with `pictures`, also the one of
    /// thumbnails.
    ///
    /// # Errors
    /// The error of Zenoh.
    pub(in crate::node) async fn declare(
        session: &Session,
        [venue, viewpoint]: [&str; 2],
        pictures: bool,
    ) -> anyhow::Result<Self> {
        let keys = Keys::new(venue);
        let publisher = |key, delivery| session::publisher(session, key, delivery);
        let thumbnails = if pictures {
            Some(publisher(keys.thumbnail(viewpoint), Delivery::Leisurely).await?)
        } else {
            None
        };
        Ok(Self {
            thumbnails,
            patches: publisher(keys.patch(viewpoint), Delivery::BestEffort).await?,
            sightings: publisher(keys.sighting(viewpoint), Delivery::Reliable).await?,
            status: publisher(keys.status(viewpoint), Delivery::Reliable).await?,
        })
    }

    /// Whether pictures may leave the edge.
    pub(super) fn has_pictures(&self) -> bool {
        self.thumbnails.is_some()
    }

    /// Whether thumbnails have a subscriber.
    pub(super) fn has_thumbnail_subscriber(&self) -> bool {
        self.thumbnails.as_ref().is_some_and(has_listener)
    }

    /// Passes a message to the network.
    pub(super) fn put(&self, message: MessageKind, bytes: Vec<u8>) {
        let (publisher, sent) = match message {
            MessageKind::Patches(_) => (&self.patches, self.patches.put(bytes).wait()),
            MessageKind::Sightings => (&self.sightings, self.sightings.put(bytes).wait()),
            MessageKind::Status => (&self.status, put_status(&self.status, bytes)),
            MessageKind::Thumbnail => match &self.thumbnails {
                Some(thumbnails) => (thumbnails, thumbnails.put(bytes).wait()),
                None => return,
            },
        };
        // While fusion is away there is no receiver.
        if let Err(error) = sent {
            debug!(key = %publisher.key_expr(), %error, "not sent");
        }
    }
}
