//! Fusion's side of the wire: one Zenoh router that all edges connect to.
//!
//! In lock-step everything is reliable and blocks, at one priority: it can wait, but must not lose or
//! reorder. Live, boxes and poses are best effort, and nothing blocks. Nothing is scouted for; the
//! endpoints are in the venue file.

use std::sync::Arc;

use farfield_node::clock::VenueClock;
use farfield_node::endpoints::Reach;
use farfield_node::session::{self, Delivery, declare_alive, has_listener};
use farfield_proto::id::ViewpointIndex;
use farfield_proto::key::Keys;
use farfield_proto::message::{PatchSet, SightingSet, Status};
use farfield_proto::transport::{FUSION, FusionTransport};
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

use super::mode::Mode;
use super::subscribers::{Subscription, liveliness, subscriber};
use super::wiretap::{CopiedMessage, WiretapHandle};

/// Messages that wait for the loop; when it is full, what has come waits in its subscription.
const QUEUE: usize = 256;

/// What the network tells the loop.
#[derive(Debug)]
pub(in crate::node) enum Incoming {
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
pub(in crate::node) struct Arrival {
    /// The bytes it took.
    pub(in crate::node) bytes: u64,
    /// When, microseconds since 1970.
    pub(in crate::node) at_us: i64,
}

/// Whether a node is there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::node) enum Presence {
    /// Its liveliness token is there.
    There,
    /// Its token went away with its session.
    Gone,
}

/// What fusion says, and to whom.
#[derive(Debug)]
pub(in crate::node) enum Outgoing {
    /// Boxes for the viewpoint of this index.
    Boxes(usize, Vec<u8>),
    /// The persons of a tick.
    Poses(Vec<u8>),
    /// The persons of a tick, as the fixed-lag smoother sees them.
    Smooth(Vec<u8>),
    /// What was used for a tick, for whoever records elsewhere.
    Decision(Vec<u8>),
    /// How fusion is.
    Status(Vec<u8>),
}

/// The open session with all that is declared on it.
pub(in crate::node) struct Link {
    session: Session,
    publishers: Publishers,
    subscribers: Vec<(Topic, Subscription)>,
    token: LivelinessToken,
}

/// All that fusion publishes on.
struct Publishers {
    boxes: Vec<Publisher<'static>>,
    poses: Publisher<'static>,
    smooth: Publisher<'static>,
    decisions: Publisher<'static>,
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
    /// Listens where `reach` says and declares everything that the edges of `venue` need.
    pub(in crate::node) async fn open(
        venue: &Venue,
        reach: &Reach,
        mode: Mode,
    ) -> anyhow::Result<Self> {
        let viewpoints: Vec<&str> = venue.viewpoints.iter().map(|v| v.name.as_str()).collect();
        let transport = FusionTransport {
            venue: &venue.name,
            viewpoints: &viewpoints,
            listen: &reach.endpoints,
            identity: reach.identity.as_ref(),
        };
        let session = session::listen(&transport).await?;
        let keys = Keys::new(&venue.name);
        let (delivery, of_status) = match mode {
            Mode::LockStep => (Delivery::Blocking, Delivery::Blocking),
            // Statuses are said once a second: a lost one would be missed.
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
        let publishers = Publishers {
            boxes,
            poses: publisher(keys.pose(), delivery).await?,
            smooth: publisher(keys.smooth(), delivery).await?,
            decisions: publisher(keys.decision(), delivery).await?,
            status: publisher(keys.status(FUSION), of_status).await?,
        };
        let token = declare_alive(&session, keys.alive(FUSION)).await?;
        Ok(Self {
            session,
            publishers,
            subscribers,
            token,
        })
    }

    /// The session, for others who declare something on it.
    pub(in crate::node) fn session(&self) -> Session {
        self.session.clone()
    }

    /// The endpoints that edges can connect to, with the ports that were really taken.
    pub(in crate::node) async fn locators(&self) -> Vec<String> {
        self.session
            .info()
            .locators()
            .await
            .iter()
            .map(ToString::to_string)
            .collect()
    }

    /// Starts the tasks that carry messages to and from the loop.
    pub(in crate::node) fn spawn(
        self,
        tasks: &TaskTracker,
        stop: &CancellationToken,
        interceptor: &Interceptor,
    ) -> Ends {
        let (incoming_tx, incoming) = mpsc::channel(QUEUE);
        for (topic, subscription) in self.subscribers {
            let (interceptor, incoming_tx) = (interceptor.clone(), incoming_tx.clone());
            tasks.spawn(listen(
                topic,
                subscription,
                interceptor,
                incoming_tx,
                stop.clone(),
            ));
        }
        // Lock-step has at most one box set per viewpoint, one pose set, one decision and a few statuses
        // under way.
        let (outgoing_tx, outgoing) = mpsc::channel(4 * (self.publishers.boxes.len() + 4));
        let (matched_tx, matched) = tokio::sync::watch::channel(false);
        let (publishers, own_interceptor) = (self.publishers, interceptor.clone());
        tasks.spawn_blocking(move || speak(&publishers, outgoing, &own_interceptor, &matched_tx));
        Ends {
            incoming,
            outgoing: outgoing_tx,
            matched,
            session: self.session,
            _token: self.token,
        }
    }
}

/// What every message passes on its way in or out: the clock, and whoever listens in.
#[derive(Debug, Clone)]
pub(in crate::node) struct Interceptor {
    pub(in crate::node) clock: VenueClock,
    pub(in crate::node) wiretap: WiretapHandle,
    /// Names of the viewpoints, by index.
    names: Arc<[String]>,
    venue_hash: Arc<str>,
}

impl Interceptor {
    pub(in crate::node) fn new(venue: &Venue, clock: VenueClock, wiretap: WiretapHandle) -> Self {
        let names = venue.viewpoints.iter().map(|v| v.name.clone());
        Self {
            clock,
            wiretap,
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
        self.wiretap.received(CopiedMessage { key, bytes, at_us });
        Arrival {
            bytes: bytes.len() as u64,
            at_us,
        }
    }

    fn published(&self, key: &str, bytes: &[u8]) {
        let at_us = self.clock.now_us();
        self.wiretap.published(CopiedMessage { key, bytes, at_us });
    }
}

/// The loop's ends of the queues to and from the wire.
pub(in crate::node) struct Ends {
    /// What comes in.
    pub(in crate::node) incoming: mpsc::Receiver<Incoming>,
    /// What goes out; bounded, see [`Link::spawn`].
    pub(in crate::node) outgoing: mpsc::Sender<Outgoing>,
    /// Whether every viewpoint listens for its boxes.
    pub(in crate::node) matched: tokio::sync::watch::Receiver<bool>,
    session: Session,
    _token: LivelinessToken,
}

impl Ends {
    /// The open session.
    pub(in crate::node) fn session(&self) -> Session {
        self.session.clone()
    }

    /// Lets the publisher finish what is queued, then closes the session.
    pub(in crate::node) async fn close(self, tasks: &TaskTracker, stop: &CancellationToken) {
        drop(self.outgoing);
        drop(self.incoming);
        stop.cancel();
        tasks.close();
        tasks.wait().await;
        session::close(&self.session).await;
    }
}

/// Task: one subscription, decoded, to the loop.
async fn listen(
    topic: Topic,
    subscription: Subscription,
    interceptor: Interceptor,
    incoming: mpsc::Sender<Incoming>,
    stop: CancellationToken,
) {
    loop {
        let sample = tokio::select! {
            sample = subscription.next() => sample,
            () = stop.cancelled() => return,
        };
        let Some(sample) = sample else { return };
        if incoming
            .send(read(topic, &sample, &interceptor))
            .await
            .is_err()
        {
            return;
        }
    }
}

fn read(topic: Topic, sample: &Sample, interceptor: &Interceptor) -> Incoming {
    let key = sample.key_expr().as_str();
    if let Topic::Alive = topic {
        let node = key.rsplit('/').next().unwrap_or(key).to_owned();
        let presence = match sample.kind() {
            SampleKind::Put => Presence::There,
            SampleKind::Delete => Presence::Gone,
        };
        return Incoming::Alive(node, presence);
    }
    let payload = sample.payload().to_bytes();
    let arrival = interceptor.received(key, &payload);
    let own = |viewpoint| {
        let may = interceptor.may_speak(key, viewpoint);
        may.then_some(())
            .ok_or(WireError::Invalid("under the key of another viewpoint"))
    };
    let incoming = match topic {
        Topic::Patches => wire::decode(&payload)
            .and_then(|set: PatchSet| own(set.viewpoint).map(|()| Incoming::Patches(set, arrival))),
        Topic::Sightings => wire::decode(&payload).and_then(|set: SightingSet| {
            own(set.viewpoint).map(|()| Incoming::Sightings(set, arrival))
        }),
        Topic::Statuses | Topic::Alive => wire::decode(&payload).and_then(|status| {
            let may = interceptor.may_say(key, &status);
            may.then(|| Incoming::Status(Box::new(status)))
                .ok_or(WireError::Invalid("under the key of another node"))
        }),
    };
    incoming.unwrap_or_else(|error| {
        debug!(%key, %error, "message not readable");
        Incoming::Unreadable(key.to_owned())
    })
}

/// Thread, as Zenoh blocks it while the network is congested: everything that fusion says, in order; ends when the loop drops its end of the queue.
fn speak(
    publishers: &Publishers,
    mut outgoing: mpsc::Receiver<Outgoing>,
    interceptor: &Interceptor,
    matched: &tokio::sync::watch::Sender<bool>,
) {
    while let Some(message) = outgoing.blocking_recv() {
        let (publisher, bytes) = match message {
            Outgoing::Boxes(viewpoint, bytes) => (publishers.boxes.get(viewpoint), bytes),
            Outgoing::Poses(bytes) => (Some(&publishers.poses), bytes),
            Outgoing::Smooth(bytes) => (Some(&publishers.smooth), bytes),
            Outgoing::Decision(bytes) => (Some(&publishers.decisions), bytes),
            Outgoing::Status(bytes) => {
                // Statuses go out several times a second until the start: the moment to look.
                matched.send_replace(publishers.boxes.iter().all(has_listener));
                (Some(&publishers.status), bytes)
            }
        };
        let Some(publisher) = publisher else { continue };
        interceptor.published(publisher.key_expr().as_str(), &bytes);
        if let Err(error) = publisher.put(bytes).wait() {
            warn!(key = %publisher.key_expr(), %error, "not sent");
        }
    }
}

#[cfg(test)]
#[path = "link_tests.rs"]
mod tests;
