//! The short queue between the decoding thread and its consumer. Decoding of the next frames
//! overlaps with inference on the current one.
//!
//! It holds [`CAPACITY`] frames. If it is full, decoding of a recording waits, and a live source
//! drops its oldest frame.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
#[cfg(feature = "node")]
use std::time::Duration;

use super::{Frame, SourceError};

/// Frames decoded in advance: one requested and one spare. A frame of 1920 x 1200 is 7 MB.
const CAPACITY: usize = 2;

/// What happens to a frame if the queue is full.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum WhenFull {
    /// Decoding waits: a recording keeps every frame.
    Wait,
    /// The oldest frame is dropped: a live source keeps the newest.
    #[cfg_attr(
        not(feature = "node"),
        expect(dead_code, reason = "only live sources lose frames")
    )]
    DropOldest,
}

#[derive(Debug)]
struct PrefetchState<T> {
    frames: VecDeque<Result<T, SourceError>>,
    ended: bool,
    abandoned: bool,
}

#[derive(Debug)]
struct PrefetchShared<T> {
    state: Mutex<PrefetchState<T>>,
    changed: Condvar,
    when_full: WhenFull,
}

impl<T> PrefetchShared<T> {
    fn lock(&self) -> MutexGuard<'_, PrefetchState<T>> {
        // A poisoned queue is usable: each of its fields is valid on its own.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn wait<'a>(
        &self,
        state: MutexGuard<'a, PrefetchState<T>>,
    ) -> MutexGuard<'a, PrefetchState<T>> {
        self.changed
            .wait(state)
            .unwrap_or_else(PoisonError::into_inner)
    }
}

/// The end of the decoding thread. Dropping it ends the queue, also if that thread panics.
#[derive(Debug)]
pub(super) struct Sender<T = Frame>(Arc<PrefetchShared<T>>);

impl<T> Sender<T> {
    /// Adds a frame or an error; `false` if the consumer is gone.
    pub(super) fn push(&self, frame: Result<T, SourceError>) -> bool {
        let mut state = self.0.lock();
        while state.frames.len() >= CAPACITY && !state.abandoned {
            match self.0.when_full {
                WhenFull::Wait => state = self.0.wait(state),
                WhenFull::DropOldest => drop(state.frames.pop_front()),
            }
        }
        if state.abandoned {
            return false;
        }
        state.frames.push_back(frame);
        self.0.changed.notify_all();
        true
    }
}

impl<T> Drop for Sender<T> {
    fn drop(&mut self) {
        self.0.lock().ended = true;
        self.0.changed.notify_all();
    }
}

/// Frames decoded in advance by a thread.
#[derive(Debug)]
pub(super) struct Prefetch<T = Frame> {
    shared: Arc<PrefetchShared<T>>,
    thread: Option<JoinHandle<()>>,
}

impl<T> Prefetch<T> {
    /// Starts `decode` on its own thread. The thread ends on its own, or when [`Sender::push`]
    /// returns `false`.
    pub(super) fn spawn(
        when_full: WhenFull,
        decode: impl FnOnce(Sender<T>) + Send + 'static,
    ) -> std::io::Result<Self>
    where
        T: Send + 'static,
    {
        let shared = Arc::new(PrefetchShared {
            state: Mutex::new(PrefetchState {
                frames: VecDeque::new(),
                ended: false,
                abandoned: false,
            }),
            changed: Condvar::new(),
            when_full,
        });
        let sender = Sender(Arc::clone(&shared));
        let thread = std::thread::Builder::new()
            .name("frames".to_owned())
            .spawn(move || decode(sender))?;
        Ok(Self {
            shared,
            thread: Some(thread),
        })
    }

    /// Waits for the next frame; `None` when the thread has ended and the queue is empty.
    pub(super) fn pop(&self) -> Option<Result<T, SourceError>> {
        let mut state = self.shared.lock();
        loop {
            if let Some(frame) = state.frames.pop_front() {
                self.shared.changed.notify_all();
                return Some(frame);
            }
            if state.ended {
                return None;
            }
            state = self.shared.wait(state);
        }
    }

    /// Stops the decoding thread at its next frame, without waiting for it.
    pub(super) fn abandon(&self) {
        self.shared.lock().abandoned = true;
        self.shared.changed.notify_all();
    }
}

#[cfg(feature = "node")]
impl<T> Prefetch<T> {
    /// Like [`Self::pop`], but waits for at most `patience`.
    ///
    /// # Errors
    /// [`Silence`] if no frame came in time.
    pub(super) fn pop_within(
        &self,
        patience: Duration,
    ) -> Result<Option<Result<T, SourceError>>, Silence> {
        let nothing = |state: &mut PrefetchState<T>| state.frames.is_empty() && !state.ended;
        let changed = &self.shared.changed;
        let waited = changed.wait_timeout_while(self.shared.lock(), patience, nothing);
        let (mut state, result) = waited.unwrap_or_else(PoisonError::into_inner);
        if result.timed_out() {
            return Err(Silence);
        }
        let frame = state.frames.pop_front();
        self.shared.changed.notify_all();
        Ok(frame)
    }
}

/// No frame came within the waiting time.
#[cfg(feature = "node")]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Silence;

impl<T> Drop for Prefetch<T> {
    fn drop(&mut self) {
        self.abandon();
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the thread that decodes frames panicked");
        }
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::tick::Tick;

    use super::super::{FrameContent, KeypointFrame};
    use super::*;

    fn frame(tick: i64) -> Frame {
        Frame {
            tick: Tick(tick),
            capture_offset_us: 0,
            content: FrameContent::Keypoints(KeypointFrame::default()),
        }
    }

    #[test]
    fn a_recording_loses_nothing() {
        let prefetch = Prefetch::spawn(WhenFull::Wait, |sender| {
            for tick in 0..100 {
                assert!(sender.push(Ok(frame(tick))));
            }
        })
        .unwrap();
        let got: Vec<i64> = std::iter::from_fn(|| prefetch.pop())
            .map(|f| f.unwrap().tick.0)
            .collect();
        assert_eq!(got, (0..100).collect::<Vec<_>>());
    }

    #[test]
    fn a_live_source_keeps_the_newest() {
        let mut prefetch = Prefetch::spawn(WhenFull::DropOldest, |sender| {
            for tick in 0..100 {
                assert!(sender.push(Ok(frame(tick))));
            }
        })
        .unwrap();
        prefetch.thread.take().unwrap().join().unwrap();
        let got: Vec<i64> = std::iter::from_fn(|| prefetch.pop())
            .map(|f| f.unwrap().tick.0)
            .collect();
        assert_eq!(got, [98, 99]);
    }

    #[test]
    fn dropping_the_consumer_ends_a_waiting_thread() {
        let prefetch = Prefetch::spawn(WhenFull::Wait, |sender| {
            let mut tick = 0;
            while sender.push(Ok(frame(tick))) {
                tick += 1;
            }
        })
        .unwrap();
        assert!(prefetch.pop().is_some());
        drop(prefetch);
    }

    #[test]
    fn a_thread_that_panics_ends_the_queue() {
        let prefetch =
            Prefetch::spawn(WhenFull::Wait, |_sender: Sender| panic!("on purpose")).unwrap();
        assert!(prefetch.pop().is_none());
    }
}
