//! Fusion's subscriptions, and the tasks that decode them. All messages published by other nodes enter here. Other data of other
//! nodes: requests of edges (`handout.rs`), answers of their rings (`recording/filler.rs`), and the messages of the
//! recorder node (`recorder_node.rs`).

use std::sync::Arc;

use anyhow::Context as _;
use farfield_node::session::{self, FifoSubscriber, zenoh_error};
use farfield_proto::key::Keys;
use farfield_proto::message::fill::SetKind;
use farfield_proto::message::thumbnail::Thumbnail;
use farfield_proto::message::{PatchSet, SightingSet};
use farfield_proto::wire::{self, WireError};
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tracing::debug;
use zenoh::Session;
use zenoh::pubsub::Subscriber;
use zenoh::sample::{Sample, SampleKind};

use super::inbox::Inbox;
use super::interceptor::{Interceptor, Senders};
use super::messages::{FusionIncoming, Liveliness, RunMode};
use super::recorded_sets::SetMessage;

/// Queued messages. In lock-step per subscription: if it is full, Zenoh stops reading and the edges wait. In a live run per node and
/// subscription: the oldest are dropped, because a waiting thread of Zenoh would delay all nodes.
const QUEUE: usize = 256;
/// Queued thumbnails of one node, which makes one after the other.
const THUMBNAILS: usize = 4;

/// Fusion's subscriptions.
pub(super) struct Subscribers(Vec<(FusionTopic, Subscription)>);

impl Subscribers {
    /// Declares the subscriptions under `keys`.
    ///
    /// # Errors
    /// An error of Zenoh.
    pub(super) async fn declare(
        session: &Session,
        keys: &Keys,
        mode: RunMode,
        senders: &Senders,
    ) -> anyhow::Result<Self> {
        let subscribe = |key| subscriber(session, key, mode, QUEUE, senders.clone());
        Ok(Self(vec![
            (FusionTopic::Patches, subscribe(keys.patches()).await?),
            (FusionTopic::Sightings, subscribe(keys.sightings()).await?),
            (FusionTopic::Statuses, subscribe(keys.statuses()).await?),
            (
                FusionTopic::Alive,
                liveliness(session, keys.all_alive()).await?,
            ),
        ]))
    }

    /// Subscribes to thumbnails, in a live run: from now on edges may send some.
    ///
    /// # Errors
    /// An error of Zenoh.
    pub(super) async fn add_thumbnails(
        &mut self,
        session: &Session,
        keys: &Keys,
        senders: &Senders,
    ) -> anyhow::Result<()> {
        let senders = senders.clone();
        let thumbnails = subscriber(
            session,
            keys.thumbnails(),
            RunMode::Live,
            THUMBNAILS,
            senders,
        )
        .await?;
        self.0.push((FusionTopic::Thumbnails, thumbnails));
        Ok(())
    }

    /// Starts a task for each subscription, which ends with `stop`.
    pub(super) fn spawn(
        self,
        tasks: &TaskTracker,
        interceptor: &Interceptor,
        incoming: &mpsc::Sender<FusionIncoming>,
        stop: &CancellationToken,
    ) {
        for (topic, subscription) in self.0 {
            let (interceptor, incoming) = (interceptor.clone(), incoming.clone());
            tasks.spawn(listen(
                topic,
                subscription,
                interceptor,
                incoming,
                stop.clone(),
            ));
        }
    }
}

#[derive(Debug, Clone, Copy)]
enum FusionTopic {
    Patches,
    Sightings,
    Thumbnails,
    Statuses,
    Alive,
}

/// A subscription with its queue.
enum Subscription {
    /// All messages, in order.
    All(FifoSubscriber),
    /// The newest messages of each node.
    Newest(
        Arc<Inbox<Sample>>,
        #[expect(dead_code, reason = "dropped, it is undeclared")] Subscriber<()>,
    ),
}

impl Subscription {
    /// The next message; `None` at the end.
    async fn next(&self) -> Option<Sample> {
        match self {
            Self::All(subscriber) => subscriber.recv_async().await.ok(),
            Self::Newest(inbox, _) => Some(inbox.next().await),
        }
    }
}

/// Subscribes to `key`; in a live run with this many places per node.
async fn subscriber(
    session: &Session,
    key: String,
    mode: RunMode,
    places: usize,
    senders: Senders,
) -> anyhow::Result<Subscription> {
    match mode {
        RunMode::LockStep => session::subscriber(session, key, QUEUE)
            .await
            .map(Subscription::All),
        RunMode::Live => {
            let inbox = Arc::new(Inbox::new(senders.len(), places));
            let into = Arc::clone(&inbox);
            let take = move |sample: Sample| {
                let sender = senders.index(sample.key_expr().as_str());
                if senders.admit(sender, sample.payload().len()) && into.put(sender, sample) {
                    senders.count_lost(sender);
                }
            };
            let declared = session.declare_subscriber(key.clone()).callback(take).await;
            declared
                .map(|subscriber| Subscription::Newest(inbox, subscriber))
                .map_err(zenoh_error)
                .with_context(|| format!("subscribing to {key}"))
        }
    }
}

/// Arrivals and departures are sent once, so none may be lost.
async fn liveliness(session: &Session, key: String) -> anyhow::Result<Subscription> {
    session::liveliness(session, key, QUEUE)
        .await
        .map(Subscription::All)
}

/// Task: decodes one subscription and sends it to the loop.
async fn listen(
    topic: FusionTopic,
    subscription: Subscription,
    interceptor: Interceptor,
    incoming: mpsc::Sender<FusionIncoming>,
    stop: CancellationToken,
) {
    loop {
        let sample = tokio::select! {
            sample = subscription.next() => sample,
            () = stop.cancelled() => return,
        };
        let Some(sample) = sample else { return };
        let read = match topic {
            FusionTopic::Thumbnails => pass_on(&sample, &interceptor),
            _ => Some(read(topic, &sample, &interceptor)),
        };
        if let Some(read) = read
            && incoming.send(read).await.is_err()
        {
            return;
        }
    }
}

/// Passes a thumbnail unchanged to the observers that want it. The loop gets only unreadable ones, recorders none.
fn pass_on(sample: &Sample, interceptor: &Interceptor) -> Option<FusionIncoming> {
    let key = sample.key_expr().as_str();
    let payload = sample.payload().to_bytes();
    let checked = wire::decode(&payload).and_then(|thumbnail: Thumbnail| {
        let may = interceptor.may_send_thumbnail(key, &thumbnail);
        may.then_some(())
            .ok_or(WireError::Invalid("of a camera of another viewpoint"))
    });
    match checked {
        Ok(()) => {
            interceptor.copy_thumbnail(key, &payload, interceptor.arrived(&payload));
            None
        }
        Err(error) => {
            debug!(%key, %error, "thumbnail not passed on");
            Some(FusionIncoming::Unreadable(key.to_owned(), error))
        }
    }
}

fn read(topic: FusionTopic, sample: &Sample, interceptor: &Interceptor) -> FusionIncoming {
    let key = sample.key_expr().as_str();
    if let FusionTopic::Alive = topic {
        let node = key.rsplit('/').next().unwrap_or(key).to_owned();
        let presence = match sample.kind() {
            SampleKind::Put => Liveliness::There,
            SampleKind::Delete => Liveliness::Gone,
        };
        return FusionIncoming::Alive(node, presence);
    }
    let payload = sample.payload().to_bytes();
    let arrival = interceptor.arrived(&payload);
    if let FusionTopic::Statuses = topic {
        interceptor.note_version(key, &payload, session::reads_at_most(sample));
    }
    let own = |viewpoint| {
        let may = interceptor.may_send_for(key, viewpoint);
        may.then_some(())
            .ok_or(WireError::Invalid("under the key of another viewpoint"))
    };
    let incoming = match topic {
        FusionTopic::Patches => wire::decode(&payload).and_then(|set: PatchSet| {
            own(set.viewpoint).map(|()| FusionIncoming::Patches(set, arrival))
        }),
        FusionTopic::Sightings => wire::decode(&payload).and_then(|set: SightingSet| {
            own(set.viewpoint).map(|()| FusionIncoming::Sightings(set, arrival))
        }),
        FusionTopic::Statuses | FusionTopic::Alive | FusionTopic::Thumbnails => {
            wire::decode(&payload).and_then(|status| {
                let may = interceptor.may_send_status(key, &status);
                may.then(|| FusionIncoming::Status(Box::new(status)))
                    .ok_or(WireError::Invalid("under the key of another node"))
            })
        }
    };
    match incoming {
        Ok(incoming) => {
            match set_message(&incoming) {
                Some(set) => interceptor.received_set(key, &payload, &set, arrival),
                None => interceptor.received(key, &payload, arrival),
            }
            incoming
        }
        Err(error) => {
            debug!(%key, %error, "unreadable message");
            interceptor.received_unusable(key, &payload, arrival);
            FusionIncoming::Unreadable(key.to_owned(), error)
        }
    }
}

/// The position of a message in its set.
fn set_message(incoming: &FusionIncoming) -> Option<SetMessage> {
    match incoming {
        FusionIncoming::Patches(set, _) => Some(SetMessage {
            session: set.session,
            viewpoint: set.viewpoint,
            tick: set.tick,
            kind: SetKind::Patches,
            part: set.part,
        }),
        FusionIncoming::Sightings(set, _) => Some(SetMessage {
            session: set.session,
            viewpoint: set.viewpoint,
            tick: set.tick,
            kind: SetKind::Sightings,
            part: set.part,
        }),
        _ => None,
    }
}
