//! The newest frames of each camera, waiting for their tick.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use farfield_proto::id::CameraIndex;
use farfield_proto::message::live::{CameraHealth, CameraStatus};
use farfield_proto::tick::Tick;
use farfield_proto::wire::cut_reason;

use crate::live::Micros;
use crate::live::health::{CameraWatch, PictureSample};
use crate::source::Frame;

/// Frames kept per camera in addition to those needed to wait for slower cameras. The pipeline can
/// be late by this many ticks.
pub(super) const SPARE: usize = 4;
/// Most frames kept per camera: pictures take gigabytes.
const MAX_FRAMES: usize = 64;
/// Share by which the usual lag of a camera is updated, and a hitch decays, per frame.
const LAG_SHARE: f64 = 0.02;
/// Longest wait beyond the usual lag of a camera, periods. A camera that stalls delays the others
/// only briefly.
const MAX_HITCH_PERIODS: i64 = 4;

/// A frame delivered by a camera's thread.
pub(super) struct DeliveredFrame {
    pub(super) frame: Frame,
    /// Set if the frame has a picture.
    pub(super) picture_sample: Option<PictureSample>,
    /// Time since its capture, microseconds.
    pub(super) lag_us: Micros,
}

/// The newest frames of all cameras of the viewpoint.
pub(super) struct FrameStore {
    slots: Mutex<Vec<Slot>>,
    changed: Condvar,
    /// Longest wait for frames after their tick, microseconds.
    most_lag_us: Micros,
    most_hitch_us: Micros,
    kept: usize,
}

struct Slot {
    camera: CameraIndex,
    frames: VecDeque<Frame>,
    watch: CameraWatch,
    lag: Lag,
    /// Reason of the failure, until the camera delivers pictures again.
    reason: Option<String>,
}

/// Delay of a camera's frames after capture, microseconds.
#[derive(Debug, Clone, Copy, Default)]
struct Lag {
    /// Running mean; `None` before the first frame.
    usual_us: Option<f64>,
    /// Largest recent excess over the mean.
    hitch_us: f64,
}

impl Lag {
    fn add(&mut self, lag_us: Micros, most_hitch_us: Micros) {
        let lag_us = lag_us.max(0) as f64;
        let usual_us = self.usual_us.get_or_insert(lag_us);
        *usual_us += (lag_us - *usual_us) * LAG_SHARE;
        let hitch_us = (lag_us - *usual_us).min(most_hitch_us as f64);
        self.hitch_us = (self.hitch_us * (1.0 - LAG_SHARE)).max(hitch_us);
    }

    fn us(&self) -> Micros {
        (self.usual_us.unwrap_or(0.0) + self.hitch_us) as Micros
    }
}

impl FrameStore {
    /// For frames every `period_us`. Slow cameras are waited for up to `most_lag_us` after their
    /// tick.
    pub(super) fn new(cameras: &[CameraIndex], period_us: Micros, most_lag_us: Micros) -> Self {
        let waiting = usize::try_from(most_lag_us / period_us.max(1)).unwrap_or(0);
        let slot = |&camera: &CameraIndex| Slot {
            camera,
            frames: VecDeque::new(),
            watch: CameraWatch::new(period_us),
            lag: Lag::default(),
            reason: None,
        };
        Self {
            slots: Mutex::new(cameras.iter().map(slot).collect()),
            changed: Condvar::new(),
            most_lag_us,
            most_hitch_us: MAX_HITCH_PERIODS * period_us,
            kept: waiting.saturating_add(SPARE).min(MAX_FRAMES),
        }
    }

    /// Longest wait for frames after their tick, microseconds.
    pub(super) fn most_lag_us(&self) -> Micros {
        self.most_lag_us
    }

    /// Stores a frame of the camera at index `at`; drops the oldest if there are too many.
    pub(super) fn put(&self, at: usize, delivery: DeliveredFrame, now_us: Micros) {
        let mut slots = self.lock();
        let Some(slot) = slots.get_mut(at) else {
            return;
        };
        slot.watch.record(
            delivery.picture_sample,
            delivery.frame.capture_offset_us,
            now_us,
        );
        slot.reason = None;
        slot.lag.add(delivery.lag_us, self.most_hitch_us);
        // If a tick is delivered twice or again, the newest frame counts.
        slot.frames.retain(|kept| kept.tick < delivery.frame.tick);
        if slot.frames.len() == self.kept {
            slot.frames.pop_front();
        }
        slot.frames.push_back(delivery.frame);
        drop(slots);
        self.changed.notify_all();
    }

    /// Records a failure of a camera and its reason; returns the time until it is opened again,
    /// microseconds.
    pub(super) fn failed(&self, at: usize, why: &str) -> Micros {
        let mut slots = self.lock();
        let wait_us = slots.get_mut(at).map(|slot| {
            slot.reason = Some(cut_reason(why.to_owned()));
            slot.watch.failed()
        });
        wait_us.unwrap_or(Micros::MAX)
    }

    /// Time from a tick until the frames of all working cameras should be there, microseconds.
    pub(super) fn lag_us(&self, now_us: Micros) -> Micros {
        let slots = self.lock();
        let delivering = slots
            .iter()
            .filter(|slot| delivers(slot.watch.health(now_us)));
        let lags_us = delivering.map(|slot| slot.lag.us());
        lags_us.max().unwrap_or(0).min(self.most_lag_us)
    }

    /// Waits at most `timeout` until every working camera has a frame of `tick`; returns whether
    /// this is so. `now_us` reads the clock.
    pub(super) fn wait(&self, tick: Tick, timeout: Duration, now_us: impl Fn() -> Micros) -> bool {
        let is_there = |slots: &mut Vec<Slot>| {
            let now_us = now_us();
            let mut delivering = slots
                .iter()
                .filter(|slot| delivers(slot.watch.health(now_us)))
                .peekable();
            delivering.peek().is_some()
                && delivering.all(|slot| slot.frames.back().is_some_and(|f| f.tick >= tick))
        };
        let waited = self
            .changed
            .wait_timeout_while(self.lock(), timeout, |slots| !is_there(slots));
        let (slots, result) = waited.unwrap_or_else(PoisonError::into_inner);
        drop(slots);
        !result.timed_out()
    }

    /// Takes the frames of `tick`, one per camera. `None` stands for a missing frame or a camera
    /// whose picture is not usable. Earlier frames are dropped.
    pub(super) fn take(&self, tick: Tick, now_us: Micros, into: &mut Vec<Option<Frame>>) {
        into.clear();
        let mut slots = self.lock();
        into.extend(slots.iter_mut().map(|slot| {
            while slot.frames.front().is_some_and(|frame| frame.tick < tick) {
                slot.frames.pop_front();
            }
            let is_there = slot.frames.front().is_some_and(|frame| frame.tick == tick);
            let frame = is_there.then(|| slot.frames.pop_front()).flatten();
            let blind = [CameraHealth::Black, CameraHealth::Frozen];
            frame.filter(|_| !blind.contains(&slot.watch.health(now_us)))
        }));
    }

    /// The status of the cameras.
    pub(super) fn status(&self, now_us: Micros) -> Vec<CameraStatus> {
        let mut slots = self.lock();
        let status = |slot: &mut Slot| {
            let (frames_per_s, capture_offset_us) = slot.watch.rate(now_us);
            CameraStatus {
                camera: slot.camera,
                health: slot.watch.health(now_us),
                frames_per_s,
                capture_offset_us,
                reason: slot.reason.clone(),
            }
        };
        slots.iter_mut().map(status).collect()
    }

    /// Wakes the waiting threads.
    pub(super) fn wake(&self) {
        self.changed.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Slot>> {
        self.slots.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Whether the camera delivers frames.
fn delivers(health: CameraHealth) -> bool {
    !matches!(health, CameraHealth::Silent | CameraHealth::Failed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::{FrameContent, KeypointFrame};

    const PERIOD: Micros = 16_667;

    fn store() -> FrameStore {
        FrameStore::new(&[CameraIndex(4), CameraIndex(5)], PERIOD, 6 * PERIOD)
    }

    fn put(store: &FrameStore, at: usize, tick: i64, picture_sample: Option<PictureSample>) {
        let frame = Frame {
            tick: Tick(tick),
            capture_offset_us: 100,
            content: FrameContent::Keypoints(KeypointFrame::default()),
        };
        let delivery = DeliveredFrame {
            frame,
            picture_sample,
            lag_us: 3_000,
        };
        store.put(at, delivery, tick * PERIOD);
    }

    fn ticks(store: &FrameStore, tick: i64) -> Vec<Option<i64>> {
        let mut frames = Vec::new();
        store.take(Tick(tick), tick * PERIOD, &mut frames);
        frames
            .iter()
            .map(|f| f.as_ref().map(|f| f.tick.0))
            .collect()
    }

    fn is_there(store: &FrameStore, tick: i64, now: i64) -> bool {
        store.wait(Tick(tick), Duration::ZERO, || now * PERIOD)
    }

    #[test]
    fn frames_wait_for_their_tick_and_late_ones_are_dropped() {
        let store = store();
        for tick in 1..=3 {
            put(&store, 0, tick, None);
        }
        put(&store, 1, 2, None);
        assert_eq!(ticks(&store, 2), [Some(2), Some(2)]);
        assert_eq!(ticks(&store, 3), [Some(3), None]);
        assert_eq!(ticks(&store, 3), [None, None]);
    }

    #[test]
    fn only_cameras_that_deliver_are_waited_for() {
        let store = store();
        assert!(!is_there(&store, 1, 1));
        put(&store, 0, 1, None);
        assert!(is_there(&store, 1, 1));
        put(&store, 1, 0, None);
        assert!(!is_there(&store, 1, 1));
        store.failed(1, "unplugged");
        assert!(is_there(&store, 1, 1));
    }

    #[test]
    fn a_store_without_a_consumer_stays_small() {
        let store = store();
        for tick in 0..1000 {
            put(&store, 0, tick, None);
        }
        assert_eq!(store.lock()[0].frames.len(), 10);
        assert_eq!(store.lag_us(1000 * PERIOD), 3_000);
    }

    #[test]
    fn the_frames_of_a_fast_camera_wait_for_those_of_a_slow_one() {
        let store = store();
        for tick in 1..=9 {
            put(&store, 0, tick, None);
        }
        put(&store, 1, 3, None);
        assert_eq!(ticks(&store, 3), [Some(3), Some(3)]);
    }

    #[test]
    fn a_slow_camera_is_waited_for_but_a_stalled_one_only_briefly() {
        let lag_after = |lags_us: &[Micros]| {
            let mut lag = Lag::default();
            for us in lags_us {
                lag.add(*us, 4 * PERIOD);
            }
            lag.us()
        };
        assert_eq!(lag_after(&[150_000; 100]), 150_000);
        let hitch = [[3_000; 50].as_slice(), &[400_000]].concat();
        assert!(lag_after(&hitch) < 80_000);
        let over = [hitch.as_slice(), &[3_000; 300]].concat();
        assert!(lag_after(&over) < 6_000);
    }

    #[test]
    fn a_failed_camera_delays_no_tick() {
        let store = store();
        put(&store, 0, 1, None);
        assert_eq!(store.lag_us(PERIOD), 3_000);
        store.failed(0, "unplugged");
        assert_eq!(store.lag_us(PERIOD), 0);
    }

    #[test]
    fn fake_a_black_camera_is_left_out_and_named_in_the_status() {
        let store = store();
        let black = PictureSample { hash: 1, mean: 0.0 };
        put(&store, 0, 7, Some(black));
        put(
            &store,
            1,
            7,
            Some(PictureSample {
                hash: 2,
                mean: 90.0,
            }),
        );
        assert_eq!(ticks(&store, 7), [None, Some(7)]);
        let status = store.status(7 * PERIOD);
        let health: Vec<_> = status.iter().map(|s| (s.camera.0, s.health)).collect();
        assert_eq!(health, [(4, CameraHealth::Black), (5, CameraHealth::Works)]);
    }
}
