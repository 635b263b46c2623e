//! The outlet: what it is, its clock, and the newest sample, made once for all inlets.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Duration;

use farfield_proto::tick::Tick;
use rustix_clock::time::{ClockId, clock_gettime};

use super::info::Info;
use super::sample::{channels, opening, unknown_channels, write};
use super::{OLD_VERSION, PLACES, VERSION};
use crate::frame::Frame;
use crate::people::places::Places;
use crate::wall_clock::WallClock;

/// Where more is missing readers of files begin anew, seconds.
const BREAK_S: f64 = 1.0;

/// What an inlet's clock on this machine says too: the time since the machine was started.
pub(super) fn now() -> Duration {
    let since_start = clock_gettime(ClockId::Monotonic);
    // It begins at 0 and only rises.
    let seconds = u64::try_from(since_start.tv_sec).unwrap_or_default();
    let nanoseconds = u32::try_from(since_start.tv_nsec).unwrap_or_default();
    Duration::new(seconds, nanoseconds)
}

/// A frame and its bytes, in each version when the first inlet wants it.
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

/// What all inlets share.
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

    /// What comes before samples of a version.
    pub(super) fn opening(&self, version: u32) -> Vec<u8> {
        opening(version, &self.short_xml)
    }

    /// The sample of `frame` in a version.
    pub(super) fn sample(&self, frame: &Arc<Frame>, version: u32) -> Arc<[u8]> {
        let sample = self.newest(frame);
        let index = usize::from(version == OLD_VERSION);
        let [new, old] = &sample.bytes;
        let (bytes, version) = if index == 0 {
            (new, VERSION)
        } else {
            (old, OLD_VERSION)
        };
        let made = bytes.get_or_init(|| {
            let mut made = Vec::new();
            write(version, sample.stamp_s, &sample.channels, &mut made);
            made.into()
        });
        Arc::clone(made)
    }

    /// Samples of the ticks between `last` and `frame`, of which no frame came, in a version; none where another session
    /// begins, time goes back, or so much is missing that readers see a break.
    pub(super) fn missed(&self, last: &Frame, frame: &Arc<Frame>, version: u32) -> Vec<Arc<[u8]>> {
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
