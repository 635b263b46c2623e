//! Fusion's side of the links: one Zenoh router that all edges connect to.
//!
//! In lock-step all messages are reliable, blocking and of one priority: they may wait, but must not be lost or reordered. In a
//! live run boxes and poses are best effort, and no call blocks. There is no scouting; the endpoints are in the venue file.

use farfield_node::endpoints::Reach;
use farfield_node::session::{self, declare_alive};
use farfield_proto::key::Keys;
use farfield_proto::transport::{FUSION, FusionTransport};
use farfield_proto::venue::Venue;
use tokio::sync::{mpsc, watch};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use zenoh::Session;
use zenoh::liveliness::LivelinessToken;
use zenoh::session::ZenohId;

use super::interceptor::{Interceptor, Senders};
use super::messages::{FusionIncoming, FusionOutgoing, RunMode};
use super::publishers::FusionPublishers;
use super::subscribers::Subscribers;

/// Messages queued for the loop; when it is full, further ones wait in their subscription.
const QUEUE: usize = 256;
/// Places in the send queue per viewpoint: more than the boxes of the most people in one message, with four cameras each, take.
const BOX_MESSAGES: usize = 32;

/// The open session with its publishers, subscribers and token.
pub(crate) struct FusionSession {
    session: Session,
    publishers: FusionPublishers,
    subscribers: Subscribers,
    token: LivelinessToken,
}

impl FusionSession {
    /// Listens on the endpoints of `reach`. Nothing shows yet that this is a fusion.
    pub(crate) async fn listen(venue: &Venue, reach: &Reach) -> anyhow::Result<Session> {
        let viewpoints: Vec<&str> = venue.viewpoints.iter().map(|v| v.name.as_str()).collect();
        let transport = FusionTransport {
            venue: &venue.name,
            viewpoints: &viewpoints,
            listen: &reach.endpoints,
            identity: reach.identity.as_ref(),
        };
        session::listen(&transport).await
    }

    /// Declares on the listening `session` everything that the edges of `venue` need.
    pub(crate) async fn open(
        session: Session,
        venue: &Venue,
        mode: RunMode,
        senders: &Senders,
    ) -> anyhow::Result<Self> {
        let keys = Keys::new(&venue.name);
        let publishers = FusionPublishers::declare(&session, venue, mode).await?;
        let subscribers = Subscribers::declare(&session, &keys, mode, senders).await?;
        let token = declare_alive(&session, keys.alive(FUSION)).await?;
        Ok(Self {
            session,
            publishers,
            subscribers,
            token,
        })
    }

    /// Subscribes to thumbnails, in a live run.
    pub(crate) async fn accept_thumbnails(
        &mut self,
        venue: &Venue,
        senders: &Senders,
    ) -> anyhow::Result<()> {
        let keys = Keys::new(&venue.name);
        self.subscribers
            .add_thumbnails(&self.session, &keys, senders)
            .await
    }

    /// The session, for other declarations.
    pub(crate) fn session(&self) -> Session {
        self.session.clone()
    }

    /// Zenoh's id of the session.
    pub(crate) fn zenoh_id(&self) -> ZenohId {
        self.session.zid()
    }

    /// The endpoints that edges can connect to, with the actual ports.
    pub(crate) async fn locators(&self) -> Vec<String> {
        self.session
            .info()
            .locators()
            .await
            .iter()
            .map(ToString::to_string)
            .collect()
    }

    /// Closes the session before any message was sent.
    pub(crate) async fn close_unused(self) {
        session::close(&self.session).await;
    }

    /// Starts the tasks that carry messages to and from the loop.
    pub(crate) fn spawn(
        self,
        tasks: &TaskTracker,
        stop: &CancellationToken,
        interceptor: &Interceptor,
    ) -> FusionEnds {
        let (incoming_tx, incoming) = mpsc::channel(QUEUE);
        self.subscribers
            .spawn(tasks, interceptor, &incoming_tx, stop);
        // In lock-step at most one box set per viewpoint, in a few messages, one pose set, one decision, one set of events and a few
        // statuses are queued.
        let (outgoing_tx, outgoing) =
            mpsc::channel(BOX_MESSAGES * (self.publishers.viewpoints() + 4));
        let (matched_tx, matched) = watch::channel(false);
        let (publishers, own_interceptor) = (self.publishers, interceptor.clone());
        tasks.spawn_blocking(move || publishers.send_all(outgoing, &own_interceptor, &matched_tx));
        FusionEnds {
            incoming,
            outgoing: outgoing_tx,
            matched,
            session: self.session,
            _token: self.token,
        }
    }
}

/// The loop's ends of the queues to and from the wire.
pub(crate) struct FusionEnds {
    /// Incoming messages.
    pub(crate) incoming: mpsc::Receiver<FusionIncoming>,
    /// Outgoing messages; bounded, see [`FusionSession::spawn`].
    pub(crate) outgoing: mpsc::Sender<FusionOutgoing>,
    /// Whether every viewpoint has subscribed to its boxes.
    pub(crate) matched: watch::Receiver<bool>,
    session: Session,
    _token: LivelinessToken,
}

impl FusionEnds {
    /// The open session.
    pub(crate) fn session(&self) -> Session {
        self.session.clone()
    }

    /// Waits until the queued messages are sent, then closes the session.
    pub(crate) async fn close(self, tasks: &TaskTracker, stop: &CancellationToken) {
        drop(self.outgoing);
        drop(self.incoming);
        stop.cancel();
        tasks.close();
        tasks.wait().await;
        session::close(&self.session).await;
    }
}

#[cfg(test)]
#[path = "link_tests.rs"]
mod tests;
