//! The Zenoh session of a node, configured by [`farfield_proto::transport`], and its declarations.
//!
//! There is no scouting: fusion listens at the endpoints of the venue file, and all other nodes
//! connect to it.

use std::thread;

use anyhow::{Context as _, anyhow};
use farfield_proto::transport::without_places;
use farfield_proto::transport::{EdgeTransport, FusionTransport, ZenohSetting};
use farfield_proto::wire::VERSION;
use tracing::warn;
use zenoh::handlers::{FifoChannel, FifoChannelHandler};
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::{CongestionControl, Priority, Reliability};
use zenoh::sample::Sample;
use zenoh::{Session, Wait as _};

/// A lossless subscription: messages wait in order.
pub type FifoSubscriber = Subscriber<FifoChannelHandler<Sample>>;

/// How a message is treated that cannot be sent at once or is lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delivery {
    /// It waits for room, which blocks the sending thread, and is sent again: lock-step must lose
    /// nothing.
    Blocking,
    /// Dropped if there is no room now, sent again when lost: for messages that would be missed for
    /// a second.
    Reliable,
    /// Dropped if there is no room now, and not sent again: the next message is better.
    BestEffort,
    /// As [`Self::Reliable`], with the lowest priority: for large messages that no pose depends on.
    Leisurely,
}

/// Opens a session with fusion, and waits as long as necessary. A cancelled call leaves nothing
/// behind that blocks the runtime.
///
/// # Errors
/// When Zenoh refuses a setting, or cannot open the session; with the endpoints.
pub async fn connect(transport: &EdgeTransport<'_>) -> anyhow::Result<Session> {
    let config = config(transport.settings())?;
    // Opening blocks its thread until fusion answers. A plain thread can be left behind, but the
    // runtime would wait for one of its own threads at its end.
    let (opened, session) = tokio::sync::oneshot::channel();
    thread::Builder::new()
        .name("connect".to_owned())
        .spawn(move || drop(opened.send(zenoh::open(config).wait())))
        .context("starting the thread that opens the session")?;
    let session = session.await.context("opening the session")?;
    let session = session.map_err(zenoh_error);
    session.with_context(|| format!("connecting to {}", transport.connect.join(", ")))
}

/// Opens the session to which all other nodes connect.
///
/// # Errors
/// When Zenoh refuses a setting, or cannot listen at an endpoint; with the endpoints.
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

/// Whether listening failed because another process uses the endpoint.
pub fn is_taken(error: &anyhow::Error) -> bool {
    // Zenoh has no error kind for it.
    error.to_string().contains("in use")
}

/// Closes `session`; a failure is logged.
pub async fn close(session: &Session) {
    if let Err(error) = session.close().await {
        warn!(%error, "the session did not close well");
    }
}

/// Declares a publisher of `key`. All messages that a tick needs have the same priority, so that it
/// does not change their order.
///
/// # Errors
/// Zenoh's error.
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

/// Publishes a status. Its attachment is the newest message version that this node reads, for
/// [`farfield_proto::wire::SpokenVersion`]. Older nodes ignore it.
///
/// # Errors
/// Zenoh's error.
pub fn put_status(publisher: &Publisher<'_>, bytes: Vec<u8>) -> zenoh::Result<()> {
    publisher.put(bytes).attachment(vec![VERSION]).wait()
}

/// The newest message version that the sender of a status reads, if it is attached.
pub fn reads_at_most(status: &Sample) -> Option<u8> {
    let attachment = status.attachment()?.to_bytes();
    attachment.first().copied()
}

/// Whether `publisher` has a subscriber.
pub fn has_listener(publisher: &Publisher<'_>) -> bool {
    publisher
        .matching_status()
        .wait()
        .is_ok_and(|status| status.matching())
}

/// Subscribes to `key`. Up to `queue` messages wait; then Zenoh stops reading, and senders wait.
///
/// # Errors
/// Zenoh's error.
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

/// Subscribes to the liveliness tokens under `key`, including those that already exist.
///
/// # Errors
/// Zenoh's error.
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

/// Declares under `key` that this node is alive, until the token or the session is dropped.
///
/// # Errors
/// Zenoh's error.
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

/// Converts an error of Zenoh.
#[expect(clippy::needless_pass_by_value, reason = "what `map_err` takes")]
pub fn zenoh_error(error: zenoh::Error) -> anyhow::Error {
    anyhow!(without_places(&error.to_string()))
}
