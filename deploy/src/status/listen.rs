//! What the nodes of a venue say of themselves, and who is there.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use anyhow::Context as _;
use farfield_node::clock;
use farfield_node::session::zenoh_error;
use farfield_proto::key::Keys;
use farfield_proto::message::Status;
use farfield_proto::transport::FUSION;
use farfield_proto::venue::Venue;
use farfield_proto::wire;
use zenoh::Session;
use zenoh::pubsub::Subscriber;
use zenoh::sample::{Sample, SampleKind};

/// What was heard so far.
#[derive(Debug, Clone, Default)]
pub(super) struct Heard {
    /// The newest status of every node.
    pub(super) nodes: BTreeMap<String, HeardNode>,
    /// Who is there, as their tokens say.
    pub(super) present: BTreeSet<String>,
    /// What could not be read, by the node's name.
    pub(super) unreadable: BTreeMap<String, String>,
}

/// A node that has said how it is.
#[derive(Debug, Clone)]
pub(super) struct HeardNode {
    pub(super) status: Status,
    pub(super) at: Instant,
    /// Ticks per second that it worked on between its newest two statuses.
    pub(super) ticks_per_s: Option<f64>,
}

impl Heard {
    /// Whether all who are there have said how they are.
    pub(super) fn is_complete(&self) -> bool {
        let is_heard =
            |name: &String| self.nodes.contains_key(name) || self.unreadable.contains_key(name);
        !self.present.is_empty() && self.present.iter().all(is_heard)
    }

    /// Takes a status that came at `at`.
    pub(super) fn take(&mut self, status: Status, at: Instant) {
        let before = self.nodes.get(&status.node);
        let ticks_per_s = before.and_then(|before| {
            let s = at.duration_since(before.at).as_secs_f64();
            rate(&before.status, &status, s)
        });
        self.unreadable.remove(&status.node);
        self.nodes.insert(
            status.node.clone(),
            HeardNode {
                status,
                at,
                ticks_per_s,
            },
        );
    }
}

/// Ticks per second that were worked on; `None` where time is too short to say, or ticks went back.
fn rate(before: &Status, now: &Status, s: f64) -> Option<f64> {
    let done = now.ticks_done_since(before.tick?, before.missed_ticks())?;
    (s > 0.1).then(|| done as f64 / s)
}

/// Listens until it is dropped.
pub(super) struct Listener {
    heard: Arc<Mutex<Heard>>,
    _subscribers: [Subscriber<()>; 2],
}

impl Listener {
    /// To the nodes of `venue` alone: strangers may call themselves as they like.
    ///
    /// # Errors
    /// What Zenoh says.
    pub(super) async fn start(session: &Session, venue: &Venue) -> anyhow::Result<Self> {
        let heard = Arc::<Mutex<Heard>>::default();
        let keys = Keys::new(&venue.name);
        let names = venue.viewpoints.iter().map(|v| v.name.clone());
        let names: Arc<BTreeSet<String>> = Arc::new(names.chain([FUSION.to_owned()]).collect());
        let known = Arc::clone(&names);
        let into = Arc::clone(&heard);
        let statuses = session
            .declare_subscriber(keys.statuses())
            .callback(move |sample: Sample| {
                let Some(node) = node(&sample).filter(|node| known.contains(*node)) else {
                    return;
                };
                match wire::decode::<Status>(&sample.payload().to_bytes()) {
                    Ok(status) if status.node == node => lock(&into).take(status, clock::now()),
                    Ok(_) => {}
                    Err(error) => {
                        let unreadable = &mut lock(&into).unreadable;
                        unreadable.insert(node.to_owned(), error.to_string());
                    }
                }
            })
            .await
            .map_err(zenoh_error)
            .context("subscribing to the statuses")?;
        let into = Arc::clone(&heard);
        let tokens = session
            .liveliness()
            .declare_subscriber(keys.all_alive())
            .history(true)
            .callback(move |sample: Sample| {
                let Some(node) = node(&sample).filter(|node| names.contains(*node)) else {
                    return;
                };
                let present = &mut lock(&into).present;
                match sample.kind() {
                    SampleKind::Put => drop(present.insert(node.to_owned())),
                    SampleKind::Delete => drop(present.remove(node)),
                }
            })
            .await
            .map_err(zenoh_error)
            .context("watching who is there")?;
        Ok(Self {
            heard,
            _subscribers: [statuses, tokens],
        })
    }

    /// What was heard so far.
    pub(super) fn heard(&self) -> Heard {
        lock(&self.heard).clone()
    }
}

/// Whose key it is.
fn node(sample: &Sample) -> Option<&str> {
    sample.key_expr().as_str().rsplit('/').next()
}

fn lock(heard: &Mutex<Heard>) -> MutexGuard<'_, Heard> {
    // All parts are valid on their own, whatever a thread that panicked left undone.
    heard.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use farfield_proto::tick::Tick;

    use super::*;

    #[test]
    fn a_rate_is_of_two_statuses_some_time_apart() {
        let at = |tick| Status {
            tick: Some(Tick(tick)),
            ..Status::default()
        };
        assert_eq!(rate(&at(100), &at(130), 1.0), Some(30.0));
        assert_eq!(rate(&at(100), &at(99), 1.0), None, "started again");
        assert_eq!(rate(&at(100), &at(130), 0.0), None);
    }
}
