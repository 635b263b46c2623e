//! The publishers of a live edge. Nothing blocks: a message that cannot be sent at once is dropped.

use farfield_node::session::{self, Delivery, has_listener, put_status};
use farfield_proto::key::Keys;
use tracing::debug;
use zenoh::pubsub::Publisher;
use zenoh::{Session, Wait as _};

use crate::live::rate::MessageKind;

/// The publishers of a live edge. Patches are best effort, because newer ones follow. Sightings and
/// statuses are reliable, because the next one comes a second later. Thumbnails have the lowest
/// priority.
pub(in crate::node) struct EdgePublishers {
    patches: Publisher<'static>,
    sightings: Publisher<'static>,
    status: Publisher<'static>,
    /// Set if pictures may leave the edge.
    thumbnails: Option<Publisher<'static>>,
}

impl EdgePublishers {
    /// Declares the publishers of a venue and viewpoint; with `pictures`, also the one of
    /// thumbnails.
    ///
    /// # Errors
    /// The error of Zenoh.
    pub(in crate::node) async fn declare(
        session: &Session,
        [venue, viewpoint]: [&str; 2],
        pictures: bool,
    ) -> anyhow::Result<Self> {
        let keys = Keys::new(venue);
        let publisher = |key, delivery| session::publisher(session, key, delivery);
        let thumbnails = if pictures {
            Some(publisher(keys.thumbnail(viewpoint), Delivery::Leisurely).await?)
        } else {
            None
        };
        Ok(Self {
            thumbnails,
            patches: publisher(keys.patch(viewpoint), Delivery::BestEffort).await?,
            sightings: publisher(keys.sighting(viewpoint), Delivery::Reliable).await?,
            status: publisher(keys.status(viewpoint), Delivery::Reliable).await?,
        })
    }

    /// Whether pictures may leave the edge.
    pub(super) fn has_pictures(&self) -> bool {
        self.thumbnails.is_some()
    }

    /// Whether thumbnails have a subscriber.
    pub(super) fn has_thumbnail_subscriber(&self) -> bool {
        self.thumbnails.as_ref().is_some_and(has_listener)
    }

    /// Passes a message to the network.
    pub(super) fn put(&self, message: MessageKind, bytes: Vec<u8>) {
        let (publisher, sent) = match message {
            MessageKind::Patches(_) => (&self.patches, self.patches.put(bytes).wait()),
            MessageKind::Sightings => (&self.sightings, self.sightings.put(bytes).wait()),
            MessageKind::Status => (&self.status, put_status(&self.status, bytes)),
            MessageKind::Thumbnail => match &self.thumbnails {
                Some(thumbnails) => (thumbnails, thumbnails.put(bytes).wait()),
                None => return,
            },
        };
        // While fusion is away there is no receiver.
        if let Err(error) = sent {
            debug!(key = %publisher.key_expr(), %error, "not sent");
        }
    }
}
