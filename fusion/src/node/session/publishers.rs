//! All that fusion publishes on, and the thread that does.

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
use super::messages::FusionOutgoing;
use super::mode::RunMode;

/// All that fusion publishes on.
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
    /// Declares what the edges of `venue`, and whoever listens to the results, need.
    ///
    /// # Errors
    /// What Zenoh says.
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

    /// How many viewpoints get boxes.
    pub(super) fn viewpoints(&self) -> usize {
        self.boxes.len()
    }

    /// Thread, as Zenoh blocks it while the network is congested: sends everything, in order; ends when the loop drops
    /// its end of the queue. `matched` says whether every viewpoint listens for its boxes.
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
                    // Statuses go out several times a second until the start: the moment to look.
                    matched.send_replace(self.boxes.iter().all(has_listener));
                    let version = interceptor.spoken_by_all();
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
                warn!(key = %publisher.key_expr(), %error, "not sent");
            }
        }
    }
}
