//! The thread of one camera: it reads frames as they arrive and passes them to their ticks.
//!
//! A recording is played: the frame of a tick is delivered at the tick's time. A source that fails
//! is opened again, at growing intervals.

use std::ops::Range;
use std::sync::Arc;

use farfield_node::process::say;
use farfield_proto::id::CameraIndex;
use farfield_proto::printed::signed;
use farfield_proto::tick::Tick;
use farfield_proto::venue::{Venue, VenueCamera};
use tracing::error_span;

use super::frames::DeliveredFrame;
use super::shared::Shared;
use crate::live::capture::{Arrived, FramePlacer, MeasuredDelay, Misplaced};
use crate::live::health::{PictureSample, sample_picture};
use crate::live::{Micros, SECOND_US};
use crate::source::{Frame, FrameContent, FrameSource, SourceError, Sources};

/// Interval of checks for the venue's time.
const CHECK_EVERY_US: Micros = 10_000;
/// A recording is opened this long before its first tick. A longer wait means that the clock was
/// set back.
const AHEAD_US: Micros = 2 * SECOND_US;
/// Frames of a recording that are later than this many periods are dropped.
const LATE_PERIODS: i64 = 2;

/// A camera and the destination of its frames.
pub(super) struct LiveCamera {
    pub(super) shared: Arc<Shared>,
    pub(super) venue: Arc<Venue>,
    pub(super) sources: Arc<dyn Sources>,
    pub(super) index: CameraIndex,
    /// Index of the camera in the viewpoint.
    pub(super) at: usize,
}

/// Why a source is no longer read.
enum Pause {
    /// The edge ends.
    Stopped,
    /// The recording is over or has not started.
    NoTick,
    /// The source failed.
    Failed(SourceError),
}

impl LiveCamera {
    /// Reads until the edge ends.
    pub(super) fn run(self) {
        let Some(camera) = self.venue.camera(self.index).cloned() else {
            return;
        };
        let _span = error_span!("camera", name = camera.model.name()).entered();
        // A message is printed again only if it changed.
        let mut reported = String::new();
        while !self.shared.is_stopped() {
            let pause = if camera.source.is_live() {
                self.watch(&camera)
            } else {
                self.play(&camera)
            };
            match pause {
                Pause::Stopped => return,
                Pause::NoTick => drop(self.shared.pause(CHECK_EVERY_US)),
                Pause::Failed(error) => {
                    let text = error.to_string();
                    let wait_us = self.shared.frames.failed(self.at, &text);
                    if text != reported {
                        say(format_args!("{text}; it is opened again until it works"));
                        reported = text;
                    }
                    if !self.shared.pause(wait_us) {
                        return;
                    }
                }
            }
        }
    }

    /// Plays a recording from the current tick.
    fn play(&self, camera: &VenueCamera) -> Pause {
        let ticks = match self.sources.probe(camera, &self.venue) {
            Ok(info) => info.ticks,
            Err(error) => return Pause::Failed(error),
        };
        let Some(ticks) = ticks else {
            return Pause::NoTick;
        };
        let mut from = None;
        while from.is_none() {
            if !self.shared.pause(CHECK_EVERY_US) {
                return Pause::Stopped;
            }
            from = self.next_tick(&ticks);
        }
        let source = self
            .sources
            .open(camera, &self.venue, from.unwrap_or(ticks.start));
        let mut source = match source {
            Ok(source) => source,
            Err(error) => return Pause::Failed(error),
        };
        loop {
            match source.next_frame() {
                Ok(Some(frame)) => {
                    if let Err(pause) = self.show(frame) {
                        return pause;
                    }
                }
                Ok(None) => return Pause::NoTick,
                Err(error) => return Pause::Failed(error),
            }
        }
    }

    /// The tick at which to open a recording; `None` before its start and after its end.
    fn next_tick(&self, ticks: &Range<Tick>) -> Option<Tick> {
        let now_us = self.shared.clock.now_us();
        let ledger = self.shared.ledger();
        let first_us = ledger.ticks.own_time_us(ticks.start)?;
        let next = (ledger.ticks.tick_at(now_us)? + 1).max(ticks.start);
        (first_us - now_us <= AHEAD_US && next < ticks.end).then_some(next)
    }

    /// Delivers a recorded frame at its time.
    fn show(&self, frame: Frame) -> Result<(), Pause> {
        let offset_us = Micros::from(frame.capture_offset_us);
        let (due_us, period_us) = {
            let ledger = self.shared.ledger();
            let due_us = ledger.ticks.own_time_us(frame.tick);
            (
                due_us.ok_or(Pause::NoTick)? + offset_us,
                ledger.ticks.period_us(),
            )
        };
        let now_us = self.shared.clock.now_us();
        if due_us - now_us > AHEAD_US {
            return Err(Pause::NoTick);
        }
        if now_us - due_us > LATE_PERIODS * period_us {
            return Ok(());
        }
        let picture_sample = sample_of(&frame.content);
        if !self.shared.sleep_until(due_us) {
            return Err(Pause::Stopped);
        }
        let delivery = DeliveredFrame {
            frame,
            picture_sample,
            lag_us: 0,
        };
        self.shared
            .frames
            .put(self.at, delivery, self.shared.clock.now_us());
        Ok(())
    }

    /// Reads a live source.
    fn watch(&self, camera: &VenueCamera) -> Pause {
        let mut source = match self.sources.open(camera, &self.venue, Tick(0)) {
            Ok(source) => source,
            Err(error) => return Pause::Failed(error),
        };
        let delay_us = camera.capture_delay_s.map(|s| (s * 1e6).round() as Micros);
        let mut placer = FramePlacer::new(camera.tick_from, delay_us);
        let mut reported = ReportedTimes::default();
        loop {
            let frame = match source.next_frame() {
                Ok(Some(frame)) => frame,
                Ok(None) => return Pause::NoTick,
                Err(error) => return Pause::Failed(error),
            };
            if self.shared.is_stopped() {
                return Pause::Stopped;
            }
            let placed = self.place(frame, source.as_ref(), &mut placer);
            let most_us = self.shared.frames.most_lag_us();
            for news in reported.news(placed, most_us, &mut placer) {
                say(format_args!("camera `{}`: {news}", camera.model.name()));
            }
        }
    }

    /// Delivers a live frame to its tick; returns its delay after capture, microseconds.
    fn place(
        &self,
        frame: Frame,
        source: &dyn FrameSource,
        placer: &mut FramePlacer,
    ) -> Result<Micros, Misplaced> {
        let now_us = self.shared.clock.now_us();
        let arrived = Arrived {
            number: frame.tick.0,
            stamp_us: source.stamp_us(),
            captured_unix_us: source.captured_unix_us(),
            now_us,
        };
        let placed = placer.place(arrived, &self.shared.ledger().ticks)?;
        let picture_sample = sample_of(&frame.content);
        let frame = Frame {
            tick: placed.tick,
            capture_offset_us: placed.offset_us,
            ..frame
        };
        let delivery = DeliveredFrame {
            frame,
            picture_sample,
            lag_us: placed.lag_us,
        };
        self.shared.frames.put(self.at, delivery, now_us);
        Ok(placed.lag_us)
    }
}

/// Reports about the times of a live camera that are made once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Report {
    Late,
    Distrusted,
    Delay,
    ForeignClock,
}

/// Reports made about the times of a live camera.
#[derive(Debug, Default)]
struct ReportedTimes {
    once: Vec<Report>,
    /// Whether the last frame was misplaced; each start of this state is reported.
    is_misplaced: bool,
}

impl ReportedTimes {
    fn is_new(&mut self, report: Report) -> bool {
        let is_new = !self.once.contains(&report);
        if is_new {
            self.once.push(report);
        }
        is_new
    }

    /// New reports after a frame was `placed`, or its delay after capture, microseconds; frames are
    /// waited for at most `most_us`.
    fn news(
        &mut self,
        placed: Result<Micros, Misplaced>,
        most_us: Micros,
        placer: &mut FramePlacer,
    ) -> Vec<String> {
        let mut news = Vec::new();
        if let Some(lag_us) = placed.ok().filter(|lag_us| *lag_us > most_us)
            && self.is_new(Report::Late)
        {
            news.push(format!(
                "its pictures arrive {} ms after their capture, but `deadline_ms` in [link] is {}: they are not used",
                lag_us / 1000,
                most_us / 1000
            ));
        }
        if placer.distrusts_stamps() && self.is_new(Report::Distrusted) {
            news.push("the times in its stream do not advance like a clock; the arrival times of its pictures are used".to_owned());
        }
        if let Some(step_us) = placer.take_step_us() {
            news.push(format!(
                "the clock of its stream was set by {} s relative to this machine's; its times are measured again",
                signed(step_us as f64 / 1e6, 1)
            ));
        }
        match placer.measured_delay() {
            Some(MeasuredDelay::Delay(us)) if self.is_new(Report::Delay) => {
                let ms = us / 1000;
                news.push(format!(
                    "its pictures arrive {ms} ms after their capture, by its sender reports"
                ));
            }
            Some(MeasuredDelay::ForeignClock(us)) if self.is_new(Report::ForeignClock) => {
                let off_s = signed(us as f64 / -1e6, 3);
                news.push(format!(
                    "its clock is {off_s} s off, so its sender reports do not give the delay of its pictures: set the venue's NTP server on it, or set `capture_delay_ms`"
                ));
            }
            _ => {}
        }
        let misplaced = placed.err();
        if let (Some(why @ Misplaced::Drifted { .. }), false) = (misplaced, self.is_misplaced) {
            news.push(why.to_string());
        }
        self.is_misplaced = misplaced.is_some();
        news
    }
}

fn sample_of(content: &FrameContent) -> Option<PictureSample> {
    match content {
        FrameContent::Image(image) => Some(sample_picture(image)),
        FrameContent::Painted(maps) => maps
            .picture_sample()
            .map(|(hash, mean)| PictureSample { hash, mean }),
        FrameContent::Keypoints(_) => None,
    }
}
