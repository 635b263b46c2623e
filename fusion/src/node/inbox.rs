//! What waits between Zenoh and the loop.

use anyhow::Context as _;
use farfield_node::session::{self, FifoSubscriber, zenoh_error};
use zenoh::Session;
use zenoh::handlers::{RingChannel, RingChannelHandler};
use zenoh::pubsub::Subscriber;
use zenoh::sample::Sample;

use super::link::Mode;

/// Messages that wait of one subscription. When full: in lock-step Zenoh stops reading, and the edges
/// wait; live the oldest are lost, as a thread of Zenoh's that waits would hold up everybody.
const QUEUE: usize = 256;

/// A subscription, and what waits of it.
pub(super) enum Inbox {
    /// All of it, in order.
    All(FifoSubscriber),
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
    match mode {
        Mode::LockStep => session::subscriber(session, key, QUEUE)
            .await
            .map(Inbox::All),
        Mode::Live => {
            let declared = session
                .declare_subscriber(key.clone())
                .with(RingChannel::new(QUEUE))
                .await;
            declared
                .map(Inbox::Newest)
                .map_err(zenoh_error)
                .with_context(|| format!("subscribing to {key}"))
        }
    }
}

/// Who came and who went is said once: nothing of it may be lost.
pub(super) async fn liveliness(session: &Session, key: String) -> anyhow::Result<Inbox> {
    session::liveliness(session, key, QUEUE)
        .await
        .map(Inbox::All)
}
