//! The thread that computes: the frames of a tick and the newest boxes in, messages out, tick after tick.

use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use farfield_node::clock;
use farfield_proto::id::{CameraIndex, PersonId, ViewpointIndex};
use farfield_proto::message::fill::SetKind;
use farfield_proto::message::live::{BoxEcho, PatchTiming};
use farfield_proto::message::{BoxSet, Order};
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;
use tracing::debug;

use super::shared::Shared;
use crate::live::Micros;
use crate::live::own_boxes::{Lead, OwnBoxes};
use crate::live::rate::{MessageKind, SendPlan};
use crate::live::round_robin;
use crate::node::stage_times::split_detection;
use crate::pipeline::{EdgeOutput, EdgePipeline, EdgeStage, StepRequest};
use crate::ring::record::Label;
use crate::source::Frame;

/// Name of the stage from the capture of a tick to the sending of its last patch.
const CAPTURE_TO_SENT: &str = "capture to sent";
/// How long it waits where there is nothing to wait for, microseconds.
const IDLE_US: Micros = 10_000;
/// Ticks in a row that may fail; after more the edge gives up.
const MAX_FAILURES: u32 = 60;
/// The largest timing: what messages are measured with before their own is known.
const LARGEST_TIMING: PatchTiming = PatchTiming {
    sent_after_us: i32::MIN,
    clock_correction_us: i32::MIN,
    echo: Some(BoxEcho {
        sequence: u32::MAX,
        held_us: u32::MAX,
    }),
};

/// Works on tick after tick.
pub(super) struct Ticker {
    shared: Arc<Shared>,
    pipeline: EdgePipeline,
    viewpoint: ViewpointIndex,
    frames: Vec<Option<Frame>>,
    chosen: Vec<PersonId>,
    /// The people as this edge follows them itself.
    own_boxes: OwnBoxes,
    rate_hz: f64,
    /// For how long it does without fusion, microseconds.
    longest_alone_us: Micros,
    laps: Vec<(EdgeStage, u32)>,
    failures: u32,
}

/// What is known at the start of a tick.
struct TickStart {
    tick: Tick,
    boxes: Arc<BoxSet>,
    detection_cameras: Vec<CameraIndex>,
    /// Whether fusion is silent, so that it must be watched where people go.
    is_watched: bool,
    plan: SendPlan,
    may_send: bool,
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
            failures: 0,
        }
    }

    /// What it works with.
    pub(super) fn pipeline(&self) -> &EdgePipeline {
        &self.pipeline
    }

    /// Works until the edge ends.
    ///
    /// # Errors
    /// When the pipeline fails tick after tick.
    pub(super) fn run(&mut self) -> anyhow::Result<()> {
        while !self.shared.is_stopped() {
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
            match self.step(&start) {
                Ok(()) => self.failures = 0,
                Err(error) if self.failures < MAX_FAILURES => {
                    debug!(tick = tick.0, error = format!("{error:#}"), "tick not done");
                    self.failures += 1;
                    self.shared.ledger().missed += 1;
                }
                Err(error) => return Err(error),
            }
            self.shared.desk.offer(&mut self.frames);
        }
        Ok(())
    }

    /// The tick to work on next, and how long its frames are waited for; `None` while nobody knows.
    /// Ticks that are over are counted and left out.
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
        let tick = match ledger.last {
            Some(last) if last + 1 < due => {
                let over = due - last - 1;
                ledger.missed += (over / nth).unsigned_abs();
                due
            }
            Some(last) => last + 1,
            None => due,
        };
        let aligned =
            Tick(tick.0.div_euclid(nth) * nth + if tick.0.rem_euclid(nth) == 0 { 0 } else { nth });
        // Detection passes are planned for all viewpoints alike.
        let detection = ledger.boxes.next_detection_tick(tick);
        let aligned = detection.map_or(aligned, |tick| aligned.min(tick));
        let until_us = ledger.ticks.own_time_us(aligned)? + lag_us + half_us;
        Some((aligned, until_us))
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
            Lead::HandingBack => self.own_boxes.beside(tick, last),
            Lead::Fusion | Lead::Watched => None,
        });
        let in_force = ledger.boxes.at(now_us);
        let regular = self.pipeline.regular_detection_cameras(tick);
        let detection_cameras = if in_force.is_none() {
            regular
        } else if ledger.rate.may_detect(!regular.is_empty(), now_us) {
            requested
        } else {
            Vec::new()
        };
        let boxes = if let Some(own) = own {
            Arc::new(own)
        } else if let Some(boxes) = in_force {
            Arc::clone(boxes)
        } else {
            // Fusion is gone: what there is to see is for whoever asks for it later.
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
        ledger.last = Some(tick);
        Some(TickStart {
            tick,
            boxes,
            detection_cameras,
            is_watched: lead != Lead::Fusion,
            plan,
            may_send: ledger.rate.may_send(tick, now_us),
        })
    }

    fn step(&mut self, start: &TickStart) -> anyhow::Result<()> {
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
            detection_cameras: &start.detection_cameras,
            persons: start.plan.persons.map(|_| &self.chosen[..]),
            timing: Some(LARGEST_TIMING),
        };
        self.pipeline.set_compression_level(start.plan.level);
        self.pipeline
            .set_message_version(self.shared.message_version());
        self.laps.clear();
        let (laps, mut lap) = (&mut self.laps, clock::now());
        let output = self
            .pipeline
            .step(&self.frames, &request, &mut |stage| {
                laps.push((stage, clock::micros_since(lap)));
                lap = clock::now();
            })
            .with_context(|| format!("tick {}", start.tick))?;
        self.count_laps(!start.detection_cameras.is_empty());
        let sending = clock::now();
        self.send(start, output);
        self.shared.count("messages", clock::micros_since(sending));
        self.count_delay(start.tick);
        Ok(())
    }

    fn send(&mut self, start: &TickStart, output: EdgeOutput) {
        if start.is_watched {
            let sets = &output.patch_sets;
            self.own_boxes.see(&start.boxes, sets, self.rate_hz);
        } else {
            self.own_boxes.clear();
        }
        let label = |session, kind| Label {
            session,
            tick: start.tick,
            kind,
        };
        for set in &output.sighting_sets {
            let bytes = self.shared.encode(set);
            self.shared
                .keep(label(set.session, SetKind::Sightings), &bytes);
            self.shared.send(MessageKind::Sightings, bytes);
        }
        let messages = output.patch_sets.len();
        let (mut persons, mut payload) = (0, 0);
        for mut set in output.patch_sets {
            let now_us = self.shared.clock.now_us();
            set.timing = self.shared.ledger().timing(start.tick, now_us);
            let bytes = self.shared.encode(&set);
            self.shared
                .keep(label(set.session, SetKind::Patches), &bytes);
            persons += set.persons.len();
            payload += bytes.len();
            if start.may_send {
                self.shared.send(MessageKind::Patches(start.tick), bytes);
            }
        }
        let mut ledger = self.shared.ledger();
        ledger
            .rate
            .packed(start.plan.level, persons, messages, payload);
    }

    fn count_laps(&mut self, detects: bool) {
        let stages = split_detection(&self.laps, self.pipeline.detection_share());
        for (stage, us) in stages {
            if stage != farfield_proto::message::DETECTION_STAGE || detects {
                self.shared.count(stage, us);
            }
        }
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
