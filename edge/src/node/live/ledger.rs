//! The pure state of a live edge behind one lock: clock, boxes, rate, budget, counts.

use farfield_proto::message::BoxSet;
use farfield_proto::message::live::{LiveStatus, PatchTiming};
use farfield_proto::message::parts::MESSAGE_BYTES;
use farfield_proto::tick::Tick;
use farfield_proto::venue::parameters::LinkParameters;

use crate::live::Micros;
use crate::live::budget::ByteBudget;
use crate::live::failures::Failures;
use crate::live::newest_boxes::{BoxSetArrival, NewestBoxes};
use crate::live::rate::thumbnail_share::ThumbnailShare;
use crate::live::rate::{MessageKind, Overload, RateController};
use crate::live::tick_clock::TickClock;

/// State and counts of a live edge.
#[derive(Debug)]
pub(super) struct Ledger {
    pub(super) ticks: TickClock,
    pub(super) boxes: NewestBoxes,
    pub(super) rate: RateController,
    budget: ByteBudget,
    thumbnails: ThumbnailShare,
    held_back: u64,
    rate_hz: f64,
    /// Ticks that were not processed.
    pub(super) missed: u64,
    pub(super) failures: Failures,
    /// The last processed tick.
    pub(super) last: Option<Tick>,
}

impl Ledger {
    pub(super) fn new(rate_hz: f64, link: &LinkParameters) -> Self {
        let best = link.quality.unwrap_or_default();
        let budget = link.budget_bytes_per_s;
        Self {
            ticks: TickClock::new(rate_hz),
            boxes: NewestBoxes::default(),
            rate: RateController::new(rate_hz, best, budget, MESSAGE_BYTES),
            budget: ByteBudget::new(budget),
            thumbnails: ThumbnailShare::new(budget),
            held_back: 0,
            rate_hz,
            missed: 0,
            failures: Failures::default(),
            last: None,
        }
    }

    /// Adds boxes that arrived at `now_us`.
    pub(super) fn take_boxes(&mut self, boxes: BoxSet, now_us: Micros) -> BoxSetArrival {
        let live = boxes.live;
        let silent_us = self.boxes.silent_us(now_us).unwrap_or(0);
        let arrival = self.boxes.receive(boxes, now_us);
        let is_followed = matches!(arrival, BoxSetArrival::NewSession | BoxSetArrival::Newer);
        let (Some(live), true) = (live, is_followed) else {
            return arrival;
        };
        if self.ticks.set(&live, now_us) || arrival == BoxSetArrival::NewSession {
            self.rate.forget_delays(now_us);
            // Ticks may restart.
            self.last = None;
        }
        self.rate.follow(live.every_nth_tick);
        self.rate.boxes_returned_after(silent_us, now_us);
        if let Some(heard) = &live.heard {
            self.rate
                .receive_report(heard, self.ticks.correction_us(), now_us);
        }
        arrival
    }

    /// Whether a message of `payload` bytes may be sent now; counts it in both cases.
    pub(super) fn admit(&mut self, message: MessageKind, payload: usize, now_us: Micros) -> bool {
        if self.budget.take(message.total_bytes(payload), now_us) {
            self.rate.sent(message, payload, now_us);
            true
        } else {
            self.held_back += 1;
            false
        }
    }

    /// Most bytes of a thumbnail's picture now; 0 means that none may be sent.
    pub(super) fn thumbnail_room(&mut self, now_us: Micros) -> usize {
        self.thumbnails.room(&mut self.budget, &self.rate, now_us)
    }

    /// Whether a thumbnail with this picture size and message `payload`, bytes, may be sent now;
    /// counts it if so.
    pub(super) fn admit_thumbnail(
        &mut self,
        picture: usize,
        payload: usize,
        now_us: Micros,
    ) -> bool {
        let message = MessageKind::Thumbnail;
        picture <= self.thumbnail_room(now_us)
            && self.thumbnails.sent(message.total_bytes(payload), now_us)
            && self.admit(message, payload, now_us)
    }

    /// The timing data of patches of `tick` sent at `now_us`.
    pub(super) fn timing(&self, tick: Tick, now_us: Micros) -> Option<PatchTiming> {
        let after_us = self.ticks.after_us(now_us, tick)?;
        Some(PatchTiming {
            sent_after_us: after_us.clamp(i32::MIN.into(), i32::MAX.into()) as i32,
            clock_correction_us: self.ticks.correction_us(),
            echo: self.boxes.echo(now_us),
        })
    }

    /// A message if the computer is too slow for all people at every tick.
    pub(super) fn overload(&self) -> Option<String> {
        let Overload {
            done_per_s,
            asked_per_s,
        } = self.rate.overload()?;
        let nth = f64::from(self.rate.last_plan().every_nth);
        Some(format!(
            "{:.0} of {:.0} Hz: it processes {done_per_s:.0} of {asked_per_s:.0} crops a second; use a smaller network, fewer people or a faster computer",
            self.rate_hz / nth,
            self.rate_hz
        ))
    }

    /// The live status without the cameras.
    pub(super) fn describe(&self, now_us: Micros) -> LiveStatus {
        let plan = self.rate.last_plan();
        let most = f64::from(u16::MAX);
        LiveStatus {
            epoch_us: self.ticks.epoch_us(),
            clock_correction_us: self.ticks.correction_us(),
            quality: self.rate.level().number(),
            persons_per_tick: plan.persons.map(|n| n.round().min(most) as u16),
            every_nth_tick: plan.every_nth,
            needed_nth_tick: self.rate.needed_nth(),
            bytes_per_s: u32::try_from(self.rate.payload_per_s(now_us)).unwrap_or(u32::MAX),
            held_back: self.held_back,
            missed_ticks: self.missed,
            cameras: Vec::new(),
            edges: Vec::new(),
            recording_failure: None,
        }
    }
}
