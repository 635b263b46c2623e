//! What a live edge publishes on. Nothing blocks: what cannot go at once is dropped.

use anyhow::Context as _;
use farfield_proto::key::Keys;
use tracing::debug;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority, Reliability};
use zenoh::{Session, Wait as _};

use crate::live::rate::MessageKind;
use crate::node::link::zenoh_error;

/// The publishers of a live edge: patches best effort, as the next are better; sightings and statuses reliable,
/// as a lost one would be missed for a second.
pub(in crate::node) struct Mouths {
    patches: Publisher<'static>,
    sightings: Publisher<'static>,
    status: Publisher<'static>,
}

impl Mouths {
    /// Declares them for `viewpoint` of `venue`.
    ///
    /// # Errors
    /// What Zenoh says.
    pub(in crate::node) async fn declare(
        session: &Session,
        venue: &str,
        viewpoint: &str,
    ) -> anyhow::Result<Self> {
        let keys = Keys::new(venue);
        let (lossy, whole) = (Reliability::BestEffort, Reliability::Reliable);
        Ok(Self {
            patches: publisher(session, keys.patch(viewpoint), lossy).await?,
            sightings: publisher(session, keys.sighting(viewpoint), whole).await?,
            status: publisher(session, keys.status(viewpoint), whole).await?,
        })
    }

    /// Hands a message to the network.
    pub(super) fn put(&self, message: MessageKind, bytes: Vec<u8>) {
        let publisher = match message {
            MessageKind::Patches(_) => &self.patches,
            MessageKind::Sightings => &self.sightings,
            MessageKind::Status => &self.status,
        };
        // While fusion is away there is nobody to send to.
        if let Err(error) = publisher.put(bytes).wait() {
            debug!(key = %publisher.key_expr(), %error, "not sent");
        }
    }
}

async fn publisher(
    session: &Session,
    key: String,
    reliability: Reliability,
) -> anyhow::Result<Publisher<'static>> {
    let declared = session
        .declare_publisher(key.clone())
        .congestion_control(CongestionControl::Drop)
        .reliability(reliability)
        .priority(Priority::RealTime)
        .express(true);
    declared
        .await
        .map_err(zenoh_error)
        .with_context(|| format!("declaring the publisher of {key}"))
}
