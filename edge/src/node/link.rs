//! The edge's side of the wire: one Zenoh client that connects to fusion, and tries again until it is there.
//!
//! Everything is reliable and blocks, at one priority: lock-step can wait, but must not lose or
//! reorder. Nothing is scouted for; the endpoints are in the venue file.

use anyhow::{Context as _, anyhow};
use farfield_proto::key::Keys;
use farfield_proto::message::{BoxSet, Status};
use farfield_proto::transport::{EdgeTransport, FUSION};
use farfield_proto::wire;
use tokio::sync::{mpsc, watch};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tracing::{debug, warn};
use zenoh::handlers::{FifoChannel, FifoChannelHandler};
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::{CongestionControl, Priority};
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait as _};

use super::live::Mouths;

/// Messages that wait between Zenoh and the loop; lock-step has one tick under way.
const QUEUE: usize = 64;

/// What the network tells the loop.
#[derive(Debug)]
pub(super) enum Heard {
    /// What to do at a tick.
    Boxes(BoxSet),
    /// Fusion says how it is.
    Fusion(Box<Status>),
    /// Fusion has left.
    FusionGone,
    /// A message that cannot be read, by its key.
    Unreadable(String),
}

/// What the edge says.
#[derive(Debug)]
pub(super) enum Said {
    /// Patches.
    Patches(Vec<u8>),
    /// Sightings.
    Sightings(Vec<u8>),
    /// How the edge is.
    Status(Vec<u8>),
}

/// The open session with all that is declared on it.
pub(super) struct Link {
    session: Session,
    patches: Publisher<'static>,
    sightings: Publisher<'static>,
    status: Publisher<'static>,
    subscribers: Vec<(Topic, Subscriber<FifoChannelHandler<Sample>>)>,
    token: LivelinessToken,
}

#[derive(Debug, Clone, Copy)]
enum Topic {
    Boxes,
    Fusion,
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

fn config(transport: &EdgeTransport<'_>) -> anyhow::Result<zenoh::Config> {
    let mut config = zenoh::Config::default();
    for (key, value) in transport.settings() {
        config
            .insert_json5(&key, &value)
            .map_err(zenoh_error)
            .with_context(|| format!("setting {key} to {value}"))?;
    }
    Ok(config)
}

/// A session with fusion, waited for as long as it takes.
pub(super) async fn connect(transport: &EdgeTransport<'_>) -> anyhow::Result<Session> {
    let config = config(transport)?;
    // Opening blocks its thread until fusion is there; only so can the wait be called off.
    let session = tokio::task::spawn_blocking(|| zenoh::open(config).wait()).await;
    let session = session.context("opening the session")?.map_err(zenoh_error);
    session.with_context(|| format!("connecting to {}", transport.connect.join(", ")))
}

impl Link {
    /// Connects as `transport` says, waiting for fusion as long as it takes, and declares what the
    /// viewpoint needs.
    pub(super) async fn open(
        transport: &EdgeTransport<'_>,
        viewpoint: &str,
    ) -> anyhow::Result<Self> {
        let session = connect(transport).await?;
        let keys = Keys::new(transport.venue);
        let subscribers = vec![
            (
                Topic::Boxes,
                subscriber(&session, keys.boxes(viewpoint)).await?,
            ),
            (
                Topic::Fusion,
                subscriber(&session, keys.status(FUSION)).await?,
            ),
            (
                Topic::Alive,
                liveliness(&session, keys.alive(FUSION)).await?,
            ),
        ];
        let patches = publisher(&session, keys.patch(viewpoint)).await?;
        let sightings = publisher(&session, keys.sighting(viewpoint)).await?;
        let status = publisher(&session, keys.status(viewpoint)).await?;
        let token = session
            .liveliness()
            .declare_token(keys.alive(viewpoint))
            .await
            .map_err(zenoh_error)?;
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
    pub(super) fn spawn(self, tasks: &TaskTracker, leave: &CancellationToken) -> Ends {
        let (heard_tx, heard) = mpsc::channel(QUEUE);
        for (topic, subscriber) in self.subscribers {
            tasks.spawn(listen(topic, subscriber, heard_tx.clone(), leave.clone()));
        }
        let (say, said) = mpsc::channel(QUEUE);
        let (matched_tx, matched) = watch::channel(false);
        tasks.spawn_blocking(move || {
            speak(
                &self.patches,
                &self.sightings,
                &self.status,
                said,
                &matched_tx,
            );
        });
        Ends {
            heard,
            say,
            matched,
            session: self.session,
            _token: self.token,
        }
    }
}

/// The loop's ends of the queues to and from the wire.
pub(super) struct Ends {
    /// What comes in.
    pub(super) heard: mpsc::Receiver<Heard>,
    /// What goes out.
    pub(super) say: mpsc::Sender<Said>,
    /// Whether fusion listens for patches and sightings.
    pub(super) matched: watch::Receiver<bool>,
    session: Session,
    _token: LivelinessToken,
}

impl Ends {
    /// The open session.
    pub(super) fn session(&self) -> Session {
        self.session.clone()
    }

    /// What a live edge publishes on, of the viewpoint of `venue`.
    pub(super) async fn mouths(&self, venue: &str, viewpoint: &str) -> anyhow::Result<Mouths> {
        Mouths::declare(&self.session, venue, viewpoint).await
    }

    /// Lets the publisher finish what is queued, then closes the session.
    pub(super) async fn close(self, tasks: &TaskTracker, leave: &CancellationToken) {
        drop((self.say, self.heard));
        leave.cancel();
        tasks.close();
        tasks.wait().await;
        if let Err(error) = self.session.close().await {
            warn!(%error, "the session did not close well");
        }
    }
}

async fn publisher(session: &Session, key: String) -> anyhow::Result<Publisher<'static>> {
    let declared = session
        .declare_publisher(key.clone())
        .congestion_control(CongestionControl::Block)
        .priority(Priority::RealTime)
        .express(true);
    declared
        .await
        .map_err(zenoh_error)
        .with_context(|| format!("declaring the publisher of {key}"))
}

async fn subscriber(
    session: &Session,
    key: String,
) -> anyhow::Result<Subscriber<FifoChannelHandler<Sample>>> {
    let declared = session
        .declare_subscriber(key.clone())
        .with(FifoChannel::new(QUEUE))
        .await;
    declared
        .map_err(zenoh_error)
        .with_context(|| format!("subscribing to {key}"))
}

async fn liveliness(
    session: &Session,
    key: String,
) -> anyhow::Result<Subscriber<FifoChannelHandler<Sample>>> {
    let declared = session
        .liveliness()
        .declare_subscriber(key.clone())
        .history(true)
        .with(FifoChannel::new(QUEUE))
        .await;
    declared
        .map_err(zenoh_error)
        .with_context(|| format!("watching {key}"))
}

/// Task: one subscription, decoded, to the loop.
async fn listen(
    topic: Topic,
    subscriber: Subscriber<FifoChannelHandler<Sample>>,
    heard: mpsc::Sender<Heard>,
    leave: CancellationToken,
) {
    loop {
        let sample = tokio::select! {
            sample = subscriber.recv_async() => sample,
            () = leave.cancelled() => return,
        };
        let Ok(sample) = sample else { return };
        if let Some(message) = read(topic, &sample)
            && heard.send(message).await.is_err()
        {
            return;
        }
    }
}

fn read(topic: Topic, sample: &Sample) -> Option<Heard> {
    let key = sample.key_expr().as_str();
    let payload = sample.payload().to_bytes();
    let heard = match topic {
        Topic::Boxes => wire::decode(&payload).map(Heard::Boxes),
        Topic::Fusion => wire::decode(&payload).map(|status| Heard::Fusion(Box::new(status))),
        Topic::Alive => return (sample.kind() == SampleKind::Delete).then_some(Heard::FusionGone),
    };
    Some(heard.unwrap_or_else(|error| {
        debug!(%key, %error, "message not readable");
        Heard::Unreadable(key.to_owned())
    }))
}

/// Thread, as Zenoh blocks it while the network is congested: everything that the edge says, in order; ends when the loop and the pipeline drop their ends of the queue.
fn speak(
    patches: &Publisher<'static>,
    sightings: &Publisher<'static>,
    status: &Publisher<'static>,
    mut said: mpsc::Receiver<Said>,
    matched: &watch::Sender<bool>,
) {
    while let Some(message) = said.blocking_recv() {
        let (publisher, bytes) = match message {
            Said::Patches(bytes) => (patches, bytes),
            Said::Sightings(bytes) => (sightings, bytes),
            Said::Status(bytes) => {
                // Statuses go out several times a second until the start: the moment to look.
                matched.send_replace(is_matched(patches) && is_matched(sightings));
                (status, bytes)
            }
        };
        if let Err(error) = publisher.put(bytes).wait() {
            warn!(key = %publisher.key_expr(), %error, "not sent");
        }
    }
}

fn is_matched(publisher: &Publisher<'static>) -> bool {
    publisher
        .matching_status()
        .wait()
        .is_ok_and(|status| status.matching())
}

#[cfg(test)]
#[path = "link_tests.rs"]
mod tests;
