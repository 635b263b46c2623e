//! State of a venue now and in the last minutes, built from node messages and shared with all
//! pages.
//!
//! [`PageState`] accepts messages without ever blocking the sender. Its own thread decodes them.
//! Frames are encoded once and reach all clients through a slot that holds only the newest.

pub(crate) mod feed;
mod history;
pub(crate) mod known;
pub(crate) mod past;
mod recording;
pub(crate) mod thumbnails;

#[cfg(test)]
pub(crate) mod fixture;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use farfield_proto::venue::Venue;
use tokio::sync::watch;

use crate::calibration::ShownCalibration;
use crate::protocol::request::Action;
use crate::protocol::status::{PageCounts, RecordingState};
use crate::protocol::text::{ActionKind, Mode};
use crate::protocol::venue;
use crate::skeleton::Skeleton;
use feed::Feed;
use history::EventLog;
pub use history::HistoryBounds;
use known::External;
use known::context::Context;
use known::frame::SharedFrame;
use past::Past;
pub use recording::RecordedMessages;
use recording::Recording;
use thumbnails::Thumbnails;
use tokio::time::Instant;

/// Performs the actions that pages request. Called on a thread that may block, one action at a
/// time.
pub trait PageActions: Send + Sync {
    /// The supported kinds of actions.
    fn kinds(&self) -> Vec<ActionKind>;

    /// Performs an action.
    ///
    /// # Errors
    /// The reason for the failure, a sentence for the operator.
    fn act(&self, action: &Action) -> Result<(), String>;
}

/// Options of the page, other than the venue.
#[derive(Default)]
pub struct PageOptions {
    /// Limits of the history, or of the recording data in memory.
    pub history: HistoryBounds,
    /// Performs requested actions; `None` disables all actions.
    pub actions: Option<Arc<dyn PageActions>>,
    /// The calibration as pages show it.
    pub calibration: ShownCalibration,
}

/// State that pages show. Pass it to [`crate::server::Server`], and messages to [`Self::message`].
pub struct PageState {
    shared: Arc<Shared>,
    feed: Option<Feed>,
}

/// Data shared by the feed, the clients and the host program.
pub(crate) struct Shared {
    pub(crate) context: Arc<Context>,
    pub(crate) mode: Mode,
    pub(crate) actions: Option<Arc<dyn PageActions>>,
    pub(crate) kinds: Vec<ActionKind>,
    pub(crate) calibration: ShownCalibration,
    /// Serialises actions.
    acting: Mutex<()>,
    pub(crate) venue_document: String,
    /// The newest tick: one slot, never a queue.
    pub(crate) newest: watch::Sender<Option<SharedFrame>>,
    /// JSON of the newest requested tick, created once for all clients.
    newest_json: Mutex<Option<(SharedFrame, Arc<str>)>>,
    pub(crate) status: watch::Sender<Arc<str>>,
    pub(crate) names: watch::Sender<Arc<BTreeMap<u32, String>>>,
    pub(crate) events: EventLog,
    pub(crate) past: Past,
    pub(crate) thumbnails: Thumbnails,
    recording: Mutex<Option<RecordingState>>,
    pub(crate) clients: AtomicUsize,
    pub(crate) dropped: AtomicU64,
}

/// Locks a mutex even after another thread panicked: its content is always replaced as a whole.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl PageState {
    /// State of a running venue, fed with [`Self::message`].
    ///
    /// # Errors
    /// If no thread can be started.
    pub fn live(
        venue: Venue,
        skeleton: Skeleton,
        options: PageOptions,
    ) -> std::io::Result<Arc<Self>> {
        Self::fed(venue, skeleton, options, Mode::Live)
    }

    /// State of a recording that is solved again, fed with the resulting poses and events.
    ///
    /// # Errors
    /// If no thread can be started.
    pub fn replay(
        venue: Venue,
        skeleton: Skeleton,
        options: PageOptions,
    ) -> std::io::Result<Arc<Self>> {
        Self::fed(venue, skeleton, options, Mode::Replay)
    }

    fn fed(
        venue: Venue,
        skeleton: Skeleton,
        options: PageOptions,
        mode: Mode,
    ) -> std::io::Result<Arc<Self>> {
        let past = Past::live(options.history, venue.rate_hz);
        let shared = Shared::new(venue, skeleton, options, mode, past);
        let feed = Feed::start(Arc::clone(&shared))?;
        Ok(Arc::new(Self {
            shared,
            feed: Some(feed),
        }))
    }

    /// State of a recording, which is read where clients are.
    ///
    /// # Errors
    /// If no thread can be started.
    pub fn recording(
        venue: Venue,
        skeleton: Skeleton,
        messages: Box<dyn RecordedMessages>,
        options: PageOptions,
    ) -> std::io::Result<Arc<Self>> {
        let recording = Arc::new(Recording::new(options.history.bytes));
        let past = Past::Recording(Arc::clone(&recording));
        let shared = Shared::new(venue, skeleton, options, Mode::Recording, past);
        recording.start(messages, &shared)?;
        Ok(Arc::new(Self { shared, feed: None }))
    }

    /// Accepts a wire message: key, payload, and the time when it was sent or received,
    /// microseconds of Unix time by fusion's clock. Never blocks: without room the message is
    /// dropped and counted. Recordings ignore it.
    pub fn message(&self, key: &str, bytes: &[u8], at_us: i64) {
        let topic = self.shared.context.topic(key);
        if let (Some(topic), Some(feed)) = (topic, &self.feed)
            && !feed.offer(topic, bytes, at_us)
        {
            self.shared.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Accepts a thumbnail from the wire; it replaces the camera's previous one. Invalid thumbnails
    /// are dropped.
    pub fn thumbnail(&self, bytes: &[u8]) {
        self.shared.thumbnails.take(bytes, Instant::now());
    }

    /// Sets whether a recording runs, for pages; `None` if unknown.
    pub fn set_recording(&self, recording: Option<RecordingState>) {
        *lock(&self.shared.recording) = recording;
    }

    /// Sets the names of people by id, for pages.
    pub fn set_names(&self, names: BTreeMap<u32, String>) {
        self.shared.names.send_replace(Arc::new(names));
    }

    /// Number of messages dropped so far for lack of room.
    pub fn dropped(&self) -> u64 {
        self.shared.dropped.load(Ordering::Relaxed)
    }

    pub(crate) fn shared(&self) -> &Arc<Shared> {
        &self.shared
    }
}

impl Shared {
    fn new(
        venue: Venue,
        skeleton: Skeleton,
        options: PageOptions,
        mode: Mode,
        past: Past,
    ) -> Arc<Self> {
        let PageOptions {
            actions,
            calibration,
            ..
        } = options;
        let kinds = actions
            .as_ref()
            .map(|actions| actions.kinds())
            .unwrap_or_default();
        Arc::new(Self {
            venue_document: venue::document(&venue, &skeleton, mode, &kinds),
            thumbnails: Thumbnails::new(venue.cameras.len()),
            context: Arc::new(Context::new(venue, skeleton)),
            mode,
            actions,
            kinds,
            calibration,
            acting: Mutex::default(),
            newest: watch::Sender::new(None),
            newest_json: Mutex::default(),
            status: watch::Sender::new(Arc::from("")),
            names: watch::Sender::new(Arc::default()),
            events: EventLog::default(),
            past,
            recording: Mutex::default(),
            clients: AtomicUsize::new(0),
            dropped: AtomicU64::new(0),
        })
    }

    /// JSON of a tick that just arrived.
    pub(crate) fn live_json(&self, frame: &SharedFrame) -> Arc<str> {
        // Clients that arrive during encoding wait; that is shorter than encoding again.
        let mut newest = lock(&self.newest_json);
        match &*newest {
            Some((of, json)) if Arc::ptr_eq(of, frame) => Arc::clone(json),
            _ => {
                let json: Arc<str> = frame.json(true).into();
                *newest = Some((Arc::clone(frame), Arc::clone(&json)));
                json
            }
        }
    }

    /// Status inputs that do not come from messages.
    pub(crate) fn external(&self) -> External {
        External {
            recording: lock(&self.recording).clone(),
            counts: PageCounts {
                clients: self.clients.load(Ordering::Relaxed),
                dropped: self.dropped.load(Ordering::Relaxed),
                unreadable: 0,
            },
        }
    }

    /// Performs an action requested by a page; may block.
    pub(crate) fn act(&self, action: &Action) -> Result<(), String> {
        let actions = self
            .actions
            .as_ref()
            .filter(|_| self.kinds.contains(&action.kind()));
        let actions = actions.ok_or_else(|| "this server cannot do that".to_owned())?;
        let _one_at_a_time = lock(&self.acting);
        actions.act(action)?;
        if let Action::NamePerson { person, name } = action {
            self.names.send_modify(|names| {
                let mut changed = BTreeMap::clone(names);
                if name.is_empty() {
                    changed.remove(person);
                } else {
                    changed.insert(*person, name.clone());
                }
                *names = Arc::new(changed);
            });
        }
        Ok(())
    }
}
