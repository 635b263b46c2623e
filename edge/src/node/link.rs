//! The edge's side of the wire: one Zenoh client that connects to fusion, and tries again until it is there.
//!
//! Everything is reliable and blocks, at one priority: lock-step can wait, but must not lose or
//! reorder. Nothing is scouted for; the endpoints are in the venue file.

use std::sync::Arc;

use farfield_node::session::{
    self, Delivery, FifoSubscriber, declare_alive, has_listener, put_status,
};
use farfield_proto::key::Keys;
use farfield_proto::message::{BoxSet, Status};
use farfield_proto::transport::{EdgeTransport, FUSION};
use farfield_proto::wire::{self, SpokenVersion, WireError};
use tokio::sync::{mpsc, watch};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tracing::{debug, warn};
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Publisher;
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait as _};

/// Messages that wait between Zenoh and the loop; lock-step has one tick under way.
const QUEUE: usize = 64;

/// What the network tells the loop.
#[derive(Debug)]
pub(super) enum EdgeIncoming {
    /// What to do at a tick.
    Boxes(BoxSet),
    /// Fusion says how it is.
    Fusion(Box<Status>),
    /// Fusion has left.
    FusionGone,
    /// A message that cannot be read, by its key, and why.
    Unreadable(String, WireError),
}

/// What the edge says.
#[derive(Debug)]
pub(super) enum EdgeOutgoing {
    /// Patches.
    Patches(Vec<u8>),
    /// Sightings.
    Sightings(Vec<u8>),
    /// How the edge is.
    Status(Vec<u8>),
}

/// The open session with all that is declared on it.
pub(super) struct EdgeSession {
    session: Session,
    patches: Publisher<'static>,
    sightings: Publisher<'static>,
    status: Publisher<'static>,
    subscribers: Vec<(EdgeTopic, FifoSubscriber)>,
    token: LivelinessToken,
}

#[derive(Debug, Clone, Copy)]
enum EdgeTopic {
    Boxes,
    Fusion,
    Alive,
}

impl EdgeSession {
    /// Connects as `transport` says, waiting for fusion as long as it takes, and declares what the
    /// viewpoint needs.
    pub(super) async fn open(
        transport: &EdgeTransport<'_>,
        viewpoint: &str,
    ) -> anyhow::Result<Self> {
        let session = session::connect(transport).await?;
        let keys = Keys::new(transport.venue);
        let subscribers = vec![
            (
                EdgeTopic::Boxes,
                session::subscriber(&session, keys.boxes(viewpoint), QUEUE).await?,
            ),
            (
                EdgeTopic::Fusion,
                session::subscriber(&session, keys.status(FUSION), QUEUE).await?,
            ),
            (
                EdgeTopic::Alive,
                session::liveliness(&session, keys.alive(FUSION), QUEUE).await?,
            ),
        ];
        let publisher = |key| session::publisher(&session, key, Delivery::Blocking);
        let patches = publisher(keys.patch(viewpoint)).await?;
        let sightings = publisher(keys.sighting(viewpoint)).await?;
        let status = publisher(keys.status(viewpoint)).await?;
        let token = declare_alive(&session, keys.alive(viewpoint)).await?;
        Ok(Self {
            session,
            patches,
            sightings,
            status,
            subscribers,
            token,
        })
    }

    /// Starts the tasks that carry messages to and from the loop.
    pub(super) fn spawn(self, tasks: &TaskTracker, leave: &CancellationToken) -> EdgeEnds {
        let (incoming_tx, incoming) = mpsc::channel(QUEUE);
        let spoken = Arc::new(SpokenVersion::default());
        for (topic, subscriber) in self.subscribers {
            tasks.spawn(listen(
                topic,
                subscriber,
                incoming_tx.clone(),
                Arc::clone(&spoken),
                leave.clone(),
            ));
        }
        let (outgoing_tx, outgoing) = mpsc::channel(QUEUE);
        let (matched_tx, matched) = watch::channel(false);
        tasks.spawn_blocking(move || {
            speak(
                &self.patches,
                &self.sightings,
                &self.status,
                outgoing,
                &matched_tx,
            );
        });
        EdgeEnds {
            incoming,
            outgoing: outgoing_tx,
            matched,
            spoken,
            session: self.session,
            _token: self.token,
        }
    }
}

/// The loop's ends of the queues to and from the wire.
pub(super) struct EdgeEnds {
    /// What comes in.
    pub(super) incoming: mpsc::Receiver<EdgeIncoming>,
    /// What goes out.
    pub(super) outgoing: mpsc::Sender<EdgeOutgoing>,
    /// Whether fusion listens for patches and sightings.
    pub(super) matched: watch::Receiver<bool>,
    /// The version of messages in which fusion is spoken to.
    pub(super) spoken: Arc<SpokenVersion>,
    session: Session,
    _token: LivelinessToken,
}

impl EdgeEnds {
    /// The open session.
    pub(super) fn session(&self) -> Session {
        self.session.clone()
    }

    /// Lets the publisher finish what is queued, then closes the session.
    pub(super) async fn close(self, tasks: &TaskTracker, leave: &CancellationToken) {
        drop((self.outgoing, self.incoming));
        leave.cancel();
        tasks.close();
        tasks.wait().await;
        session::close(&self.session).await;
    }
}

/// Task: one subscription, decoded, to the loop.
async fn listen(
    topic: EdgeTopic,
    subscriber: FifoSubscriber,
    incoming: mpsc::Sender<EdgeIncoming>,
    spoken: Arc<SpokenVersion>,
    leave: CancellationToken,
) {
    loop {
        let sample = tokio::select! {
            sample = subscriber.recv_async() => sample,
            () = leave.cancelled() => return,
        };
        let Ok(sample) = sample else { return };
        if let Some(message) = read(topic, &sample, &spoken)
            && incoming.send(message).await.is_err()
        {
            return;
        }
    }
}

fn read(topic: EdgeTopic, sample: &Sample, spoken: &SpokenVersion) -> Option<EdgeIncoming> {
    let key = sample.key_expr().as_str();
    let payload = sample.payload().to_bytes();
    if let EdgeTopic::Fusion = topic {
        spoken.hear(&payload, session::reads_at_most(sample));
    }
    let incoming = match topic {
        EdgeTopic::Boxes => wire::decode(&payload).map(EdgeIncoming::Boxes),
        EdgeTopic::Fusion => {
            wire::decode(&payload).map(|status| EdgeIncoming::Fusion(Box::new(status)))
        }
        EdgeTopic::Alive => {
            return (sample.kind() == SampleKind::Delete).then_some(EdgeIncoming::FusionGone);
        }
    };
    Some(incoming.unwrap_or_else(|error| {
        debug!(%key, %error, "message not readable");
        EdgeIncoming::Unreadable(key.to_owned(), error)
    }))
}

/// Thread, as Zenoh blocks it while the network is congested: everything that the edge says, in order; ends when the loop and the pipeline drop their ends of the queue.
fn speak(
    patches: &Publisher<'static>,
    sightings: &Publisher<'static>,
    status: &Publisher<'static>,
    mut outgoing: mpsc::Receiver<EdgeOutgoing>,
    matched: &watch::Sender<bool>,
) {
    while let Some(message) = outgoing.blocking_recv() {
        let (publisher, sent) = match message {
            EdgeOutgoing::Patches(bytes) => (patches, patches.put(bytes).wait()),
            EdgeOutgoing::Sightings(bytes) => (sightings, sightings.put(bytes).wait()),
            EdgeOutgoing::Status(bytes) => {
                // Statuses go out several times a second until the start: the moment to look.
                matched.send_replace(has_listener(patches) && has_listener(sightings));
                (status, put_status(status, bytes))
            }
        };
        if let Err(error) = sent {
            warn!(key = %publisher.key_expr(), %error, "not sent");
        }
    }
}

#[cfg(test)]
#[path = "link_tests.rs"]
mod tests;
