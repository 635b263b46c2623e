//! The tick and offset of a camera's frame, from the clock or from a trigger's count.

use farfield_proto::message::MAX_CAPTURE_OFFSET_US;
use farfield_proto::tick::Tick;
use farfield_proto::venue::TickFrom;

use super::delivery::Delivery;
use super::tick_clock::TickClock;
use super::{Micros, SECOND_US};

/// Longest time from capture to arrival, microseconds. If a camera reports more, its clock is not
/// synchronised with the venue's.
const MAX_DELAY_US: Micros = SECOND_US;

/// Time between two frames, in count periods, from which a frame was lost without being counted.
const GAP_PERIODS: f64 = 1.5;

/// A frame on arrival: its number and times.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Arrived {
    /// The count of the source.
    pub number: i64,
    /// Time stamp of the driver or stream on its own clock, microseconds.
    pub stamp_us: Option<Micros>,
    /// Capture time reported by the camera, Unix time by its clock, microseconds.
    pub captured_unix_us: Option<Micros>,
    /// Arrival by this machine's clock, microseconds.
    pub now_us: Micros,
}

/// The place of a frame in time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PlacedFrame {
    /// Its tick.
    pub tick: Tick,
    /// Capture time minus tick time, microseconds.
    pub offset_us: i32,
    /// Arrival minus capture, microseconds.
    pub lag_us: Micros,
}

/// Why a frame has no tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Misplaced {
    /// Fusion has not yet sent the time of tick 0.
    #[error("the venue's time is not known yet")]
    NoEpoch,
    /// The trigger has drifted away from the venue's ticks.
    #[error(
        "its frames are {} ms off the ticks of the trigger's count, at most {} ms can be corrected: use one source of time for trigger and clocks",
        offset_us / 1000, MAX_CAPTURE_OFFSET_US / 1000
    )]
    Drifted {
        /// Capture time minus tick time, microseconds.
        offset_us: Micros,
    },
}

/// Time from capture to arrival by the camera's report, microseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MeasuredDelay {
    /// The delay.
    Delay(Micros),
    /// The delay would be this long, so the camera's clock is not the venue's.
    ForeignClock(Micros),
}

/// Assigns ticks to the frames of one live camera.
#[derive(Debug, Clone)]
pub struct FramePlacer {
    tick_from: TickFrom,
    /// The delay set in the venue file.
    delay_us: Option<Micros>,
    /// The delay by the camera's report.
    measured_us: Option<Micros>,
    delivery: Delivery,
    /// Number, tick and capture time of the last frame.
    last: Option<(i64, Tick, Micros)>,
    /// Steps of the clock at the last frame.
    steps: u64,
}

impl FramePlacer {
    /// `delay_us` is the time from capture to arrival or time stamp; `None` uses the camera's
    /// report, or else 0.
    pub fn new(tick_from: TickFrom, delay_us: Option<Micros>) -> Self {
        Self {
            tick_from,
            delay_us,
            measured_us: None,
            delivery: Delivery::default(),
            last: None,
            steps: 0,
        }
    }

    /// Assigns a tick. In clock mode it is the tick nearest to the capture. In count mode the tick
    /// advances by the count, or by the time if that is more. Only the first frame is placed by the
    /// clock, and the first one after a clock step or a drift.
    ///
    /// # Errors
    /// [`Misplaced`]; later frames can be valid again.
    pub fn place(&mut self, frame: Arrived, clock: &TickClock) -> Result<PlacedFrame, Misplaced> {
        let captured_us = self.captured_us(frame, clock);
        if self.steps != clock.steps() {
            // The last tick came from a wrong clock.
            (self.steps, self.last) = (clock.steps(), None);
        }
        let by_clock = clock.tick_at(captured_us).ok_or(Misplaced::NoEpoch)?;
        let tick = match (self.tick_from, self.last) {
            (TickFrom::Count, Some((number, tick, at_us))) => {
                let periods = (captured_us - at_us) as f64 / clock.period_us() as f64;
                let counted = (frame.number - number).max(1);
                let uncounted = periods > counted as f64 - 1.0 + GAP_PERIODS;
                tick + if uncounted {
                    periods.round() as i64
                } else {
                    counted
                }
            }
            _ => by_clock,
        };
        let offset_us = clock
            .after_us(captured_us, tick)
            .ok_or(Misplaced::NoEpoch)?;
        if offset_us.abs() > MAX_CAPTURE_OFFSET_US.into() {
            self.last = None;
            return Err(Misplaced::Drifted { offset_us });
        }
        self.last = Some((frame.number, tick, captured_us));
        Ok(PlacedFrame {
            tick,
            offset_us: offset_us as i32,
            lag_us: (frame.now_us - captured_us).max(0),
        })
    }

    /// Whether the time stamps are unusable, so that arrival times are used.
    pub fn distrusts_stamps(&self) -> bool {
        self.delivery.is_distrusted()
    }

    /// Step of the time stamps' clock since the last call, microseconds, if any.
    pub fn take_step_us(&mut self) -> Option<Micros> {
        self.delivery.take_step_us()
    }

    /// Delay of the quickest frames, by the camera's report.
    pub fn measured_delay(&self) -> Option<MeasuredDelay> {
        self.measured_us.map(|us| match us {
            0..=MAX_DELAY_US => MeasuredDelay::Delay(us),
            _ => MeasuredDelay::ForeignClock(us),
        })
    }

    /// Capture by this machine's clock: the time stamp, if any, converted by the quickest delivery,
    /// minus its delay.
    fn captured_us(&mut self, frame: Arrived, clock: &TickClock) -> Micros {
        let quickest_us = frame.stamp_us.map_or(frame.now_us, |stamp_us| {
            self.delivery.captured_us(stamp_us, frame.now_us)
        });
        if let Some(delay_us) = self.delay_us {
            return quickest_us - delay_us;
        }
        let before_us = self.usable_delay_us();
        if self.delivery.is_distrusted() {
            self.measured_us = None;
        } else if let (Some(stamp_us), Some(unix_us)) = (frame.stamp_us, frame.captured_unix_us)
            && self.delivery.explains(stamp_us)
        {
            let camera_us = unix_us.saturating_sub(clock.correction_us().into());
            self.measured_us = Some(quickest_us.saturating_sub(camera_us));
        }
        let delay_us = self.usable_delay_us();
        if before_us.is_some() != delay_us.is_some() {
            // The last tick belongs to another capture time.
            self.last = None;
        }
        quickest_us - delay_us.unwrap_or(0)
    }

    fn usable_delay_us(&self) -> Option<Micros> {
        match self.measured_delay()? {
            MeasuredDelay::Delay(us) => Some(us),
            MeasuredDelay::ForeignClock(_) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::message::live::LiveBoxes;
    use proptest::prelude::*;

    use super::*;

    fn clock() -> TickClock {
        let mut clock = TickClock::new(50.0);
        let live = LiveBoxes {
            sequence: 0,
            epoch_us: 0,
            clock_correction_us: None,
            heard: None,
            every_nth_tick: 0,
        };
        clock.set(&live, 0);
        clock
    }

    fn arrived(number: i64, stamp_us: Option<Micros>, now_us: Micros) -> Arrived {
        Arrived {
            number,
            stamp_us,
            captured_unix_us: None,
            now_us,
        }
    }

    #[test]
    fn before_the_epoch_is_known_no_frame_has_a_tick() {
        let mut placer = FramePlacer::new(TickFrom::Clock, Some(0));
        let placed = placer.place(arrived(0, None, 5), &TickClock::new(50.0));
        assert_eq!(placed, Err(Misplaced::NoEpoch));
    }

    #[test]
    fn a_free_running_camera_is_placed_at_the_nearest_tick_with_its_offset() {
        let mut placer = FramePlacer::new(TickFrom::Clock, Some(2_000));
        let placed = placer.place(arrived(9, None, 1_009_000), &clock()).unwrap();
        assert_eq!(
            (placed.tick, placed.offset_us, placed.lag_us),
            (Tick(50), 7_000, 2_000)
        );
        let placed = placer.place(arrived(9, None, 1_013_000), &clock()).unwrap();
        assert_eq!((placed.tick, placed.offset_us), (Tick(51), -9_000));
    }

    #[test]
    fn driver_stamps_remove_the_jitter_of_delivery() {
        let mut placer = FramePlacer::new(TickFrom::Clock, Some(0));
        let mut offsets = Vec::new();
        for n in 0..50 {
            let captured = 1_000_000 + n * 20_000;
            let jitter = (n * 7919) % 9000;
            // The driver's clock has another origin.
            let frame = arrived(n, Some(captured - 777_777), captured + 500 + jitter);
            offsets.push(placer.place(frame, &clock()).unwrap().offset_us);
        }
        assert!(offsets.iter().all(|&us| us == 500), "{offsets:?}");
    }

    #[test]
    fn reported_capture_times_count_unless_the_camera_clock_is_foreign() {
        let captured = |delay_us: Micros| {
            let mut placer = FramePlacer::new(TickFrom::Clock, None);
            let frame = Arrived {
                captured_unix_us: Some(1_300_000 - delay_us),
                ..arrived(0, Some(77), 1_300_000)
            };
            let placed = placer.place(frame, &clock()).unwrap();
            (placed.tick, placer.measured_delay().unwrap())
        };
        assert_eq!(captured(140_000), (Tick(58), MeasuredDelay::Delay(140_000)));
        for foreign_us in [-40_000, 3_600_000_000] {
            let delay = MeasuredDelay::ForeignClock(foreign_us);
            assert_eq!(captured(foreign_us), (Tick(65), delay));
        }
    }

    #[test]
    fn a_trigger_count_is_stable_between_two_ticks() {
        let mut placer = FramePlacer::new(TickFrom::Count, Some(0));
        // Captured half a period off the ticks: by the clock it could be either tick.
        for n in 0..20 {
            let wobble = if n % 2 == 0 { -300 } else { 300 };
            let frame = arrived(n, None, 1_010_000 + n * 20_000 + wobble);
            assert_eq!(placer.place(frame, &clock()).unwrap().tick, Tick(50 + n));
        }
    }

    #[test]
    fn counted_and_uncounted_lost_frames_leave_gaps() {
        let mut placer = FramePlacer::new(TickFrom::Count, Some(0));
        let mut tick = |number, now_us| {
            placer
                .place(arrived(number, None, now_us), &clock())
                .unwrap()
                .tick
                .0
        };
        assert_eq!(tick(0, 1_000_000), 50);
        assert_eq!(tick(3, 1_060_000), 53);
        assert_eq!(tick(4, 1_140_000), 57);
        assert_eq!(tick(5, 1_160_000), 58);
    }

    #[test]
    fn a_drifting_trigger_is_refused_with_the_numbers() {
        let mut placer = FramePlacer::new(TickFrom::Count, Some(0));
        // One percent too slow.
        let refused = (0..2000).find_map(|n| {
            let frame = arrived(n, None, 1_000_000 + n * 20_200);
            placer.place(frame, &clock()).err()
        });
        let Some(Misplaced::Drifted { offset_us }) = refused else {
            panic!("{refused:?}")
        };
        assert!(
            offset_us.abs() > Micros::from(MAX_CAPTURE_OFFSET_US),
            "{offset_us}"
        );
    }

    #[test]
    fn a_trigger_is_counted_from_the_corrected_clock() {
        // Symptom to prevent: the first frame was placed before the clock was corrected, and all
        // others counted from it. They were off by the clock's error until the edge ended.
        let mut placer = FramePlacer::new(TickFrom::Count, Some(0));
        let mut clock = clock();
        let frame = |n: i64| arrived(n, None, 1_000_000 + n * 20_000);
        assert_eq!(placer.place(frame(0), &clock).unwrap().tick, Tick(50));
        let corrected = LiveBoxes {
            sequence: 1,
            epoch_us: 0,
            clock_correction_us: Some(-80_000),
            heard: None,
            every_nth_tick: 0,
        };
        assert!(clock.set(&corrected, 1_000_000));
        let placed = placer.place(frame(1), &clock).unwrap();
        assert_eq!((placed.tick, placed.offset_us), (Tick(47), 0));
        assert_eq!(placer.place(frame(2), &clock).unwrap().tick, Tick(48));
    }

    #[test]
    fn a_drifted_trigger_restarts_from_the_clock() {
        let mut placer = FramePlacer::new(TickFrom::Count, Some(0));
        let place = |n: i64| placer.place(arrived(n, None, 1_000_000 + n * 20_200), &clock());
        let refused = (0..2000).map(place).filter(Result::is_err).count();
        // A drift of 0.1 s takes 500 frames.
        assert_eq!(refused, 3);
    }

    proptest! {
        #[test]
        fn by_the_clock_no_offset_is_above_half_a_period(now_us in 0i64..1_000_000_000_000) {
            let mut placer = FramePlacer::new(TickFrom::Clock, Some(0));
            let placed = placer.place(arrived(0, None, now_us), &clock()).unwrap();
            prop_assert!(placed.offset_us.abs() <= 10_000);
        }
    }
}
