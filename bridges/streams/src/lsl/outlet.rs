//! The outlet: its description, its clock, the newest sample, encoded once for all inlets, and the
//! queue of an inlet.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Duration;

use farfield_proto::tick::Tick;
use rustix_clock::time::{ClockId, clock_gettime};

use super::info::Info;
use super::sample::{channels, opening, unknown_channels, write};
use super::{OLD_VERSION, PLACES, VERSION};
use crate::frame::Frame;
use crate::people::Places;
use crate::wall_clock::WallClock;

/// Gap that readers of files treat as a break, seconds.
const BREAK_S: f64 = 1.0;

/// The outlet's clock: time since the start of the machine, as for inlets on it.
pub(super) fn now() -> Duration {
    let since_start = clock_gettime(ClockId::Monotonic);
    // It starts at 0 and only increases.
    let seconds = u64::try_from(since_start.tv_sec).unwrap_or_default();
    let nanoseconds = u32::try_from(since_start.tv_nsec).unwrap_or_default();
    Duration::new(seconds, nanoseconds)
}

/// A frame and its bytes, encoded per version at the first request.
#[derive(Debug)]
struct Sample {
    frame: Arc<Frame>,
    stamp_s: f64,
    channels: Vec<f32>,
    bytes: [OnceLock<Arc<[u8]>>; 2],
}

#[derive(Debug)]
struct Newest {
    clock: WallClock,
    places: Places,
    sample: Option<Arc<Sample>>,
}

/// State shared by all inlets.
#[derive(Debug)]
pub(super) struct Outlet {
    pub(super) info: Info,
    pub(super) short_xml: String,
    pub(super) full_xml: String,
    newest: Mutex<Newest>,
}

impl Outlet {
    pub(super) fn new(info: Info) -> Self {
        Self {
            short_xml: info.short_xml(),
            full_xml: info.full_xml(),
            info,
            newest: Mutex::new(Newest {
                clock: WallClock::default(),
                places: Places::new(PLACES),
                sample: None,
            }),
        }
    }

    /// The bytes before the samples, for a version.
    pub(super) fn opening(&self, version: u32) -> Vec<u8> {
        opening(version, &self.short_xml)
    }

    /// The sample of `frame`, for a version.
    pub(super) fn sample(&self, frame: &Arc<Frame>, version: u32) -> Arc<[u8]> {
        let sample = self.newest(frame);
        let index = usize::from(version == OLD_VERSION);
        let [new, old] = &sample.bytes;
        let (bytes, version) = if index == 0 {
            (new, VERSION)
        } else {
            (old, OLD_VERSION)
        };
        let encoded = bytes.get_or_init(|| {
            let mut encoded = Vec::new();
            write(version, sample.stamp_s, &sample.channels, &mut encoded);
            encoded.into()
        });
        Arc::clone(encoded)
    }

    /// Samples of the ticks between `last` and `frame` without frames, for a version. None for
    /// another session, decreasing time, or a gap that readers treat as a break.
    pub(super) fn missing(&self, last: &Frame, frame: &Arc<Frame>, version: u32) -> Vec<Arc<[u8]>> {
        let apart_s = frame.elapsed_s - last.elapsed_s;
        if last.session != frame.session || !(0.0..BREAK_S).contains(&apart_s) {
            return Vec::new();
        }
        let stamp_s = self.newest(frame).stamp_s;
        let unknown = |tick: i64| {
            let before_s = (frame.tick.0 - tick) as f64 / frame.rate_hz;
            let mut bytes = Vec::new();
            let unknown = unknown_channels(Tick(tick));
            write(version, stamp_s - before_s, &unknown, &mut bytes);
            bytes.into()
        };
        let ticks = last.tick.0.saturating_add(1)..frame.tick.0;
        ticks.map(unknown).collect()
    }

    fn newest(&self, frame: &Arc<Frame>) -> Arc<Sample> {
        let mut newest = self.newest.lock().unwrap_or_else(PoisonError::into_inner);
        match &newest.sample {
            Some(sample) if Arc::ptr_eq(&sample.frame, frame) => Arc::clone(sample),
            _ => {
                newest.places.assign(frame.roster.ids());
                let stamp = newest.clock.stamp(frame.elapsed_s, now());
                let sample = Arc::new(Sample {
                    frame: Arc::clone(frame),
                    stamp_s: stamp.as_secs_f64(),
                    channels: channels(frame, &newest.places),
                    bytes: Default::default(),
                });
                newest.sample = Some(Arc::clone(&sample));
                sample
            }
        }
    }
}

/// Maximum waiting time of samples, seconds; readers of files treat a larger gap as a break.
const LONGEST_S: f64 = 1.0;

/// Samples in order; the first may be partially sent.
#[derive(Debug, Default)]
pub(super) struct Unsent {
    samples: VecDeque<Arc<[u8]>>,
    /// Number of sent bytes of the first sample.
    sent: usize,
}

impl Unsent {
    /// Adds a sample of a stream of `rate_hz`. If too many wait, drops them first; returns the
    /// number of dropped ones.
    pub(super) fn push(&mut self, sample: Arc<[u8]>, rate_hz: f64) -> u64 {
        let most = (LONGEST_S * rate_hz).ceil() as usize;
        let mut dropped = 0;
        if self.samples.len() > most {
            // Finish a partially sent sample.
            let begun = usize::from(self.sent > 0);
            dropped = self.samples.len() - begun;
            self.samples.truncate(begun);
        }
        self.samples.push_back(sample);
        dropped as u64
    }

    /// The next bytes; empty if nothing waits.
    pub(super) fn next(&self) -> &[u8] {
        let first = self.samples.front();
        first
            .and_then(|sample| sample.get(self.sent..))
            .unwrap_or_default()
    }

    /// Records that `n` bytes were sent; returns whether a sample was completed.
    pub(super) fn sent(&mut self, n: usize) -> bool {
        self.sent += n;
        let is_whole = self
            .samples
            .front()
            .is_some_and(|sample| self.sent >= sample.len());
        if is_whole {
            self.samples.pop_front();
            self.sent = 0;
        }
        is_whole
    }

    /// Whether nothing waits.
    pub(super) fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE_HZ: f64 = 60.0;
    const BYTES: usize = 100;

    fn sample(number: u8) -> Arc<[u8]> {
        [number; BYTES].into()
    }

    /// Numbers of the samples received in a minute by an inlet that accepts the share `share` of
    /// the stream.
    fn received_with(share: f64) -> Vec<usize> {
        let (mut unsent, mut room, mut got) = (Unsent::default(), 0.0, Vec::new());
        for tick in 0..3600_usize {
            let mut bytes = vec![0; BYTES];
            bytes[..8].copy_from_slice(&tick.to_le_bytes());
            unsent.push(bytes.into(), RATE_HZ);
            room += share * BYTES as f64;
            while room >= 1.0 && !unsent.is_empty() {
                let next = unsent.next();
                let n = next.len().min(room as usize);
                let number = (next.len() == BYTES).then(|| next[..8].try_into().unwrap());
                got.extend(number.map(usize::from_le_bytes));
                unsent.sent(n);
                room -= n as f64;
            }
        }
        got
    }

    #[test]
    fn a_slow_inlet_gets_most_poses_with_few_gaps() {
        let got = received_with(0.9);
        println!("{} of 3600 samples", got.len());
        assert!(got.len() > 3200, "{}", got.len());
        let gaps: Vec<usize> = got.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let wide: Vec<usize> = gaps.into_iter().filter(|gap| *gap != 1).collect();
        assert!(
            wide.len() <= 6 && wide.iter().all(|gap| *gap >= 60),
            "{wide:?}"
        );
    }

    #[test]
    fn a_fast_inlet_receives_all_samples() {
        let got = received_with(1.0);
        assert!(got.len() >= 3599 && got.windows(2).all(|pair| pair[1] == pair[0] + 1));
    }

    #[test]
    fn a_partially_sent_sample_is_always_finished() {
        let mut unsent = Unsent::default();
        assert_eq!(unsent.push(sample(0), 2.0), 0);
        assert!(!unsent.sent(30));
        assert_eq!(
            (1..3).map(|it| unsent.push(sample(it), 2.0)).sum::<u64>(),
            0
        );
        assert_eq!(unsent.push(sample(3), 2.0), 2);
        assert_eq!(unsent.next(), [0; 70]);
        assert!(unsent.sent(70));
        assert_eq!(unsent.next(), [3; 100]);
        assert!(unsent.sent(100) && unsent.is_empty());
    }
}
