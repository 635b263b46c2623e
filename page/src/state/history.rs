//! The last minutes in bounded memory: ticks, statuses, and identity events.

use super::lock;
use crate::protocol::text::EventLine;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::Mutex;
use tokio::sync::watch;

use farfield_proto::tick::Tick;

use crate::state::known::frame::{Frame, SharedFrame};

/// Limits of a history; the first one reached applies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HistoryBounds {
    /// Maximum memory, bytes.
    pub bytes: usize,
    /// Maximum duration, seconds at the venue's rate.
    pub seconds: f64,
}

impl Default for HistoryBounds {
    /// Five minutes, with the memory that eight people at 60 Hz and eight cameras need for that
    /// time.
    fn default() -> Self {
        Self {
            bytes: 128 << 20,
            seconds: 300.0,
        }
    }
}

/// Ticks and statuses of the last minutes, each in ascending order of ticks.
#[derive(Debug)]
pub(crate) struct History {
    frames: VecDeque<SharedFrame>,
    statuses: VecDeque<(Tick, Arc<str>)>,
    bytes: usize,
    most_bytes: usize,
    most_ticks: i64,
}

impl History {
    pub(crate) fn new(bounds: HistoryBounds, rate_hz: f64) -> Self {
        Self {
            frames: VecDeque::new(),
            statuses: VecDeque::new(),
            bytes: 0,
            most_bytes: bounds.bytes,
            most_ticks: (bounds.seconds * rate_hz) as i64,
        }
    }

    /// Adds a tick. A tick that is not after the last one starts a new history, since fusion was
    /// restarted.
    pub(crate) fn push(&mut self, frame: SharedFrame) {
        if self
            .frames
            .back()
            .is_some_and(|last| last.tick >= frame.tick)
        {
            self.clear();
        }
        let newest = frame.tick;
        self.bytes += frame.size_bytes();
        self.frames.push_back(frame);
        let most_ticks = self.most_ticks;
        let is_old = |frame: &SharedFrame| newest - frame.tick > most_ticks;
        while self.frames.len() > 1
            && (self.bytes > self.most_bytes || self.frames.front().is_some_and(is_old))
        {
            self.forget_first();
        }
    }

    fn forget_first(&mut self) {
        if let Some(gone) = self.frames.pop_front() {
            self.bytes = self.bytes.saturating_sub(gone.size_bytes());
        }
        let first = self.frames.front().map(|frame| frame.tick);
        // Keep one status from before the first tick; it applies to that tick.
        while self
            .statuses
            .get(1)
            .is_some_and(|(tick, _)| first.is_some_and(|first| *tick <= first))
        {
            if let Some((_, gone)) = self.statuses.pop_front() {
                self.bytes = self.bytes.saturating_sub(gone.len());
            }
        }
    }

    fn clear(&mut self) {
        self.frames.clear();
        self.statuses.clear();
        self.bytes = 0;
    }

    /// Records the status at a tick; a second one for the same tick replaces the first.
    pub(crate) fn push_status(&mut self, tick: Tick, status: Arc<str>) {
        if let Some((last, gone)) = self.statuses.back_mut().filter(|(last, _)| *last >= tick) {
            if *last == tick {
                self.bytes = self.bytes.saturating_sub(gone.len()) + status.len();
                *gone = status;
            }
            return;
        }
        self.bytes += status.len();
        self.statuses.push_back((tick, status));
    }

    /// Approximate memory use.
    pub(crate) fn bytes(&self) -> usize {
        self.bytes
    }

    /// First and last tick.
    pub(crate) fn span(&self) -> Option<[Tick; 2]> {
        Some([self.frames.front()?.tick, self.frames.back()?.tick])
    }

    /// The last tick at or before `tick`; otherwise the first one.
    pub(crate) fn at(&self, tick: Tick) -> Option<SharedFrame> {
        let after = self.frames.partition_point(|frame| frame.tick <= tick);
        self.frames.get(after.saturating_sub(1)).map(Arc::clone)
    }

    /// Status at `tick`.
    pub(crate) fn status_at(&self, tick: Tick) -> Option<Arc<str>> {
        let after = self.statuses.partition_point(|(at, _)| *at <= tick);
        let (_, status) = self.statuses.get(after.saturating_sub(1))?;
        Some(Arc::clone(status))
    }

    /// The ticks from `from` to `to`, both included; every n-th if there are more than `most`.
    pub(crate) fn range(&self, [from, to]: [Tick; 2], most: usize) -> Vec<SharedFrame> {
        let first = self.frames.partition_point(|frame| frame.tick < from);
        let end = self
            .frames
            .partition_point(|frame: &Arc<Frame>| frame.tick <= to);
        let n = end.saturating_sub(first);
        let every = n.div_ceil(most.max(1)).max(1);
        let range = self.frames.iter().skip(first).take(n).step_by(every);
        range.map(Arc::clone).collect()
    }
}

/// Number of events that are kept.
const MAX_EVENTS: usize = 1000;

/// Events in the order in which they happened.
#[derive(Debug)]
pub(crate) struct EventLog {
    lines: Mutex<VecDeque<Arc<EventLine>>>,
    /// Total number of events so far.
    count: watch::Sender<u64>,
}

impl Default for EventLog {
    fn default() -> Self {
        Self {
            lines: Mutex::default(),
            count: watch::Sender::new(0),
        }
    }
}

impl EventLog {
    pub(crate) fn push(&self, events: Vec<EventLine>) {
        if events.is_empty() {
            return;
        }
        let mut lines = lock(&self.lines);
        let n = events.len() as u64;
        for event in events {
            if lines.len() >= MAX_EVENTS {
                lines.pop_front();
            }
            lines.push_back(Arc::new(event));
        }
        self.count.send_modify(|count| *count += n);
    }

    /// Notifies of new events.
    pub(crate) fn watch(&self) -> watch::Receiver<u64> {
        self.count.subscribe()
    }

    /// The events after the first `seen`, at most the last `most`; and the total number so far.
    pub(crate) fn after(&self, seen: u64, most: usize) -> (Vec<Arc<EventLine>>, u64) {
        let lines = lock(&self.lines);
        let count = *self.count.borrow();
        let new = usize::try_from(count.saturating_sub(seen)).unwrap_or(usize::MAX);
        let n = new.min(most).min(lines.len());
        (
            lines.range(lines.len() - n..).map(Arc::clone).collect(),
            count,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::fixture::{context, feed, synthetic};
    use crate::state::known::{Known, News};

    fn frames(ticks: [i64; 2]) -> Vec<SharedFrame> {
        let news = feed(&mut Known::new(context()), &synthetic(2), ticks, |_, _| {
            true
        });
        let frames = news.into_iter().filter_map(|news| match news {
            News::Frame(frame) => Some(frame),
            _ => None,
        });
        frames.collect()
    }

    fn history(bytes: usize, seconds: f64) -> History {
        History::new(HistoryBounds { bytes, seconds }, 60.0)
    }

    #[test]
    fn ticks_older_than_the_span_are_removed() {
        let mut history = history(usize::MAX, 1.0);
        for frame in frames([0, 100]) {
            history.push_status(frame.tick, Arc::from("status"));
            history.push(frame);
        }
        assert_eq!(history.span(), Some([Tick(39), Tick(99)]));
        assert!(history.statuses.len() <= 62);
    }

    #[test]
    fn memory_never_exceeds_the_limit() {
        let most = 200_000;
        let mut history = history(most, 1e9);
        for frame in frames([0, 300]) {
            history.push(frame);
            assert!(history.bytes() <= most);
        }
        let [first, last] = history.span().unwrap();
        assert!(first > Tick(0) && last == Tick(299));
        let total: usize = history.frames.iter().map(|frame| frame.size_bytes()).sum();
        assert_eq!(history.bytes(), total);
    }

    #[test]
    fn lookup_returns_the_tick_or_the_last_before_it_or_the_first() {
        let mut history = history(usize::MAX, 1e9);
        for frame in frames([10, 20])
            .into_iter()
            .filter(|frame| frame.tick != Tick(15))
        {
            history.push(frame);
        }
        let at = |tick| history.at(Tick(tick)).unwrap().tick.0;
        assert_eq!([at(i64::MIN), at(12), at(15), at(99)], [10, 12, 14, 19]);
        let range = history.range([Tick(11), Tick(18)], 3);
        let ticks: Vec<i64> = range.iter().map(|frame| frame.tick.0).collect();
        assert_eq!(ticks, [11, 14, 18]);
    }

    #[test]
    fn a_restarted_fusion_starts_a_new_history() {
        let mut history = history(usize::MAX, 1e9);
        for frame in frames([100, 110]).into_iter().chain(frames([5, 8])) {
            history.push(frame);
        }
        assert_eq!(history.span(), Some([Tick(5), Tick(7)]));
    }

    #[test]
    fn default_limit_holds_five_minutes_of_eight_people() {
        let news = feed(
            &mut Known::new(context()),
            &synthetic(8),
            [600, 660],
            |_, _| true,
        );
        let sizes = news.iter().filter_map(|news| match news {
            News::Frame(frame) => Some(frame.size_bytes()),
            _ => None,
        });
        let one_second: usize = sizes.sum();
        let bounds = HistoryBounds::default();
        let all = one_second as f64 * bounds.seconds;
        assert!(all < bounds.bytes as f64, "{all} bytes");
    }
}
