//! What waits between Zenoh and the loop.

use anyhow::Context as _;
use zenoh::Session;
use zenoh::handlers::{FifoChannel, FifoChannelHandler, RingChannel, RingChannelHandler};
use zenoh::pubsub::Subscriber;
use zenoh::sample::Sample;

use super::link::{Mode, zenoh_error};

/// Messages that wait of one subscription. When full: in lock-step Zenoh stops reading, and the edges
/// wait; live the oldest are lost, as a thread of Zenoh's that waits would hold up everybody.
const QUEUE: usize = 256;

/// A subscription, and what waits of it.
pub(super) enum Inbox {
    /// All of it, in order.
    All(Subscriber<FifoChannelHandler<Sample>>),
    /// The newest of it.
    Newest(Subscriber<RingChannelHandler<Sample>>),
}

impl Inbox {
    /// The next message; `None` when there will be no more.
    pub(super) async fn next(&self) -> Option<Sample> {
        match self {
            Self::All(subscriber) => subscriber.recv_async().await.ok(),
            Self::Newest(subscriber) => subscriber.recv_async().await.ok(),
        }
    }
}

/// Subscribes to `key`.
pub(super) async fn subscriber(
    session: &Session,
    key: String,
    mode: Mode,
) -> anyhow::Result<Inbox> {
    let declared = session.declare_subscriber(key.clone());
    let declared = match mode {
        Mode::LockStep => declared.with(FifoChannel::new(QUEUE)).await.map(Inbox::All),
        Mode::Live => declared
            .with(RingChannel::new(QUEUE))
            .await
            .map(Inbox::Newest),
    };
    declared
        .map_err(zenoh_error)
        .with_context(|| format!("subscribing to {key}"))
}

/// Who came and who went is said once: nothing of it may be lost.
pub(super) async fn liveliness(session: &Session, key: String) -> anyhow::Result<Inbox> {
    let declared = session
        .liveliness()
        .declare_subscriber(key.clone())
        .history(true)
        .with(FifoChannel::new(QUEUE))
        .await;
    declared
        .map(Inbox::All)
        .map_err(zenoh_error)
        .with_context(|| format!("watching {key}"))
}
