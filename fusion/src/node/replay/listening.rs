//! Who hears a replay: pages and streams get the poses as they are solved again, at the venue's rate.

use std::path::Path;
use std::time::{Duration, Instant};

use farfield_node::clock;
use farfield_node::process::{NodeError, say};
use farfield_proto::id::SessionId;
use farfield_proto::key::Keys;
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::identity_event::IdentityEventSet;
use farfield_proto::venue::Venue;
use farfield_proto::wire;
use tokio_util::sync::CancellationToken;

use crate::node::listeners::{Listeners, OpenListeners, RunAtItsStart};
use crate::node::session::wiretap::CopiedMessage;
use crate::pipeline::StepOutput;

/// Those who listen to a replay.
pub(super) struct Listening {
    listeners: Listeners,
    keys: Keys,
    session: SessionId,
    tick_lasts: Duration,
    /// When the next tick may be told.
    due: Instant,
}

impl Listening {
    /// Opens them, on `runtime`, and says where they can be reached; results go to the folder `out`.
    ///
    /// # Errors
    /// What cannot be opened.
    pub(super) fn open(
        runtime: &tokio::runtime::Runtime,
        listeners: Box<dyn OpenListeners>,
        (venue, keypoints, session): (&Venue, &KeypointSet, SessionId),
        out: &Path,
    ) -> Result<Self, NodeError> {
        let run = RunAtItsStart {
            venue,
            keypoints,
            is_live: false,
            identity: None,
            out,
            restarts: None,
            recordings: None,
        };
        let listeners = runtime.block_on(listeners.open(run))?;
        for line in &listeners.said {
            say(format_args!("{line}"));
        }
        Ok(Self {
            listeners,
            keys: Keys::new(&venue.name),
            session,
            tick_lasts: Duration::from_secs_f64(1.0 / venue.rate_hz),
            due: clock::now(),
        })
    }

    /// Whether anybody listens.
    pub(super) fn is_anybody(&self) -> bool {
        !self.listeners.wiretaps.is_empty()
    }

    /// Tells what a tick came to, once it is time for it.
    pub(super) fn tell(&mut self, output: &StepOutput) {
        if !self.is_anybody() {
            return;
        }
        let now = clock::now();
        if let Some(early) = self.due.checked_duration_since(now) {
            std::thread::sleep(early);
        }
        // Who is slower than the venue does not hurry afterwards.
        self.due = self.due.max(now) + self.tick_lasts;
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
        self.publish(&self.keys.pose(), &wire::encode(&output.poses));
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
