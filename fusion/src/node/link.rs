//! Fusion's side of the wire: one Zenoh router that all edges connect to.
//!
//! In lock-step everything is reliable and blocks, at one priority: it can wait, but must not lose or
//! reorder. Live, boxes and poses are best effort, and nothing blocks. Nothing is scouted for; the
//! endpoints are in the venue file.

use std::sync::Arc;

use anyhow::{Context as _, anyhow};
use farfield_proto::id::ViewpointIndex;
use farfield_proto::key::Keys;
use farfield_proto::message::{PatchSet, SightingSet, Status};
pub(super) use farfield_proto::transport::FUSION as NODE;
use farfield_proto::transport::{FusionTransport, Identity};
use farfield_proto::venue::Venue;
use farfield_proto::wire::{self, WireError};
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tracing::{debug, warn};
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority, Reliability};
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait as _};

use super::clock::VenueClock;
use super::inbox::{Inbox, liveliness, subscriber};
use super::tap::{TapHandle, TapMessage};

/// Messages that wait for the loop; when it is full, what has come waits in its subscription's inbox.
const QUEUE: usize = 256;

/// What the network tells the loop.
#[derive(Debug)]
pub(super) enum Heard {
    /// Patches.
    Patches(PatchSet, Arrival),
    /// Sightings.
    Sightings(SightingSet, Arrival),
    /// A node says how it is.
    Status(Box<Status>),
    /// A node has joined or left.
    Alive(String, Presence),
    /// A message that cannot be read, by its key.
    Unreadable(String),
}

/// How a message came.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Arrival {
    /// The bytes it took.
    pub(super) bytes: u64,
    /// When, microseconds since 1970.
    pub(super) at_us: i64,
}

/// What messages are worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mode {
    /// All of them come, in order, however long it takes.
    LockStep,
    /// The newest counts; what cannot go at once is dropped.
    Live,
}

/// Whether a node is there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Presence {
    /// Its liveliness token is there.
    There,
    /// Its token went away with its session.
    Gone,
}

/// What fusion says, and to whom.
#[derive(Debug)]
pub(super) enum Said {
    /// Boxes for the viewpoint of this index.
    Boxes(usize, Vec<u8>),
    /// The persons of a tick.
    Poses(Vec<u8>),
    /// The persons of a tick, as the fixed-lag smoother sees them.
    Smooth(Vec<u8>),
    /// What was used for a tick, for whoever records elsewhere.
    Decision(Vec<u8>),
    /// What changed who is who at a tick.
    Events(Vec<u8>),
    /// How fusion is.
    Status(Vec<u8>),
}

/// Where fusion listens, and by what it proves who it is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Door<'a> {
    pub(super) listen: &'a [String],
    /// `None` without TLS.
    pub(super) identity: Option<&'a Identity>,
}

/// The open session with all that is declared on it.
pub(super) struct Link {
    session: Session,
    mouths: Mouths,
    subscribers: Vec<(Topic, Inbox)>,
    token: LivelinessToken,
}

/// All that fusion publishes on.
struct Mouths {
    boxes: Vec<Publisher<'static>>,
    poses: Publisher<'static>,
    smooth: Publisher<'static>,
    decisions: Publisher<'static>,
    events: Publisher<'static>,
    status: Publisher<'static>,
}

#[derive(Debug, Clone, Copy)]
enum Topic {
    Patches,
    Sightings,
    Statuses,
    Alive,
}

#[expect(clippy::needless_pass_by_value, reason = "what `map_err` takes")]
pub(super) fn zenoh_error(error: zenoh::Error) -> anyhow::Error {
    anyhow!(without_places(&error.to_string()))
}

/// Zenoh's words without the places in its own source, ` at FILE.rs:LINE.`, which help no operator.
fn without_places(text: &str) -> String {
    let mut parts = text.split(" at ");
    let mut kept = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let end = part.find(|c: char| c.is_whitespace() || c == ']');
        let (word, rest) = part.split_at(end.unwrap_or(part.len()));
        if word.contains(".rs:") {
            kept.push_str(rest);
        } else {
            kept.push_str(" at ");
            kept.push_str(part);
        }
    }
    kept
}

fn config(transport: &FusionTransport<'_>) -> anyhow::Result<zenoh::Config> {
    let mut config = zenoh::Config::default();
    for (key, value) in transport.settings() {
        config
            .insert_json5(&key, &value)
            .map_err(zenoh_error)
            .with_context(|| format!("setting {key} to {value}"))?;
    }
    Ok(config)
}

impl Link {
    /// Listens where `door` says and declares everything that the edges of `venue` need.
    pub(super) async fn open(venue: &Venue, door: &Door<'_>, mode: Mode) -> anyhow::Result<Self> {
        let viewpoints: Vec<&str> = venue.viewpoints.iter().map(|v| v.name.as_str()).collect();
        let transport = FusionTransport {
            venue: &venue.name,
            viewpoints: &viewpoints,
            listen: door.listen,
            identity: door.identity,
        };
        let session = zenoh::open(config(&transport)?).await.map_err(zenoh_error);
        let session = session.map_err(|error| {
            // Zenoh has no kind for it.
            let taken = error.to_string().contains("in use");
            let hint = if taken {
                "; choose another with --listen"
            } else {
                ""
            };
            anyhow!("listening on {}: {error:#}{hint}", door.listen.join(", "))
        })?;
        let keys = Keys::new(&venue.name);
        let mut boxes = Vec::new();
        for viewpoint in &venue.viewpoints {
            boxes.push(publisher(&session, keys.boxes(&viewpoint.name), mode).await?);
        }
        let subscribers = vec![
            (
                Topic::Patches,
                subscriber(&session, keys.patches(), mode).await?,
            ),
            (
                Topic::Sightings,
                subscriber(&session, keys.sightings(), mode).await?,
            ),
            (
                Topic::Statuses,
                subscriber(&session, keys.statuses(), mode).await?,
            ),
            (Topic::Alive, liveliness(&session, keys.all_alive()).await?),
        ];
        let mouths = Mouths {
            boxes,
            poses: publisher(&session, keys.pose(), mode).await?,
            smooth: publisher(&session, keys.smooth(), mode).await?,
            decisions: publisher(&session, keys.decision(), mode).await?,
            events: status_publisher(&session, keys.event(), mode).await?,
            status: status_publisher(&session, keys.status(NODE), mode).await?,
        };
        let token = session
            .liveliness()
            .declare_token(keys.alive(NODE))
            .await
            .map_err(zenoh_error)?;
        Ok(Self {
            session,
            mouths,
            subscribers,
            token,
        })
    }

    /// The session, for others who declare something on it.
    pub(super) fn session(&self) -> Session {
        self.session.clone()
    }

    /// The endpoints that edges can connect to, with the ports that were really taken.
    pub(super) async fn locators(&self) -> Vec<String> {
        self.session
            .info()
            .locators()
            .await
            .iter()
            .map(ToString::to_string)
            .collect()
    }

    /// Starts the tasks that carry messages to and from the loop.
    pub(super) fn spawn(self, tasks: &TaskTracker, stop: &CancellationToken, ear: &Ear) -> Ends {
        let (heard_tx, heard) = mpsc::channel(QUEUE);
        for (topic, inbox) in self.subscribers {
            let (ear, heard_tx) = (ear.clone(), heard_tx.clone());
            tasks.spawn(listen(topic, inbox, ear, heard_tx, stop.clone()));
        }
        // Lock-step has at most one box set per viewpoint, one pose set, one decision, one set of events and a
        // few statuses
        // under way.
        let (say, said) = mpsc::channel(4 * (self.mouths.boxes.len() + 4));
        let (matched_tx, matched) = tokio::sync::watch::channel(false);
        let (mouths, own_ear) = (self.mouths, ear.clone());
        tasks.spawn_blocking(move || speak(&mouths, said, &own_ear, &matched_tx));
        Ends {
            heard,
            say,
            matched,
            session: self.session,
            _token: self.token,
        }
    }
}

/// What every message passes on its way in or out: the clock, and whoever listens in.
#[derive(Debug, Clone)]
pub(super) struct Ear {
    pub(super) clock: VenueClock,
    pub(super) tap: TapHandle,
    /// Names of the viewpoints, by index.
    names: Arc<[String]>,
    venue_hash: Arc<str>,
}

impl Ear {
    pub(super) fn new(venue: &Venue, clock: VenueClock, tap: TapHandle) -> Self {
        let names = venue.viewpoints.iter().map(|v| v.name.clone());
        Self {
            clock,
            tap,
            names: names.collect(),
            venue_hash: venue.hashes.venue.as_str().into(),
        }
    }

    /// Whether who may publish under `key` may speak for `viewpoint`.
    fn may_speak(&self, key: &str, viewpoint: ViewpointIndex) -> bool {
        let name = self.names.get(usize::from(viewpoint.0));
        name.is_some_and(|name| key.rsplit('/').next() == Some(name))
    }

    /// Whether who may publish under `key` may say `status`. Who holds another venue file may count its
    /// viewpoints in another way: it is refused for that, by name.
    fn may_say(&self, key: &str, status: &Status) -> bool {
        let index = self.names.iter().position(|name| *name == status.node);
        let same_index = status.viewpoint.map(|v| usize::from(v.0)) == index;
        key.rsplit('/').next() == Some(&status.node)
            && (same_index || status.venue_hash != *self.venue_hash)
    }

    fn received(&self, key: &str, bytes: &[u8]) -> Arrival {
        let at_us = self.clock.now_us();
        self.tap.received(TapMessage { key, bytes, at_us });
        Arrival {
            bytes: bytes.len() as u64,
            at_us,
        }
    }

    fn published(&self, key: &str, bytes: &[u8]) {
        let at_us = self.clock.now_us();
        self.tap.published(TapMessage { key, bytes, at_us });
    }
}

/// The loop's ends of the queues to and from the wire.
pub(super) struct Ends {
    /// What comes in.
    pub(super) heard: mpsc::Receiver<Heard>,
    /// What goes out; bounded, see [`Link::spawn`].
    pub(super) say: mpsc::Sender<Said>,
    /// Whether every viewpoint listens for its boxes.
    pub(super) matched: tokio::sync::watch::Receiver<bool>,
    session: Session,
    _token: LivelinessToken,
}

impl Ends {
    /// The open session.
    pub(super) fn session(&self) -> Session {
        self.session.clone()
    }

    /// Lets the publisher finish what is queued, then closes the session.
    pub(super) async fn close(self, tasks: &TaskTracker, stop: &CancellationToken) {
        drop(self.say);
        drop(self.heard);
        stop.cancel();
        tasks.close();
        tasks.wait().await;
        if let Err(error) = self.session.close().await {
            warn!(%error, "the session did not close well");
        }
    }
}

async fn publisher(
    session: &Session,
    key: String,
    mode: Mode,
) -> anyhow::Result<Publisher<'static>> {
    declare(session, key, mode, Reliability::BestEffort).await
}

/// Statuses and events are said once: a lost one would be missed.
async fn status_publisher(
    session: &Session,
    key: String,
    mode: Mode,
) -> anyhow::Result<Publisher<'static>> {
    declare(session, key, mode, Reliability::Reliable).await
}

async fn declare(
    session: &Session,
    key: String,
    mode: Mode,
    live: Reliability,
) -> anyhow::Result<Publisher<'static>> {
    let (congestion, reliability) = match mode {
        Mode::LockStep => (CongestionControl::Block, Reliability::Reliable),
        Mode::Live => (CongestionControl::Drop, live),
    };
    let declared = session
        .declare_publisher(key.clone())
        .congestion_control(congestion)
        .reliability(reliability)
        .priority(Priority::RealTime)
        .express(true);
    declared
        .await
        .map_err(zenoh_error)
        .with_context(|| format!("declaring the publisher of {key}"))
}

/// Task: one subscription, decoded, to the loop.
async fn listen(
    topic: Topic,
    inbox: Inbox,
    ear: Ear,
    heard: mpsc::Sender<Heard>,
    stop: CancellationToken,
) {
    loop {
        let sample = tokio::select! {
            sample = inbox.next() => sample,
            () = stop.cancelled() => return,
        };
        let Some(sample) = sample else { return };
        if heard.send(read(topic, &sample, &ear)).await.is_err() {
            return;
        }
    }
}

fn read(topic: Topic, sample: &Sample, ear: &Ear) -> Heard {
    let key = sample.key_expr().as_str();
    if let Topic::Alive = topic {
        let node = key.rsplit('/').next().unwrap_or(key).to_owned();
        let presence = match sample.kind() {
            SampleKind::Put => Presence::There,
            SampleKind::Delete => Presence::Gone,
        };
        return Heard::Alive(node, presence);
    }
    let payload = sample.payload().to_bytes();
    let arrival = ear.received(key, &payload);
    let own = |viewpoint| {
        let may = ear.may_speak(key, viewpoint);
        may.then_some(())
            .ok_or(WireError::Invalid("under the key of another viewpoint"))
    };
    let heard = match topic {
        Topic::Patches => wire::decode(&payload)
            .and_then(|set: PatchSet| own(set.viewpoint).map(|()| Heard::Patches(set, arrival))),
        Topic::Sightings => wire::decode(&payload).and_then(|set: SightingSet| {
            own(set.viewpoint).map(|()| Heard::Sightings(set, arrival))
        }),
        Topic::Statuses | Topic::Alive => wire::decode(&payload).and_then(|status| {
            let may = ear.may_say(key, &status);
            may.then(|| Heard::Status(Box::new(status)))
                .ok_or(WireError::Invalid("under the key of another node"))
        }),
    };
    heard.unwrap_or_else(|error| {
        debug!(%key, %error, "message not readable");
        Heard::Unreadable(key.to_owned())
    })
}

/// Thread, as Zenoh blocks it while the network is congested: everything that fusion says, in order; ends when the loop drops its end of the queue.
fn speak(
    mouths: &Mouths,
    mut said: mpsc::Receiver<Said>,
    ear: &Ear,
    matched: &tokio::sync::watch::Sender<bool>,
) {
    while let Some(message) = said.blocking_recv() {
        let (publisher, bytes) = match message {
            Said::Boxes(viewpoint, bytes) => (mouths.boxes.get(viewpoint), bytes),
            Said::Poses(bytes) => (Some(&mouths.poses), bytes),
            Said::Smooth(bytes) => (Some(&mouths.smooth), bytes),
            Said::Decision(bytes) => (Some(&mouths.decisions), bytes),
            Said::Events(bytes) => (Some(&mouths.events), bytes),
            Said::Status(bytes) => {
                // Statuses go out several times a second until the start: the moment to look.
                matched.send_replace(all_match(&mouths.boxes));
                (Some(&mouths.status), bytes)
            }
        };
        let Some(publisher) = publisher else { continue };
        ear.published(publisher.key_expr().as_str(), &bytes);
        if let Err(error) = publisher.put(bytes).wait() {
            warn!(key = %publisher.key_expr(), %error, "not sent");
        }
    }
}

fn all_match(publishers: &[Publisher<'static>]) -> bool {
    for publisher in publishers {
        if !publisher
            .matching_status()
            .wait()
            .is_ok_and(|status| status.matching())
        {
            return false;
        }
    }
    true
}

#[cfg(test)]
#[path = "link_tests.rs"]
mod tests;
