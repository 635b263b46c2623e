//! The computing thread: it turns the frames of each tick and the newest boxes into messages.

use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use farfield_node::{clock, service_manager};
use farfield_proto::id::{PersonId, ViewpointIndex};
use farfield_proto::message::live::{BoxEcho, PatchTiming};
use farfield_proto::message::{BoxSet, DETECTION_STAGE, Order};
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;
use tracing::{debug, debug_span};

use super::detection::{DetectionThreads, Pass, Pictures};
use super::frames::SPARE as KEPT_TICKS;
use super::shared::{Shared, TickStart, send_output};
use super::work_watch::Caller;
use crate::live::Micros;
use crate::live::newest_boxes::NewestBoxes;
use crate::live::own_boxes::{Lead, OwnBoxes};
use crate::live::round_robin;
use crate::node::acceleration::Workers;
use crate::node::worker::split_detection;
use crate::pipeline::{EdgeOutput, EdgePipeline, EdgeStage, StepRequest};
use crate::source::Frame;

/// Name of the stage from the capture of a tick to the sending of its last patch.
const CAPTURE_TO_SENT: &str = "capture to sent";
/// Sleep without work, microseconds.
const IDLE_US: Micros = 10_000;
/// The largest timing: its size is used before the real one is known.
const LARGEST_TIMING: PatchTiming = PatchTiming {
    sent_after_us: i32::MIN,
    clock_correction_us: i32::MIN,
    echo: Some(BoxEcho {
        sequence: u32::MAX,
        held_us: u32::MAX,
    }),
};

/// Processes tick after tick.
pub(super) struct Ticker {
    shared: Arc<Shared>,
    pipeline: EdgePipeline,
    viewpoint: ViewpointIndex,
    frames: Vec<Option<Frame>>,
    chosen: Vec<PersonId>,
    /// The people as followed by this edge itself.
    own_boxes: OwnBoxes,
    rate_hz: f64,
    /// Longest time without fusion, microseconds.
    longest_alone_us: Micros,
    laps: Vec<(EdgeStage, u32)>,
    /// The detection threads, if detection needs a network.
    detection: Option<DetectionThreads>,
}

impl Ticker {
    pub(super) fn new(
        shared: Arc<Shared>,
        pipeline: EdgePipeline,
        viewpoint: ViewpointIndex,
        venue: &Venue,
    ) -> Self {
        Self {
            own_boxes: OwnBoxes::default(),
            rate_hz: venue.rate_hz,
            longest_alone_us: (venue.parameters.births.one_view_s * 1e6) as Micros,
            shared,
            pipeline,
            viewpoint,
            frames: Vec::new(),
            chosen: Vec::new(),
            laps: Vec::new(),
            detection: None,
        }
    }

    /// The pipeline.
    pub(super) fn pipeline(&self) -> &EdgePipeline {
        &self.pipeline
    }

    /// Plans with the measured workers and starts the detection threads.
    ///
    /// # Errors
    /// If the network cannot be loaded again.
    pub(super) fn share_work(&mut self, workers: Option<Workers>) -> anyhow::Result<()> {
        if let Some(best) = workers {
            let mut ledger = self.shared.ledger();
            ledger.rate.set_workers(best.workers, best.crops_per_s);
            drop(ledger);
            self.shared.set_workers(best);
        }
        if let Some(parts) = self.pipeline.detach_detection()? {
            let period_us = (1e6 / self.rate_hz).round() as Micros;
            self.detection = Some(DetectionThreads::spawn(&self.shared, parts, period_us)?);
        }
        Ok(())
    }

    /// Works until the edge ends.
    pub(super) fn run(&mut self) {
        while !self.shared.is_stopped() {
            service_manager::note_work();
            let Some((tick, until_us)) = self.next_tick() else {
                self.shared.pause(IDLE_US);
                continue;
            };
            let left_us = until_us - self.shared.clock.now_us();
            let left = Duration::from_micros(left_us.max(0).unsigned_abs());
            self.shared
                .frames
                .wait(tick, left, || self.shared.clock.now_us());
            let Some(start) = self.begin(tick) else {
                continue;
            };
            self.detect_ahead(tick);
            if let Err(error) = self.step(start) {
                debug!(tick = tick.0, error = format!("{error:#}"), "tick not done");
                self.shared.note_failure(&error);
            }
            self.shared.picture_slot.offer(&mut self.frames);
        }
    }

    /// The next tick and the waiting time for its frames; `None` while unknown. Past ticks are
    /// counted as missed.
    fn next_tick(&self) -> Option<(Tick, Micros)> {
        let now_us = self.shared.clock.now_us();
        let lag_us = self.shared.frames.lag_us(now_us);
        let mut ledger = self.shared.ledger();
        ledger.ticks.slew(now_us);
        ledger.boxes.session()?;
        let nth = i64::from(ledger.rate.last_plan().every_nth);
        let half_us = ledger.ticks.period_us() / 2;
        // The last tick whose frames should all be there.
        let due = ledger.ticks.tick_at(now_us - lag_us - half_us)?;
        let next = ledger.last.map_or(due, |last| last + 1);
        let newest = newest_due(next, due, nth);
        ledger.missed += ((newest - aligned(next, nth)) / nth).max(0).unsigned_abs();
        let tick = aligned(newest, nth);
        let tick = tick.min(self.next_pass(&ledger.boxes, newest));
        let until_us = ledger.ticks.own_time_us(tick)? + lag_us + half_us;
        Some((tick, until_us))
    }

    fn begin(&mut self, tick: Tick) -> Option<TickStart> {
        let now_us = self.shared.clock.now_us();
        self.shared.frames.take(tick, now_us, &mut self.frames);
        let mut ledger = self.shared.ledger();
        let session = ledger.boxes.session()?;
        let requested = ledger.boxes.take_detection_request(tick);
        let silent_us = ledger.boxes.silent_us(now_us).unwrap_or(0);
        let lead = self
            .own_boxes
            .lead(silent_us, self.longest_alone_us, now_us);
        let own = ledger.boxes.last().and_then(|last| match lead {
            Lead::Own => self.own_boxes.at(tick, last),
            Lead::HandingBack => self.own_boxes.merged_with(tick, last),
            Lead::Fusion | Lead::Watched => None,
        });
        let in_force = ledger.boxes.at(now_us);
        let regular = self.pipeline.regular_detection_cameras(tick);
        let is_regular = !regular.is_empty();
        let detection_cameras = match in_force {
            Some(_) if !ledger.rate.may_detect(is_regular, now_us) => Vec::new(),
            Some(_) if !is_regular => requested,
            _ => regular,
        };
        let boxes = if let Some(own) = own {
            Arc::new(own)
        } else if let Some(boxes) = in_force {
            Arc::clone(boxes)
        } else {
            // Fusion is gone: an empty box set, so that sightings are stored for later.
            Arc::new(BoxSet {
                session,
                tick,
                viewpoint: self.viewpoint,
                part: 0,
                parts: 1,
                order: Order::Track,
                live: None,
                detection_cameras: Vec::new(),
                persons: Vec::new(),
            })
        };
        let plan = ledger.rate.plan(boxes.persons.len(), now_us);
        let most_crops = boxes.persons.len() + EdgePipeline::count_second_crops(&boxes.persons);
        ledger.last = Some(tick);
        Some(TickStart {
            tick,
            boxes,
            detection_cameras,
            is_watched: lead != Lead::Fusion,
            plan,
            may_send: ledger.rate.may_send(tick, now_us),
            has_time_for_second_crops: ledger.rate.has_time_for(most_crops),
        })
    }

    fn step(&mut self, start: TickStart) -> anyhow::Result<()> {
        let _span = debug_span!("tick", tick = start.tick.0).entered();
        let persons = start.boxes.persons.iter().map(|p| p.person);
        if let Some(most) = start.plan.persons {
            let nth = i64::from(start.plan.every_nth);
            self.chosen.clear();
            if start.tick.0.rem_euclid(nth) == 0 {
                let number = Tick(start.tick.0.div_euclid(nth));
                round_robin::choose(persons, most, number, &mut self.chosen);
            }
        }
        let request = StepRequest {
            tick: start.tick,
            boxes: &start.boxes,
            detection_cameras: match &self.detection {
                Some(_) => &[],
                None => &start.detection_cameras,
            },
            detections: None,
            persons: start.plan.persons.map(|_| &self.chosen[..]),
            timing: Some(LARGEST_TIMING),
        };
        self.pipeline.set_compression_level(start.plan.level);
        self.pipeline
            .set_second_crops(start.has_time_for_second_crops);
        self.pipeline
            .set_message_version(self.shared.message_version());
        self.laps.clear();
        let begun = clock::now();
        let (laps, mut lap) = (&mut self.laps, begun);
        let asked = request
            .persons
            .map_or(start.boxes.persons.len(), <[_]>::len);
        self.shared.begin_work(Caller::Patches, asked);
        let output = self.pipeline.step(&self.frames, &request, &mut |stage| {
            laps.push((stage, clock::micros_since(lap)));
            lap = clock::now();
        });
        self.shared.works.end(Caller::Patches);
        let tick = start.tick;
        let output = output.with_context(|| format!("tick {tick}"))?;
        let pass_us = self.count_laps(!request.detection_cameras.is_empty());
        let sending = clock::now();
        self.send(start, output);
        self.shared.count("messages", clock::micros_since(sending));
        let persons_us = clock::micros_since(begun).saturating_sub(pass_us);
        self.shared
            .count_work(self.pipeline.tracked_crops(), persons_us);
        self.count_delay(tick);
        Ok(())
    }

    /// Sends the patches of a tick, or passes them to a detection pass, which sends them when done.
    fn send(&mut self, start: TickStart, output: EdgeOutput) {
        if start.is_watched {
            let sets = &output.patch_sets;
            self.own_boxes.see(&start.boxes, sets, self.rate_hz);
        } else {
            self.own_boxes.clear();
        }
        let pass = match &self.detection {
            Some(threads) if !start.detection_cameras.is_empty() => {
                threads.detections(start.tick, &start.detection_cameras)
            }
            _ => None,
        };
        let (Some(threads), Some(detections)) = (&self.detection, pass) else {
            return send_output(&self.shared, &start, output);
        };
        let pass = threads.begin(Pass {
            frames: self.frames.clone(),
            start,
            detections,
            output,
        });
        if let Some(Pass { start, output, .. }) = pass {
            send_output(&self.shared, &start, output);
        }
    }

    /// Runs the detector on the pictures of `tick` if the next detection pass needs it.
    fn detect_ahead(&self, tick: Tick) {
        let Some(threads) = &self.detection else {
            return;
        };
        // Without a picture a run would take no time and give a wrong duration.
        if self.frames.iter().all(Option::is_none) {
            return;
        }
        let ledger = self.shared.ledger();
        let nth = i64::from(ledger.rate.last_plan().every_nth);
        let pass = self.next_pass(&ledger.boxes, tick + 1);
        if threads.is_detection_due(tick, pass, nth) {
            let mut cameras = self.pipeline.regular_detection_cameras(pass);
            if let (true, Some((_, asked))) = (
                cameras.is_empty(),
                ledger.boxes.next_detection_request(pass),
            ) {
                cameras = asked.to_vec();
            }
            threads.detect(Pictures {
                tick,
                frames: self.frames.clone(),
                pass,
                cameras,
            });
        }
    }

    /// The first tick with a detection pass, from `from`. Regular passes are known in advance,
    /// because a request of fusion comes late if its boxes are made just before their tick.
    fn next_pass(&self, boxes: &NewestBoxes, from: Tick) -> Tick {
        let regular = aligned(from, self.pipeline.ticks_per_pass());
        let asked = boxes.next_detection_request(from);
        asked.map_or(regular, |(asked, _)| asked.min(regular))
    }

    /// Records the stages; returns the duration of the tick's detection pass, microseconds.
    fn count_laps(&mut self, detects: bool) -> u32 {
        let stages = split_detection(&self.laps, self.pipeline.detection_share());
        let mut pass_us = 0;
        for (stage, us) in stages {
            if stage != DETECTION_STAGE {
                self.shared.count(stage, us);
            } else if detects {
                self.shared.count(stage, us);
                pass_us = us;
            }
        }
        pass_us
    }

    fn count_delay(&self, tick: Tick) {
        let offsets = self.frames.iter().flatten().map(|f| f.capture_offset_us);
        let Some(first_us) = offsets.min() else {
            return;
        };
        let now_us = self.shared.clock.now_us();
        let after_us = self.shared.ledger().ticks.after_us(now_us, tick);
        let delay_us = after_us.unwrap_or(0) - Micros::from(first_us);
        self.shared
            .count(CAPTURE_TO_SENT, delay_us.clamp(0, u32::MAX.into()) as u32);
    }
}

/// The first tick to process, if every `nth` is processed. `next` is the first unprocessed tick,
/// `due` the last whose frames are there. Of past ticks only the newest is processed, while its
/// frames are kept.
fn newest_due(next: Tick, due: Tick, nth: i64) -> Tick {
    let newest = Tick(due.0.div_euclid(nth) * nth);
    let is_kept = usize::try_from(due - newest).is_ok_and(|late| late <= KEPT_TICKS);
    next.max(if is_kept { newest } else { due })
}

/// The first tick from `tick` that is a multiple of `nth`.
fn aligned(tick: Tick, nth: i64) -> Tick {
    tick + (-tick.0).rem_euclid(nth)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_late_edge_takes_the_newest_tick_that_all_share() {
        let next =
            |last: i64, due: i64, nth| aligned(newest_due(Tick(last + 1), Tick(due), nth), nth).0;
        assert_eq!(next(8, 9, 1), 9, "in time");
        assert_eq!(next(8, 8, 1), 9, "waits for the next");
        assert_eq!(next(8, 15, 1), 15, "late");
        assert_eq!(next(8, 13, 4), 12, "a little late, of every fourth");
        assert_eq!(next(8, 11, 4), 12, "waits for the next fourth");
        assert_eq!(next(12, 13, 4), 16);
        assert_eq!(next(0, 30, 32), 32, "the frames of tick 0 are gone");
    }
}
