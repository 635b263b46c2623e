//! Fusion's publishers, and the thread that sends.

use farfield_node::session::{self, Delivery, has_listener, put_status};
use farfield_proto::key::Keys;
use farfield_proto::transport::FUSION;
use farfield_proto::venue::Venue;
use farfield_proto::wire;
use tokio::sync::{mpsc, watch};
use tracing::warn;
use zenoh::pubsub::Publisher;
use zenoh::{Session, Wait as _};

use super::interceptor::Interceptor;
use super::messages::{FusionOutgoing, RunMode};

/// Fusion's publishers.
pub(super) struct FusionPublishers {
    /// By viewpoint.
    boxes: Vec<Publisher<'static>>,
    poses: Publisher<'static>,
    smooth: Publisher<'static>,
    decisions: Publisher<'static>,
    events: Publisher<'static>,
    namings: Publisher<'static>,
    status: Publisher<'static>,
}

impl FusionPublishers {
    /// Declares the publishers for the edges of `venue` and subscribers to the results.
    ///
    /// # Errors
    /// An error of Zenoh.
    pub(super) async fn declare(
        session: &Session,
        venue: &Venue,
        mode: RunMode,
    ) -> anyhow::Result<Self> {
        let keys = Keys::new(&venue.name);
        let (delivery, sent_once) = match mode {
            RunMode::LockStep => (Delivery::Blocking, Delivery::Blocking),
            // Statuses and events are sent once: a lost one would be missed.
            RunMode::Live => (Delivery::BestEffort, Delivery::Reliable),
        };
        let publisher = |key, delivery| session::publisher(session, key, delivery);
        let mut boxes = Vec::new();
        for viewpoint in &venue.viewpoints {
            boxes.push(publisher(keys.boxes(&viewpoint.name), delivery).await?);
        }
        Ok(Self {
            boxes,
            poses: publisher(keys.pose(), delivery).await?,
            smooth: publisher(keys.smooth(), delivery).await?,
            decisions: publisher(keys.decision(), delivery).await?,
            events: publisher(keys.event(), sent_once).await?,
            namings: publisher(keys.naming(), sent_once).await?,
            status: publisher(keys.status(FUSION), sent_once).await?,
        })
    }

    /// The number of viewpoints with boxes.
    pub(super) fn viewpoints(&self) -> usize {
        self.boxes.len()
    }

    /// Sends all messages in order until the loop drops its end of the queue. It runs on a thread, because Zenoh blocks while the
    /// network is congested. `matched` tells whether every viewpoint has subscribed to its boxes.
    pub(super) fn send_all(
        &self,
        mut outgoing: mpsc::Receiver<FusionOutgoing>,
        interceptor: &Interceptor,
        matched: &watch::Sender<bool>,
    ) {
        while let Some(message) = outgoing.blocking_recv() {
            let is_status = matches!(message, FusionOutgoing::Status(_));
            let (publisher, bytes) = match message {
                FusionOutgoing::Boxes(viewpoint, bytes) => (self.boxes.get(viewpoint), bytes),
                FusionOutgoing::Poses(bytes) => (Some(&self.poses), bytes),
                FusionOutgoing::Smooth(bytes) => (Some(&self.smooth), bytes),
                FusionOutgoing::Decision(bytes) => (Some(&self.decisions), bytes),
                FusionOutgoing::Events(bytes) => (Some(&self.events), bytes),
                FusionOutgoing::Namings(bytes) => (Some(&self.namings), bytes),
                FusionOutgoing::Status(status) => {
                    // Before the start statuses are sent several times a second: a good moment for the check.
                    matched.send_replace(self.boxes.iter().all(has_listener));
                    let version = interceptor.common_version();
                    (Some(&self.status), wire::encode_as(&*status, version))
                }
            };
            let Some(publisher) = publisher else { continue };
            interceptor.published(publisher.key_expr().as_str(), &bytes);
            let sent = if is_status {
                put_status(publisher, bytes)
            } else {
                publisher.put(bytes).wait()
            };
            if let Err(error) = sent {
                warn!(key = %publisher.key_expr(), %error, "message not sent");
            }
        }
    }
}
