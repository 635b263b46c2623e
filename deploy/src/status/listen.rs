//! Receives the statuses of the nodes of a venue, and which nodes are connected.

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

/// Everything received so far.
#[derive(Debug, Clone, Default)]
pub(super) struct Received {
    /// The newest status of every node.
    pub(super) nodes: BTreeMap<String, ReceivedNode>,
    /// The connected nodes, by their liveliness tokens.
    pub(super) present: BTreeSet<String>,
    /// Decoding errors of statuses, by node.
    pub(super) unreadable: BTreeMap<String, String>,
}

/// A node that has sent a status.
#[derive(Debug, Clone)]
pub(super) struct ReceivedNode {
    pub(super) status: Status,
    pub(super) at: Instant,
    /// Processed ticks per second between its two newest statuses.
    pub(super) ticks_per_s: Option<f64>,
}

impl Received {
    /// Whether all connected nodes have sent a status.
    pub(super) fn is_complete(&self) -> bool {
        let is_received =
            |name: &String| self.nodes.contains_key(name) || self.unreadable.contains_key(name);
        !self.present.is_empty() && self.present.iter().all(is_received)
    }

    /// Adds a status that came at `at`.
    pub(super) fn take(&mut self, status: Status, at: Instant) {
        let before = self.nodes.get(&status.node);
        let ticks_per_s = before.and_then(|before| {
            let s = at.duration_since(before.at).as_secs_f64();
            rate(&before.status, &status, s)
        });
        self.unreadable.remove(&status.node);
        self.nodes.insert(
            status.node.clone(),
            ReceivedNode {
                status,
                at,
                ticks_per_s,
            },
        );
    }
}

/// Processed ticks per second; `None` if the time is too short, or ticks went back.
fn rate(before: &Status, now: &Status, s: f64) -> Option<f64> {
    let done = now.ticks_done_since(before.tick?, before.missed_ticks())?;
    (s > 0.1).then(|| done as f64 / s)
}

/// Receives until it is dropped.
pub(super) struct Listener {
    received: Arc<Mutex<Received>>,
    _subscribers: [Subscriber<()>; 2],
}

impl Listener {
    /// Receives only from the nodes of `venue`: other programs can use any name.
    ///
    /// # Errors
    /// Errors of Zenoh.
    pub(super) async fn start(session: &Session, venue: &Venue) -> anyhow::Result<Self> {
        let received = Arc::<Mutex<Received>>::default();
        let keys = Keys::new(&venue.name);
        let names = venue.viewpoints.iter().map(|v| v.name.clone());
        let names: Arc<BTreeSet<String>> = Arc::new(names.chain([FUSION.to_owned()]).collect());
        let known = Arc::clone(&names);
        let into = Arc::clone(&received);
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
        let into = Arc::clone(&received);
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
            .context("subscribing to the liveliness of nodes")?;
        Ok(Self {
            received,
            _subscribers: [statuses, tokens],
        })
    }

    /// Everything received so far.
    pub(super) fn received(&self) -> Received {
        lock(&self.received).clone()
    }
}

/// The node of a key.
fn node(sample: &Sample) -> Option<&str> {
    sample.key_expr().as_str().rsplit('/').next()
}

fn lock(received: &Mutex<Received>) -> MutexGuard<'_, Received> {
    // All parts are valid on their own, even if a thread has panicked.
    received.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use farfield_proto::tick::Tick;

    use super::*;

    #[test]
    fn a_rate_needs_two_statuses_some_time_apart() {
        let at = |tick| Status {
            tick: Some(Tick(tick)),
            ..Status::default()
        };
        assert_eq!(rate(&at(100), &at(130), 1.0), Some(30.0));
        assert_eq!(rate(&at(100), &at(99), 1.0), None, "started again");
        assert_eq!(rate(&at(100), &at(130), 0.0), None);
    }
}
