//! Fusion's side of the wire: one Zenoh router that all edges connect to.
//!
//! In lock-step everything is reliable and blocks, at one priority: it can wait, but must not lose or
//! reorder. Live, boxes and poses are best effort, and nothing blocks. Nothing is scouted for; the
//! endpoints are in the venue file.

use std::sync::Arc;

use farfield_node::clock::VenueClock;
use farfield_node::session::{self, Delivery, declare_alive, has_listener};
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
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait as _};

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
        let session = session::listen(&transport).await?;
        let keys = Keys::new(&venue.name);
        let (delivery, lossless) = match mode {
            Mode::LockStep => (Delivery::Blocking, Delivery::Blocking),
            // Statuses and events are said once: a lost one would be missed.
            Mode::Live => (Delivery::BestEffort, Delivery::Reliable),
        };
        let publisher = |key, delivery| session::publisher(&session, key, delivery);
        let mut boxes = Vec::new();
        for viewpoint in &venue.viewpoints {
            boxes.push(publisher(keys.boxes(&viewpoint.name), delivery).await?);
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
            poses: publisher(keys.pose(), delivery).await?,
            smooth: publisher(keys.smooth(), delivery).await?,
            decisions: publisher(keys.decision(), delivery).await?,
            events: publisher(keys.event(), lossless).await?,
            status: publisher(keys.status(NODE), lossless).await?,
        };
        let token = declare_alive(&session, keys.alive(NODE)).await?;
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
        session::close(&self.session).await;
    }
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
                matched.send_replace(mouths.boxes.iter().all(has_listener));
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

#[cfg(test)]
#[path = "link_tests.rs"]
mod tests;
