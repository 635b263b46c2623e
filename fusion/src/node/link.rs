//! Fusion's side of the wire: one Zenoh router that all edges connect to.
//!
//! Everything is reliable and blocks, at one priority: lock-step can wait, but must not lose or
//! reorder. Nothing is scouted for; the endpoints are in the venue file.

use std::time::Duration;

use anyhow::{Context as _, anyhow};
use farfield_proto::key::Keys;
use farfield_proto::message::{PatchSet, SightingSet, Status};
use farfield_proto::venue::Venue;
use farfield_proto::wire;
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tracing::{debug, warn};
use zenoh::handlers::{FifoChannel, FifoChannelHandler};
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::{CongestionControl, Priority};
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait as _};

/// Fusion's name among the nodes.
pub(super) const NODE: &str = "fusion";
/// After this long without a sign of life a silent node counts as gone.
const LEASE: Duration = Duration::from_secs(5);
/// Messages that wait between Zenoh and the loop; when full, Zenoh stops reading, and the edges wait.
const QUEUE: usize = 256;

/// What the network tells the loop.
#[derive(Debug)]
pub(super) enum Heard {
    /// Patches, and the bytes they took.
    Patches(PatchSet, u64),
    /// Sightings, and the bytes they took.
    Sightings(SightingSet, u64),
    /// A node says how it is.
    Status(Box<Status>),
    /// A node has joined or left.
    Alive(String, Presence),
    /// A message that cannot be read, by its key.
    Unreadable(String),
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
    /// How fusion is.
    Status(Vec<u8>),
}

/// The open session with all that is declared on it.
pub(super) struct Link {
    session: Session,
    boxes: Vec<Publisher<'static>>,
    poses: Publisher<'static>,
    status: Publisher<'static>,
    subscribers: Vec<(Topic, Subscriber<FifoChannelHandler<Sample>>)>,
    token: LivelinessToken,
}

#[derive(Debug, Clone, Copy)]
enum Topic {
    Patches,
    Sightings,
    Statuses,
    Alive,
}

#[expect(clippy::needless_pass_by_value, reason = "what `map_err` takes")]
fn zenoh_error(error: zenoh::Error) -> anyhow::Error {
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

fn config(listen: &[String]) -> anyhow::Result<zenoh::Config> {
    let endpoints = serde_json::to_string(listen)?;
    let lease = LEASE.as_millis().to_string();
    let mut config = zenoh::Config::default();
    let settings = [
        ("mode", "\"router\""),
        ("scouting/multicast/enabled", "false"),
        ("scouting/gossip/enabled", "false"),
        ("listen/endpoints", endpoints.as_str()),
        ("listen/exit_on_failure", "true"),
        ("transport/link/tx/lease", lease.as_str()),
        // A node that is busy for long must slow the others down, not be cut off.
        (
            "transport/link/tx/queue/congestion_control/block/wait_before_close",
            "60000000",
        ),
    ];
    for (key, value) in settings {
        config
            .insert_json5(key, value)
            .map_err(zenoh_error)
            .with_context(|| format!("setting {key} to {value}"))?;
    }
    Ok(config)
}

impl Link {
    /// Listens on `listen` and declares everything that the edges of `venue` need.
    pub(super) async fn open(venue: &Venue, listen: &[String]) -> anyhow::Result<Self> {
        let session = zenoh::open(config(listen)?).await.map_err(zenoh_error);
        let session = session.map_err(|error| {
            // Zenoh has no kind for it.
            let taken = error.to_string().contains("in use");
            let hint = if taken {
                "; choose another with --listen"
            } else {
                ""
            };
            anyhow!("listening on {}: {error:#}{hint}", listen.join(", "))
        })?;
        let keys = Keys::new(&venue.name);
        let mut boxes = Vec::new();
        for viewpoint in &venue.viewpoints {
            boxes.push(publisher(&session, keys.boxes(&viewpoint.name)).await?);
        }
        let subscribers = vec![
            (Topic::Patches, subscriber(&session, keys.patches()).await?),
            (
                Topic::Sightings,
                subscriber(&session, keys.sightings()).await?,
            ),
            (
                Topic::Statuses,
                subscriber(&session, keys.statuses()).await?,
            ),
            (Topic::Alive, liveliness(&session, keys.all_alive()).await?),
        ];
        let poses = publisher(&session, keys.pose()).await?;
        let status = publisher(&session, keys.status(NODE)).await?;
        let token = session
            .liveliness()
            .declare_token(keys.alive(NODE))
            .await
            .map_err(zenoh_error)?;
        Ok(Self {
            session,
            boxes,
            poses,
            status,
            subscribers,
            token,
        })
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
    pub(super) fn spawn(self, tasks: &TaskTracker, stop: &CancellationToken) -> Ends {
        let (heard_tx, heard) = mpsc::channel(QUEUE);
        for (topic, subscriber) in self.subscribers {
            tasks.spawn(listen(topic, subscriber, heard_tx.clone(), stop.clone()));
        }
        // Lock-step has at most one box set per viewpoint, one pose set and a few statuses under way.
        let (say, said) = mpsc::channel(4 * (self.boxes.len() + 4));
        let (matched_tx, matched) = tokio::sync::watch::channel(false);
        tasks.spawn_blocking(move || {
            speak(&self.boxes, &self.poses, &self.status, said, &matched_tx);
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
    /// What goes out; bounded, see [`Link::spawn`].
    pub(super) say: mpsc::Sender<Said>,
    /// Whether every viewpoint listens for its boxes.
    pub(super) matched: tokio::sync::watch::Receiver<bool>,
    session: Session,
    _token: LivelinessToken,
}

impl Ends {
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
    stop: CancellationToken,
) {
    loop {
        let sample = tokio::select! {
            sample = subscriber.recv_async() => sample,
            () = stop.cancelled() => return,
        };
        let Ok(sample) = sample else { return };
        if heard.send(read(topic, &sample)).await.is_err() {
            return;
        }
    }
}

fn read(topic: Topic, sample: &Sample) -> Heard {
    let key = sample.key_expr().as_str();
    let payload = sample.payload().to_bytes();
    let bytes = payload.len() as u64;
    let heard = match topic {
        Topic::Patches => wire::decode(&payload).map(|set| Heard::Patches(set, bytes)),
        Topic::Sightings => wire::decode(&payload).map(|set| Heard::Sightings(set, bytes)),
        Topic::Statuses => wire::decode(&payload).map(|status| Heard::Status(Box::new(status))),
        Topic::Alive => {
            let node = key.rsplit('/').next().unwrap_or(key).to_owned();
            Ok(Heard::Alive(
                node,
                if sample.kind() == SampleKind::Put {
                    Presence::There
                } else {
                    Presence::Gone
                },
            ))
        }
    };
    heard.unwrap_or_else(|error| {
        debug!(%key, %error, "message not readable");
        Heard::Unreadable(key.to_owned())
    })
}

/// Thread, as Zenoh blocks it while the network is congested: everything that fusion says, in order; ends when the loop drops its end of the queue.
fn speak(
    boxes: &[Publisher<'static>],
    poses: &Publisher<'static>,
    status: &Publisher<'static>,
    mut said: mpsc::Receiver<Said>,
    matched: &tokio::sync::watch::Sender<bool>,
) {
    while let Some(message) = said.blocking_recv() {
        let (publisher, bytes) = match message {
            Said::Boxes(viewpoint, bytes) => (boxes.get(viewpoint), bytes),
            Said::Poses(bytes) => (Some(poses), bytes),
            Said::Status(bytes) => {
                // Statuses go out several times a second until the start: the moment to look.
                matched.send_replace(all_match(boxes));
                (Some(status), bytes)
            }
        };
        let Some(publisher) = publisher else { continue };
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
