//! The edge's connection to fusion: one Zenoh client that retries until it is connected.
//!
//! All messages are reliable, blocking, and of one priority: lock-step can wait, but must not lose
//! or reorder messages. There is no scouting; the endpoints are in the venue file.

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

/// Messages between Zenoh and the loop. In lock-step only one tick is in progress.
const QUEUE: usize = 64;

/// A message from the network to the loop.
#[derive(Debug)]
pub(super) enum EdgeIncoming {
    /// Boxes of a tick.
    Boxes(BoxSet),
    /// Fusion's status.
    Fusion(Box<Status>),
    /// Fusion has disconnected.
    FusionGone,
    /// An unreadable message: its key and the error.
    Unreadable(String, WireError),
}

/// A message from the edge.
#[derive(Debug)]
pub(super) enum EdgeOutgoing {
    /// Patches.
    Patches(Vec<u8>),
    /// Sightings.
    Sightings(Vec<u8>),
    /// The edge's status.
    Status(Vec<u8>),
}

/// The open session with its publishers and subscribers.
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
    /// Connects with `transport`, waits for fusion without a limit, and declares the viewpoint's
    /// publishers and subscribers.
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

    /// Starts the tasks between the network and the loop.
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

/// The loop's ends of the queues.
pub(super) struct EdgeEnds {
    /// Received messages.
    pub(super) incoming: mpsc::Receiver<EdgeIncoming>,
    /// Messages to send.
    pub(super) outgoing: mpsc::Sender<EdgeOutgoing>,
    /// Whether fusion subscribes to patches and sightings.
    pub(super) matched: watch::Receiver<bool>,
    /// The message version that fusion reads.
    pub(super) spoken: Arc<SpokenVersion>,
    session: Session,
    _token: LivelinessToken,
}

impl EdgeEnds {
    /// The open session.
    pub(super) fn session(&self) -> Session {
        self.session.clone()
    }

    /// Sends the queued messages, then closes the session.
    pub(super) async fn close(self, tasks: &TaskTracker, leave: &CancellationToken) {
        drop((self.outgoing, self.incoming));
        leave.cancel();
        tasks.close();
        tasks.wait().await;
        session::close(&self.session).await;
    }
}

/// Task: decodes the messages of one subscription for the loop.
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
        spoken.note_status(&payload, session::reads_at_most(sample));
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

/// Thread: sends all messages of the edge in order. Zenoh blocks it while the network is congested.
/// It ends when the loop and the pipeline drop their ends of the queue.
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
                // Until the start, statuses are sent several times a second, so this is a good
                // place for the check.
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
