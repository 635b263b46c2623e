//! Observers of a replay: pages and streams get the replayed poses at the venue's rate.

use std::path::Path;
use std::time::{Duration, Instant};

use farfield_fusion::pipeline::StepOutput;
use farfield_node::clock;
use farfield_node::process::{NodeError, say};
use farfield_proto::id::SessionId;
use farfield_proto::key::Keys;
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::identity_event::IdentityEventSet;
use farfield_proto::message::naming::NamingSet;
use farfield_proto::venue::Venue;
use farfield_proto::wire;
use tokio_util::sync::CancellationToken;

use crate::listeners::{Listeners, OpenListeners, ReplayedRecording, RunAtItsStart};
use crate::session::wiretap::CopiedMessage;

/// Longest time between two published ticks.
const LONGEST_TICK: Duration = Duration::from_secs(1);
/// Interval of checking for a stop while waiting for a tick's time.
const STOP_CHECK: Duration = Duration::from_millis(100);

/// The observers of a replay.
pub(super) struct ReplayObservers {
    listeners: Listeners,
    keys: Keys,
    session: SessionId,
    tick_lasts: Duration,
    /// Earliest time for publishing the next tick.
    due: Instant,
    waited: Duration,
}

impl ReplayObservers {
    /// Opens the observers on `runtime`, and prints their addresses; results go to the folder `out`.
    ///
    /// # Errors
    /// An observer cannot be opened.
    pub(super) fn open(
        runtime: &tokio::runtime::Runtime,
        listeners: Box<dyn OpenListeners>,
        venue: &Venue,
        keypoints: &KeypointSet,
        replays: ReplayedRecording<'_>,
        out: &Path,
    ) -> Result<Self, NodeError> {
        // The venue file's streams are for live runs; a replay has those of its command line.
        let venue = &Venue {
            streams: Vec::new(),
            ..venue.clone()
        };
        let run = RunAtItsStart {
            venue,
            keypoints,
            is_live: false,
            identity: None,
            out,
            restarts: None,
            listens_at: &[],
            recordings: None,
            replays: Some(replays),
        };
        let listeners = runtime.block_on(listeners.open(run))?;
        for line in &listeners.notices {
            say(format_args!("{line}"));
        }
        Ok(Self {
            listeners,
            keys: Keys::new(&venue.name),
            session: replays.session,
            tick_lasts: Duration::try_from_secs_f64(1.0 / venue.rate_hz)
                .map_or(LONGEST_TICK, |lasts| lasts.min(LONGEST_TICK)),
            due: clock::now(),
            waited: Duration::ZERO,
        })
    }

    /// Whether there are observers.
    pub(super) fn has_observers(&self) -> bool {
        !self.listeners.wiretaps.is_empty()
    }

    /// The total time spent waiting for the times of ticks.
    pub(super) fn waited(&self) -> Duration {
        self.waited
    }

    /// Publishes the results of a tick: at its time if an observer needs that and `stop` is not set, otherwise at once.
    pub(super) fn publish_tick(&mut self, output: &StepOutput, stop: &CancellationToken) {
        if !self.has_observers() {
            return;
        }
        if self.listeners.is_real_time {
            self.wait(stop);
        }
        let (session, tick) = (self.session, output.poses.tick);
        if !output.events.is_empty() {
            let events = output.events.clone();
            let set = IdentityEventSet {
                session,
                tick,
                events,
            };
            self.publish(&self.keys.event(), &wire::encode(&set));
        }
        if let Some(set) = NamingSet::of(session, tick, output.namings.clone()) {
            self.publish(&self.keys.naming(), &wire::encode(&set));
        }
        self.publish(&self.keys.pose(), &wire::encode(&output.poses));
    }

    /// Waits for the time of the next tick, or until `stop`.
    fn wait(&mut self, stop: &CancellationToken) {
        let began = clock::now();
        let mut now = began;
        while let Some(early) = self.due.checked_duration_since(now)
            && !early.is_zero()
            && !stop.is_cancelled()
        {
            std::thread::sleep(early.min(STOP_CHECK));
            now = clock::now();
        }
        self.waited += now - began;
        // A delay is not made up for by faster ticks later.
        self.due = self.due.max(now) + self.tick_lasts;
    }

    /// Waits until the process is stopped, if observers can still view the results.
    pub(super) fn stay(&self, runtime: &tokio::runtime::Runtime, stop: &CancellationToken) {
        if self.listeners.has_viewers {
            say(format_args!(
                "the replay is finished; the page stays open until Ctrl-C"
            ));
            runtime.block_on(stop.cancelled());
        }
    }

    fn publish(&self, key: &str, bytes: &[u8]) {
        let at_us = i64::try_from(clock::unix_time().as_micros()).unwrap_or(i64::MAX);
        for wiretap in &self.listeners.wiretaps {
            wiretap.published(CopiedMessage { key, bytes, at_us });
        }
    }
}
