//! The last minutes, in bounded memory: ticks, and how everything was then.

use std::collections::VecDeque;
use std::sync::Arc;

use farfield_proto::tick::Tick;

use crate::state::known::frame::{Frame, SharedFrame};

/// Bounds of a history; whatever comes first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HistoryBounds {
    /// Most memory, bytes.
    pub bytes: usize,
    /// Longest span, seconds at the venue's rate.
    pub seconds: f64,
}

impl Default for HistoryBounds {
    /// Five minutes, in the memory that eight people at 60 Hz and eight cameras take for so long.
    fn default() -> Self {
        Self {
            bytes: 128 << 20,
            seconds: 300.0,
        }
    }
}

/// Ticks and statuses of the last minutes, each ascending by tick.
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

    /// Adds a tick. One that is not after the last begins a new history: fusion has begun anew.
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
        // One from before the first tick stays: it is how things were then.
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

    /// Notes how everything was at a tick; a second one of a tick takes the place of the first.
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

    /// What it takes in memory, about.
    pub(crate) fn bytes(&self) -> usize {
        self.bytes
    }

    /// The first and the last tick.
    pub(crate) fn span(&self) -> Option<[Tick; 2]> {
        Some([self.frames.front()?.tick, self.frames.back()?.tick])
    }

    /// The last tick that is not after `tick`; else the first.
    pub(crate) fn at(&self, tick: Tick) -> Option<SharedFrame> {
        let after = self.frames.partition_point(|frame| frame.tick <= tick);
        self.frames.get(after.saturating_sub(1)).map(Arc::clone)
    }

    /// How everything was at `tick`.
    pub(crate) fn status_at(&self, tick: Tick) -> Option<Arc<str>> {
        let after = self.statuses.partition_point(|(of, _)| *of <= tick);
        let (_, status) = self.statuses.get(after.saturating_sub(1))?;
        Some(Arc::clone(status))
    }

    /// The ticks from `from` to `to`, both included; of more than `most` every n-th.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::fixture::{context, synthetic, tell};
    use crate::state::known::{Known, News};

    fn frames(ticks: [i64; 2]) -> Vec<SharedFrame> {
        let news = tell(&mut Known::new(context()), &synthetic(2), ticks, |_, _| {
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
    fn what_is_older_than_its_span_is_forgotten() {
        let mut history = history(usize::MAX, 1.0);
        for frame in frames([0, 100]) {
            history.push_status(frame.tick, Arc::from("how it was"));
            history.push(frame);
        }
        assert_eq!(history.span(), Some([Tick(39), Tick(99)]));
        assert!(history.statuses.len() <= 62);
    }

    #[test]
    fn it_never_takes_more_than_its_bytes() {
        let most = 200_000;
        let mut history = history(most, 1e9);
        for frame in frames([0, 300]) {
            history.push(frame);
            assert!(history.bytes() <= most);
        }
        let [first, last] = history.span().unwrap();
        assert!(first > Tick(0) && last == Tick(299));
        let held: usize = history.frames.iter().map(|frame| frame.size_bytes()).sum();
        assert_eq!(history.bytes(), held);
    }

    #[test]
    fn a_tick_is_found_or_the_last_before_it_or_the_first() {
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
    fn fusion_that_begins_anew_begins_a_new_history() {
        let mut history = history(usize::MAX, 1e9);
        for frame in frames([100, 110]).into_iter().chain(frames([5, 8])) {
            history.push(frame);
        }
        assert_eq!(history.span(), Some([Tick(5), Tick(7)]));
    }

    #[test]
    fn five_minutes_of_eight_people_are_kept_in_the_memory_that_is_promised() {
        let news = tell(
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
