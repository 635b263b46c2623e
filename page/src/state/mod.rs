//! What is known of a venue now and in the last minutes, built from the messages of its nodes and shared with all pages.
//!
//! [`PageState`] is fed from wherever messages pass; it never makes that place wait. A thread of its own decodes. Frames
//! are encoded once and handed to all clients by a slot that holds the newest only.

mod event_log;
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

use crate::actions::{Action, PageActions};
use crate::calibration::ShownCalibration;
use crate::protocol::status::{PageCounts, RecordingState};
use crate::protocol::text::{ActionKind, Mode};
use crate::protocol::venue;
use crate::skeleton::Skeleton;
use event_log::EventLog;
use feed::Feed;
pub use history::HistoryBounds;
use known::Beside;
use known::context::Context;
use known::frame::SharedFrame;
use past::Past;
pub use recording::RecordedMessages;
use recording::Recording;
use thumbnails::Thumbnails;
use tokio::time::Instant;

/// What the page can be told beside the venue.
#[derive(Default)]
pub struct PageOptions {
    /// How much of the past is kept, or of a recording held in memory.
    pub history: HistoryBounds,
    /// Who does what pages ask for; `None`: nothing can be done.
    pub actions: Option<Arc<dyn PageActions>>,
    /// What is known of the calibration beside what is in the venue.
    pub calibration: ShownCalibration,
}

/// What pages show. Give it to [`crate::server::Server`], and messages to [`Self::message`].
pub struct PageState {
    shared: Arc<Shared>,
    feed: Option<Feed>,
}

/// What the feed, the clients and the operator's program share.
pub(crate) struct Shared {
    pub(crate) context: Arc<Context>,
    pub(crate) mode: Mode,
    pub(crate) actions: Option<Arc<dyn PageActions>>,
    pub(crate) kinds: Vec<ActionKind>,
    pub(crate) calibration: ShownCalibration,
    /// One action at a time.
    acting: Mutex<()>,
    pub(crate) venue_document: String,
    /// The newest tick: one slot, never a queue.
    pub(crate) newest: watch::Sender<Option<SharedFrame>>,
    /// The newest tick that was asked for as JSON: it is made once for all who want it.
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

/// The lock's content, also after a panic of another thread: what it holds is replaced as a whole.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl PageState {
    /// The state of a running venue, to be fed with [`Self::message`].
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn live(
        venue: Venue,
        skeleton: Skeleton,
        options: PageOptions,
    ) -> std::io::Result<Arc<Self>> {
        Self::fed(venue, skeleton, options, Mode::Live)
    }

    /// The state of a recording that is solved again, to be fed with the poses and events that it comes to.
    ///
    /// # Errors
    /// When the system gives no thread.
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

    /// The state of a recording, which is read where clients are.
    ///
    /// # Errors
    /// When the system gives no thread.
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

    /// Takes a message as it was on the wire: its key, its payload, and when it came or went, microseconds of Unix time by
    /// fusion's clock. Never waits: what finds no room is dropped and counted. A recording takes none.
    pub fn message(&self, key: &str, bytes: &[u8], at_us: i64) {
        let topic = self.shared.context.topic(key);
        if let (Some(topic), Some(feed)) = (topic, &self.feed)
            && !feed.offer(topic, bytes, at_us)
        {
            self.shared.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Takes a thumbnail as it was on the wire, in the place of the one before of its camera. What is none is dropped.
    pub fn thumbnail(&self, bytes: &[u8]) {
        self.shared.thumbnails.take(bytes, Instant::now());
    }

    /// Tells pages whether a recording runs; `None`: nobody can say.
    pub fn set_recording(&self, recording: Option<RecordingState>) {
        *lock(&self.shared.recording) = recording;
    }

    /// Tells pages the names of people, by id.
    pub fn set_names(&self, names: BTreeMap<u32, String>) {
        self.shared.names.send_replace(Arc::new(names));
    }

    /// Messages that found no room so far.
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

    /// A tick that came just now, as JSON.
    pub(crate) fn live_json(&self, frame: &SharedFrame) -> Arc<str> {
        // Who comes while it is made waits: that is shorter than to make it again.
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

    /// What a status is told of by others than the messages.
    pub(crate) fn beside(&self) -> Beside {
        Beside {
            recording: lock(&self.recording).clone(),
            counts: PageCounts {
                clients: self.clients.load(Ordering::Relaxed),
                dropped: self.dropped.load(Ordering::Relaxed),
                unreadable: 0,
            },
        }
    }

    /// Does what a page asks for; may wait.
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
