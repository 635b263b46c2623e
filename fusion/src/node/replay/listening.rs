//! Who hears a replay: pages and streams get the poses as they are solved again, at the venue's rate.

use std::path::Path;
use std::time::{Duration, Instant};

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

use crate::node::listeners::{Listeners, OpenListeners, ReplayedRecording, RunAtItsStart};
use crate::node::session::wiretap::CopiedMessage;
use crate::pipeline::StepOutput;

/// However slow a venue is, a tick is told after so long.
const LONGEST_TICK: Duration = Duration::from_secs(1);
/// How often is looked whether to stop while the time of a tick is waited for.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// Those who listen to a replay.
pub(super) struct Listening {
    listeners: Listeners,
    keys: Keys,
    session: SessionId,
    tick_lasts: Duration,
    /// When the next tick may be told.
    due: Instant,
    waited: Duration,
}

impl Listening {
    /// Opens them, on `runtime`, and says where they can be reached; results go to the folder `out`.
    ///
    /// # Errors
    /// What cannot be opened.
    pub(super) fn open(
        runtime: &tokio::runtime::Runtime,
        listeners: Box<dyn OpenListeners>,
        (venue, keypoints, replays): (&Venue, &KeypointSet, ReplayedRecording<'_>),
        out: &Path,
    ) -> Result<Self, NodeError> {
        // Streams of the venue file are for what happens now; a replay has those that it was told.
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
        for line in &listeners.said {
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

    /// Whether anybody listens.
    pub(super) fn is_anybody(&self) -> bool {
        !self.listeners.wiretaps.is_empty()
    }

    /// How long was waited for the times of ticks.
    pub(super) fn waited(&self) -> Duration {
        self.waited
    }

    /// Tells what a tick came to, once it is time for it where somebody looks or is streamed to, or at once when `stop` says so.
    pub(super) fn tell(&mut self, output: &StepOutput, stop: &CancellationToken) {
        if !self.is_anybody() {
            return;
        }
        if self.listeners.is_in_time {
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

    /// Until it is time for the next tick, or `stop` says so.
    fn wait(&mut self, stop: &CancellationToken) {
        let began = clock::now();
        let mut now = began;
        while let Some(early) = self.due.checked_duration_since(now)
            && !early.is_zero()
            && !stop.is_cancelled()
        {
            std::thread::sleep(early.min(LOOK_EVERY));
            now = clock::now();
        }
        self.waited += now - began;
        // Who is slower than the venue does not hurry afterwards.
        self.due = self.due.max(now) + self.tick_lasts;
    }

    /// Waits until somebody ends the process, where listeners can still look at what was told.
    pub(super) fn stay(&self, runtime: &tokio::runtime::Runtime, stop: &CancellationToken) {
        if self.listeners.is_looked_at {
            say(format_args!("all is solved; the page stays until Ctrl-C"));
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
