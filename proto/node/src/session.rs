//! The Zenoh session of a node: opened as [`farfield_proto::transport`] says, and what is declared on it.
//!
//! Nothing is scouted for: fusion listens, everybody else connects to it, at the endpoints of the venue file.

use std::thread;

use anyhow::{Context as _, anyhow};
use farfield_proto::transport::words::without_places;
use farfield_proto::transport::{EdgeTransport, FusionTransport, ZenohSetting};
use farfield_proto::wire::VERSION;
use tracing::warn;
use zenoh::handlers::{FifoChannel, FifoChannelHandler};
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::{CongestionControl, Priority, Reliability};
use zenoh::sample::Sample;
use zenoh::{Session, Wait as _};

/// A subscription of which nothing is lost: what waits, waits in order.
pub type FifoSubscriber = Subscriber<FifoChannelHandler<Sample>>;

/// What becomes of a message that cannot go at once, or gets lost on its way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delivery {
    /// It waits for room, which blocks the thread that sends it, and is sent again: lock-step must lose nothing.
    Blocking,
    /// Dropped where there is no room now, sent again when lost: what would be missed for a second.
    Reliable,
    /// Dropped where there is no room now, and not sent again: the next is better.
    BestEffort,
    /// As [`Self::Reliable`], behind everything else that waits: what is large, and no pose is made of.
    Leisurely,
}

/// A session with fusion, waited for as long as it takes; who no longer waits leaves nothing behind that holds the runtime.
///
/// # Errors
/// When Zenoh refuses a setting, or cannot open the session: names the endpoints.
pub async fn connect(transport: &EdgeTransport<'_>) -> anyhow::Result<Session> {
    let config = config(transport.settings())?;
    // Opening blocks its thread until fusion is there. A thread of its own can be left behind, where the runtime would
    // wait for one of its own when it ends.
    let (opened, session) = tokio::sync::oneshot::channel();
    thread::Builder::new()
        .name("connect".to_owned())
        .spawn(move || drop(opened.send(zenoh::open(config).wait())))
        .context("starting the thread that opens the session")?;
    let session = session.await.context("opening the session")?;
    let session = session.map_err(zenoh_error);
    session.with_context(|| format!("connecting to {}", transport.connect.join(", ")))
}

/// The session that everybody else connects to.
///
/// # Errors
/// When Zenoh refuses a setting, or an endpoint cannot be listened on: names the endpoints.
pub async fn listen(transport: &FusionTransport<'_>) -> anyhow::Result<Session> {
    let config = config(transport.settings())?;
    let session = zenoh::open(config).await.map_err(zenoh_error);
    session.map_err(|error| {
        let hint = if is_taken(&error) {
            "; choose another with --listen"
        } else {
            ""
        };
        anyhow!(
            "listening on {}: {error:#}{hint}",
            transport.listen.join(", ")
        )
    })
}

/// Whether a place to listen at could not be had because another process has it.
pub fn is_taken(error: &anyhow::Error) -> bool {
    // Zenoh has no kind for it.
    error.to_string().contains("in use")
}

/// Closes `session`; that it did not go well is logged.
pub async fn close(session: &Session) {
    if let Err(error) = session.close().await {
        warn!(%error, "the session did not close well");
    }
}

/// Declares a publisher of `key`. All that a tick needs has the same priority, and is not put in order by it.
///
/// # Errors
/// What Zenoh says.
pub async fn publisher(
    session: &Session,
    key: String,
    delivery: Delivery,
) -> anyhow::Result<Publisher<'static>> {
    let (congestion, reliability) = match delivery {
        Delivery::Blocking => (CongestionControl::Block, Reliability::Reliable),
        Delivery::Reliable | Delivery::Leisurely => {
            (CongestionControl::Drop, Reliability::Reliable)
        }
        Delivery::BestEffort => (CongestionControl::Drop, Reliability::BestEffort),
    };
    let is_leisurely = delivery == Delivery::Leisurely;
    let declared = session
        .declare_publisher(key.clone())
        .congestion_control(congestion)
        .reliability(reliability)
        .priority(if is_leisurely {
            Priority::Background
        } else {
            Priority::RealTime
        })
        .express(!is_leisurely);
    declared
        .await
        .map_err(zenoh_error)
        .with_context(|| format!("declaring the publisher of {key}"))
}

/// Puts a status: beside its bytes stands the newest version of messages that this node reads, for
/// [`farfield_proto::wire::SpokenVersion`]. Nodes that know nothing of it leave it unread.
///
/// # Errors
/// What Zenoh says.
pub fn put_status(publisher: &Publisher<'_>, bytes: Vec<u8>) -> zenoh::Result<()> {
    publisher.put(bytes).attachment(vec![VERSION]).wait()
}

/// What the node of a status reads at most, if it says so.
pub fn reads_at_most(status: &Sample) -> Option<u8> {
    let attachment = status.attachment()?.to_bytes();
    attachment.first().copied()
}

/// Whether somebody listens to what `publisher` says.
pub fn has_listener(publisher: &Publisher<'_>) -> bool {
    publisher
        .matching_status()
        .wait()
        .is_ok_and(|status| status.matching())
}

/// Subscribes to `key`; up to `queue` messages wait, then Zenoh stops reading, and senders wait.
///
/// # Errors
/// What Zenoh says.
pub async fn subscriber(
    session: &Session,
    key: String,
    queue: usize,
) -> anyhow::Result<FifoSubscriber> {
    let declared = session
        .declare_subscriber(key.clone())
        .with(FifoChannel::new(queue))
        .await;
    declared
        .map_err(zenoh_error)
        .with_context(|| format!("subscribing to {key}"))
}

/// Subscribes to who is there under `key`, those first who are there already.
///
/// # Errors
/// What Zenoh says.
pub async fn liveliness(
    session: &Session,
    key: String,
    queue: usize,
) -> anyhow::Result<FifoSubscriber> {
    let declared = session
        .liveliness()
        .declare_subscriber(key.clone())
        .history(true)
        .with(FifoChannel::new(queue))
        .await;
    declared
        .map_err(zenoh_error)
        .with_context(|| format!("watching {key}"))
}

/// Says under `key` that this node is there, until the token or the session goes.
///
/// # Errors
/// What Zenoh says.
pub async fn declare_alive(session: &Session, key: String) -> anyhow::Result<LivelinessToken> {
    let declared = session.liveliness().declare_token(key).await;
    declared.map_err(zenoh_error)
}

fn config(settings: Vec<ZenohSetting>) -> anyhow::Result<zenoh::Config> {
    let mut config = zenoh::Config::default();
    for (key, value) in settings {
        config
            .insert_json5(&key, &value)
            .map_err(zenoh_error)
            .with_context(|| format!("setting {key} to {value}"))?;
    }
    Ok(config)
}

/// What Zenoh says, as an error of ours.
#[expect(clippy::needless_pass_by_value, reason = "what `map_err` takes")]
pub fn zenoh_error(error: zenoh::Error) -> anyhow::Error {
    anyhow!(without_places(&error.to_string()))
}
