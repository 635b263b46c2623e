//! All that fusion subscribes to, and the tasks that decode it: where every message that another node publishes
//! enters. What else comes from other nodes: queries of edges (`node/handout/mod.rs`), answers of their rings
//! (`node/recording/filler.rs`); and what the recorder node receives (`node/recorder_node.rs`).

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
use super::messages::{FusionIncoming, Liveliness};
use super::mode::RunMode;
use super::recorded_sets::SetMessage;

/// Messages that wait: in lock-step of one subscription, and when it is full Zenoh stops reading, and the edges wait; live
/// of each node of one subscription, and its oldest are lost, as a thread of Zenoh's that waits would hold up everybody.
const QUEUE: usize = 256;
/// Thumbnails of one node that wait: it makes one after the other.
const THUMBNAILS: usize = 4;

/// Everything that fusion subscribes to.
pub(super) struct Subscribers(Vec<(FusionTopic, Subscription)>);

impl Subscribers {
    /// Declares them under `keys`.
    ///
    /// # Errors
    /// What Zenoh says.
    pub(super) async fn declare(
        session: &Session,
        keys: &Keys,
        mode: RunMode,
        senders: &Senders,
    ) -> anyhow::Result<Self> {
        let subscribe = |key| subscriber(session, key, (mode, QUEUE), senders.clone());
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

    /// Subscribes to thumbnails, too, live: from now on edges may make some.
    ///
    /// # Errors
    /// What Zenoh says.
    pub(super) async fn add_thumbnails(
        &mut self,
        session: &Session,
        keys: &Keys,
        senders: &Senders,
    ) -> anyhow::Result<()> {
        let places = (RunMode::Live, THUMBNAILS);
        let thumbnails = subscriber(session, keys.thumbnails(), places, senders.clone()).await?;
        self.0.push((FusionTopic::Thumbnails, thumbnails));
        Ok(())
    }

    /// Starts a task for each, which ends with `stop`.
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

/// A subscription, and what waits of it.
enum Subscription {
    /// All of it, in order.
    All(FifoSubscriber),
    /// The newest of it, of each node.
    Newest(
        Arc<Inbox<Sample>>,
        #[expect(dead_code, reason = "dropped, it is undeclared")] Subscriber<()>,
    ),
}

impl Subscription {
    /// The next message; `None` when there will be no more.
    async fn next(&self) -> Option<Sample> {
        match self {
            Self::All(subscriber) => subscriber.recv_async().await.ok(),
            Self::Newest(inbox, _) => Some(inbox.next().await),
        }
    }
}

/// Subscribes to `key`; live so many messages of each node wait.
async fn subscriber(
    session: &Session,
    key: String,
    (mode, places): (RunMode, usize),
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

/// Who came and who went is said once: nothing of it may be lost.
async fn liveliness(session: &Session, key: String) -> anyhow::Result<Subscription> {
    session::liveliness(session, key, QUEUE)
        .await
        .map(Subscription::All)
}

/// Task: one subscription, decoded, to the loop.
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

/// Passes a thumbnail on as it came, to who looks at such. The loop hears of it only what cannot be read, and recorders
/// nothing at all.
fn pass_on(sample: &Sample, interceptor: &Interceptor) -> Option<FusionIncoming> {
    let key = sample.key_expr().as_str();
    let payload = sample.payload().to_bytes();
    let checked = wire::decode(&payload).and_then(|thumbnail: Thumbnail| {
        let may = interceptor.may_show(key, &thumbnail);
        may.then_some(())
            .ok_or(WireError::Invalid("of a camera of another viewpoint"))
    });
    match checked {
        Ok(()) => {
            interceptor.showed(key, &payload, interceptor.arrived(&payload));
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
        interceptor.heard_status(key, &payload, session::reads_at_most(sample));
    }
    let own = |viewpoint| {
        let may = interceptor.may_speak(key, viewpoint);
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
                let may = interceptor.may_say(key, &status);
                may.then(|| FusionIncoming::Status(Box::new(status)))
                    .ok_or(WireError::Invalid("under the key of another node"))
            })
        }
    };
    match incoming {
        Ok(incoming) => {
            match set_message(&incoming) {
                Some(set) => interceptor.received_set(key, &payload, (&set, arrival)),
                None => interceptor.received(key, &payload, arrival),
            }
            incoming
        }
        Err(error) => {
            debug!(%key, %error, "message not readable");
            interceptor.received_unusable(key, &payload, arrival);
            FusionIncoming::Unreadable(key.to_owned(), error)
        }
    }
}

/// Which message of a set it is.
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
