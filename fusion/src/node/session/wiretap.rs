//! Copies, for whoever records: of every message that comes or goes, and of what each step was made of.
//!
//! With the decisions in the order of their ticks, a run can be solved again bit for bit:
//! [`crate::pipeline::Pipeline::first_boxes`] at the first one's tick, then per decision the late sets, the
//! horizons (where there are any), and the step.

use std::fmt;
use std::sync::Arc;

use farfield_proto::message::PatchSet;

use crate::align::TickGroup;

/// A message as it was on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CopiedMessage<'a> {
    /// Its Zenoh key.
    pub key: &'a str,
    /// Its payload.
    pub bytes: &'a [u8],
    /// When it came or went, microseconds of Unix time by fusion's clock.
    pub at_us: i64,
}

/// What one step of the core is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CopiedStep<'a> {
    /// The tick, and the messages that its step uses. The ticks of a run follow each other without a gap.
    pub group: &'a TickGroup,
    /// Sets of earlier ticks, given to the smoother before this step, in this order.
    pub late: &'a [PatchSet],
    /// What [`crate::pipeline::Pipeline::set_horizons`] is given before this step; empty: it is not
    /// called.
    pub horizons: &'a [f64],
}

/// Someone who listens in. Called from the threads that carry messages and from the loop: it must not
/// wait for anything, and drop (and count) what it has no room for.
pub trait Wiretap: Send + Sync {
    /// A message has come, readable or not.
    fn received(&self, message: CopiedMessage<'_>);

    /// A message goes out.
    fn published(&self, message: CopiedMessage<'_>);

    /// The core steps a tick.
    fn decided(&self, decided: CopiedStep<'_>);

    /// Why it listens no more, if it does not.
    fn failure(&self) -> Option<String> {
        None
    }
}

/// The wiretap of a run, if it has one.
#[derive(Clone, Default)]
pub(in crate::node) struct WiretapHandle(Option<Arc<dyn Wiretap>>);

impl WiretapHandle {
    pub(in crate::node) fn new(wiretap: Option<Arc<dyn Wiretap>>) -> Self {
        Self(wiretap)
    }

    pub(in crate::node) fn received(&self, message: CopiedMessage<'_>) {
        if let Some(wiretap) = &self.0 {
            wiretap.received(message);
        }
    }

    pub(in crate::node) fn published(&self, message: CopiedMessage<'_>) {
        if let Some(wiretap) = &self.0 {
            wiretap.published(message);
        }
    }

    pub(in crate::node) fn decided(&self, decided: CopiedStep<'_>) {
        if let Some(wiretap) = &self.0 {
            wiretap.decided(decided);
        }
    }
}

impl WiretapHandle {
    /// Why nobody listens any more, if somebody did.
    pub(in crate::node) fn failure(&self) -> Option<String> {
        self.0.as_ref()?.failure()
    }
}

impl fmt::Debug for WiretapHandle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("WiretapHandle")
            .field(&self.0.is_some())
            .finish()
    }
}
