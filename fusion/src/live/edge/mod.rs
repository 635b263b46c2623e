//! State of one edge: its clock, its delays, what was sent to it, and its errors.

pub mod clock;
pub mod common_clock;

use std::collections::VecDeque;

use farfield_proto::message::health::{LinkHealth, SystemClock};
use farfield_proto::message::live::{EdgeLink, HeardPatches, LiveBoxes, PatchTiming};
use farfield_proto::message::{BoxSet, PatchSet, SightingSet};
use farfield_proto::tick::Tick;
use farfield_proto::wire::WireError;

use self::clock::{EdgeClock, Exchange};
use crate::live::arrivals::{Arrivals, Task};
use crate::live::horizon::Horizon;
use crate::live::meter::Meter;
use crate::live::pace::Pace;
use crate::live::target_latency::LongestWaits;
use crate::live::tick_time::TickTime;
use crate::live::{Micros, SECOND_US};

/// An edge without messages for this long, in addition to the ticks that it skips, is silent:
/// fusion does not wait for it.
const SILENT_US: Micros = SECOND_US / 2;
/// Box sets that are remembered: more than any round trip takes.
const SENT: usize = 512;
/// Ticks of requested detection passes that are remembered.
const DETECTIONS: usize = 256;
/// Messages whose ticks are remembered, to detect overtaking.
const RECENT: usize = 64;
/// Patch sets that show at which ticks the edge works.
const LAST_SETS: usize = 4;
/// Extra wait for the messages of a tick after a message of a later tick came: links rarely reorder
/// messages by more.
const OVERTAKEN_US: Micros = SECOND_US / 50;
/// Extra wait for the remaining sightings once other edges have sent enough. A lost message that is
/// sent again is not worth boxes that are late for everyone. A message with a new person arrives in
/// that time.
const LATE_SIGHTINGS_US: Micros = SECOND_US / 20;
/// A message this long before or after its tick is ignored in link statistics.
const FAR_US: Micros = 10 * SECOND_US;
/// This many messages in a row of another version are no noise: the edge runs another farfield.
const FOREIGN_IN_A_ROW: u32 = 10;
/// A refused clock is accepted again within this share of the bound.
const ACCEPTED_AGAIN: f64 = 0.9;

/// A box set that was sent.
#[derive(Debug, Clone, Copy)]
struct Sent {
    sequence: u32,
    tick: Tick,
    at_us: Micros,
}

/// A message that arrived.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Came {
    /// When.
    pub at_us: Micros,
    /// Its bytes.
    pub bytes: u64,
}

/// The times of a patch set and its boxes, microseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Trip {
    /// From the capture of its pictures to its sending.
    pub sent_us: Option<u32>,
    /// From its sending to its arrival.
    pub arrived_us: Option<u32>,
    /// From the sending of its boxes to its own.
    pub box_used_us: Option<u32>,
}

/// One viewpoint's edge, as seen by fusion.
#[derive(Debug, Clone, Default)]
pub struct Edge {
    name: String,
    clock_bound_us: Micros,
    clock: EdgeClock,
    is_clock_refused: bool,
    arrivals: Arrivals,
    horizon: Horizon,
    pace: Pace,
    meter: Meter,
    sequence: u32,
    sent: VecDeque<Sent>,
    ticks_per_pass: Option<i64>,
    detection_ticks: VecDeque<Tick>,
    /// Whether its boxes have people.
    has_people: bool,
    /// n of the plan to work on every n-th tick; 0 before the first plan.
    pub every_nth_tick: u16,
    newest: Option<(Tick, i32)>,
    /// Ticks of the newest patch sets, and when they came.
    recent: VecDeque<(Tick, Micros)>,
    last_message_us: Option<Micros>,
    /// Time between the ticks that it works on, beyond one period, microseconds.
    left_out_us: Micros,
    expected_until_us: Option<Micros>,
    first: Option<Tick>,
    /// Patch sets that came after their tick was processed.
    pub late: u64,
    /// Ticks without messages, since the edge's first.
    pub missing: u64,
    /// Messages that could not be read.
    pub unreadable: u64,
    /// Messages in a row of an unreadable version, and the error.
    foreign: Option<(u32, WireError)>,
}

impl Edge {
    /// The edge of the viewpoint `name`. Its clock may be off by `clock_bound_ms`.
    pub fn new(name: &str, clock_bound_ms: f64) -> Self {
        Self {
            name: name.to_owned(),
            clock_bound_us: (clock_bound_ms * 1e3) as Micros,
            ..Self::default()
        }
    }

    /// Adds a detection pass at every tick that `ticks` divides, also without a request.
    #[must_use]
    pub fn with_pass_every(mut self, ticks: i64) -> Self {
        self.ticks_per_pass = Some(ticks);
        self
    }

    /// Sends boxes at `pace`.
    #[must_use]
    pub fn at_pace(mut self, pace: Pace) -> Self {
        self.pace = pace;
        self
    }

    /// Whether `boxes` are sent. Those with a request for a detection pass always are, others as
    /// the link allows.
    pub fn is_sent(&self, boxes: &BoxSet) -> bool {
        !boxes.detection_cameras.is_empty() || boxes.tick.0.rem_euclid(self.pace.nth()) == 0
    }

    /// Records the bytes of a sent box set.
    pub fn sent_bytes(&mut self, bytes: usize) {
        self.pace.sent(bytes);
    }

    /// Records a message that could not be read.
    pub fn cannot_read(&mut self, error: &WireError) {
        self.unreadable += 1;
        if let WireError::Version { .. } = error {
            let before = self.foreign.as_ref().map_or(0, |(in_a_row, _)| *in_a_row);
            self.foreign = Some((before + 1, error.clone()));
        }
    }

    /// Why its messages cannot be read, if none can.
    fn misunderstanding(&self) -> Option<String> {
        let (in_a_row, error) = self.foreign.as_ref()?;
        (*in_a_row >= FOREIGN_IN_A_ROW).then(|| error.to_string())
    }

    /// Another node took the viewpoint: forgets the state of the last one.
    pub fn start_again(&mut self) {
        self.clock.clear();
        self.is_clock_refused = false;
        self.arrivals = Arrivals::default();
        self.horizon = Horizon::default();
        self.recent.clear();
        self.left_out_us = 0;
        (self.newest, self.last_message_us) = (None, None);
    }

    /// Records that `boxes` are sent at `now_us`; returns the clock and link data to send with
    /// them.
    pub fn send(&mut self, boxes: &BoxSet, time: &TickTime, now_us: Micros) -> LiveBoxes {
        self.sequence = self.sequence.wrapping_add(1);
        let has_more = boxes.part > 0 && self.has_people;
        self.has_people = has_more || !boxes.persons.is_empty();
        push_bounded(
            &mut self.sent,
            Sent {
                sequence: self.sequence,
                tick: boxes.tick,
                at_us: now_us,
            },
            SENT,
        );
        if !boxes.detection_cameras.is_empty() && self.detection_ticks.back() != Some(&boxes.tick) {
            push_bounded(&mut self.detection_ticks, boxes.tick, DETECTIONS);
        }
        let bytes = self.meter.bytes_per_s(now_us);
        let as_heard = |(tick, one_way_us)| HeardPatches {
            tick,
            one_way_us,
            bytes,
        };
        LiveBoxes {
            sequence: self.sequence,
            epoch_us: time.epoch_us(),
            clock_correction_us: self.clock.correction_us(),
            heard: self.newest.map(as_heard),
            every_nth_tick: self.every_nth_tick,
        }
    }

    /// Sets the edge's report about its system's clock.
    pub fn set_system_clock(&mut self, system: Option<SystemClock>) {
        self.clock.set_system(system);
        self.judge_clock();
    }

    /// Sets the common time of the venue's systems, minus the time of the run.
    pub fn agree_on_clock(&mut self, common_us: Micros) {
        self.clock.set_common(common_us);
        self.judge_clock();
    }

    /// Its clock.
    pub fn clock(&self) -> &EdgeClock {
        &self.clock
    }

    /// Link health for the status, for newer nodes.
    pub fn link_health(&self) -> LinkHealth {
        let uncertainty_us = self.clock.uncertainty_us();
        LinkHealth {
            clock_uncertainty_us: uncertainty_us.and_then(|us| u32::try_from(us).ok()),
            clock_correction_us: self.clock.correction_us(),
            dropped: 0,
        }
    }

    /// Records a patch set, used or not.
    pub fn receive_patches(&mut self, set: &PatchSet, came: Came, time: &TickTime) -> Trip {
        let task = match (self.task(set.tick), set.persons.is_empty()) {
            // They come with the sightings of their tick.
            (Task::Detect, _) => None,
            (_, true) => Some(Task::Idle),
            (_, false) => Some(Task::Follow),
        };
        self.receive(task, set.tick, came, time);
        self.foreign = None;
        // A clock that is far off is measured, too: it must be corrected.
        let sent_us = set.timing.map(|timing| {
            let sent_us = time
                .at(set.tick)
                .saturating_add(timing.sent_after_us.into());
            self.measure(timing, sent_us, came.at_us);
            sent_us
        });
        if !is_near(set.tick, came, time) {
            return Trip::default();
        }
        push_bounded(&mut self.recent, (set.tick, came.at_us), RECENT);
        let nth = self.last_worked_on().map_or(1, |(_, nth)| nth);
        self.left_out_us = (time.period_us() * (nth - 1) as f64) as Micros;
        self.first = Some(self.first.map_or(set.tick, |first| first.min(set.tick)));
        let Some(sent_us) = sent_us else {
            return Trip::default();
        };
        let one_way_us = came.at_us - sent_us;
        if self.newest.is_none_or(|(tick, _)| set.tick >= tick) {
            let one_way_us = one_way_us.clamp(i32::MIN.into(), i32::MAX.into());
            self.newest = Some((set.tick, one_way_us as i32));
        }
        let mut trip = Trip {
            arrived_us: u32::try_from(one_way_us).ok(),
            ..Trip::default()
        };
        if let Some(patch) = set.persons.first() {
            let captured_us = time.at(set.tick) + i64::from(patch.capture_offset_us);
            trip.sent_us = u32::try_from(sent_us - captured_us).ok();
            self.horizon.used(set.tick - patch.box_tick, came.at_us);
            let boxes = self.sent_as(|sent| sent.tick == patch.box_tick);
            trip.box_used_us = boxes.and_then(|sent| u32::try_from(sent_us - sent.at_us).ok());
        }
        trip
    }

    fn measure(&mut self, timing: PatchTiming, sent_us: Micros, arrived_us: Micros) {
        let Some(echo) = timing.echo else { return };
        let Some(sent) = self.sent_as(|sent| sent.sequence == echo.sequence) else {
            return;
        };
        self.clock.add(&Exchange {
            boxes_sent_us: sent.at_us,
            held_us: echo.held_us.into(),
            patches_sent_us: sent_us,
            correction_us: timing.clock_correction_us.into(),
            arrived_us,
        });
        let (newest_us, shortest_us) = (
            self.clock.newest_round_trip_us(),
            self.clock.round_trip_us(),
        );
        if let (Some(newest_us), Some(shortest_us)) = (newest_us, shortest_us) {
            self.pace.measured(newest_us, shortest_us, arrived_us);
        }
        self.judge_clock();
    }

    /// Records the sightings of a detection pass. A pass without people is no measure of other
    /// passes.
    pub fn receive_sightings(&mut self, set: &SightingSet, came: Came, time: &TickTime) {
        let task = (!set.sightings.is_empty()).then(|| self.task(set.tick));
        self.receive(task, set.tick, came, time);
    }

    fn receive(&mut self, task: Option<Task>, tick: Tick, came: Came, time: &TickTime) {
        let Came { at_us, bytes } = came;
        self.meter.add(bytes, at_us);
        self.last_message_us = Some(self.last_message_us.map_or(at_us, |last| last.max(at_us)));
        if let Some(task) = task.filter(|_| is_near(tick, came, time)) {
            let delay_us = at_us.saturating_sub(time.at(tick));
            self.arrivals.add(task, delay_us, at_us);
        }
    }

    /// It has left: fusion does not wait for it.
    pub fn leave(&mut self) {
        self.last_message_us = None;
    }

    /// It is about to send: fusion waits for it until then.
    pub fn expect(&mut self, until_us: Micros) {
        self.expected_until_us = Some(until_us);
    }

    /// Whether to wait for its messages at all: it sends or will soon, and its clock is accurate
    /// enough.
    pub fn is_awaited(&self, now_us: Micros) -> bool {
        let is_expected = self.last_message_us.is_none()
            && self
                .expected_until_us
                .is_some_and(|until_us| now_us < until_us);
        is_expected || self.is_heard(now_us) && self.is_on_time()
    }

    /// Whether it sent a message recently.
    pub fn is_heard(&self, now_us: Micros) -> bool {
        let silent_us = SILENT_US + self.left_out_us;
        self.last_message_us
            .is_some_and(|at| now_us - at <= silent_us)
    }

    /// Whether its clock is accurate enough. Before that is known, whether its patches came at a
    /// possible time.
    pub fn is_on_time(&self) -> bool {
        if self.clock.is_known() {
            return !self.is_clock_refused;
        }
        let bound_us = self.clock_bound_us;
        let possible = -bound_us..=bound_us + SILENT_US;
        self.newest
            .is_some_and(|(_, one_way_us)| possible.contains(&one_way_us.into()))
    }

    /// Until when to wait for its messages of `tick`, no longer than `waits`.
    pub fn deadline_us(
        &mut self,
        tick: Tick,
        time: &TickTime,
        now_us: Micros,
        waits: LongestWaits,
    ) -> Micros {
        let task = self.task(tick);
        let most_us = match task {
            Task::Idle | Task::Follow => waits.patches_us,
            Task::Detect => waits.detections_us,
        };
        let tick_us = time.at(tick);
        let mut deadline_us = tick_us + self.arrivals.wait_us(task, now_us, most_us);
        if let (Task::Detect, Some(enough_us)) = (task, waits.enough_since_us) {
            let usual_us = self.arrivals.usual_pass_us(now_us).unwrap_or(0);
            let rest_us = enough_us.max(tick_us + usual_us) + LATE_SIGHTINGS_US;
            deadline_us = deadline_us.min(rest_us);
        }
        // An edge that works on every other tick, or whose message was lost, sends none for this
        // tick: patches of a later tick show that. Sightings are made in parallel to the patches of
        // later ticks, which therefore do not show it.
        let later = self
            .recent
            .iter()
            .filter(|(of, _)| task != Task::Detect && *of > tick);
        let overtaken_us = later.map(|(_, at_us)| at_us + OVERTAKEN_US).min();
        overtaken_us.map_or(deadline_us, |us| us.min(deadline_us))
    }

    /// Whether it works on `tick`, by the ticks of its last sets. An edge that is slow, or whose
    /// link is, works only on every n-th.
    pub fn works_on(&self, tick: Tick) -> bool {
        let of_usual = self
            .last_worked_on()
            .is_none_or(|(last, nth)| (tick - last).rem_euclid(nth) == 0);
        of_usual || self.looks_at(tick)
    }

    /// The last tick that it worked on and n if it works on every n-th, by its last sets without
    /// detection passes.
    fn last_worked_on(&self) -> Option<(Tick, i64)> {
        let mut ticks = [Tick(i64::MIN); LAST_SETS];
        let mut n = 0;
        for (of, _) in self.recent.iter().rev() {
            if n < LAST_SETS && !ticks[..n].contains(of) && !self.looks_at(*of) {
                ticks[n] = *of;
                n += 1;
            }
        }
        ticks.sort_unstable();
        let gaps = ticks.windows(2).map(|pair| pair[1] - pair[0]);
        let nth = gaps.min().filter(|_| n == LAST_SETS)?;
        Some((ticks[LAST_SETS - 1], nth))
    }

    /// How long after their tick nearly all of its patches come, microseconds; `None` while that is
    /// unknown.
    pub fn patches_come_us(&mut self, now_us: Micros) -> Option<Micros> {
        self.arrivals.slowest_us(Task::Follow, now_us)
    }

    /// Whether it runs a detection pass at `tick`.
    pub fn looks_at(&self, tick: Tick) -> bool {
        self.task(tick) == Task::Detect
    }

    /// Whether even its early patches come later than `most_us` after their tick.
    pub fn is_later_than(&mut self, most_us: Micros, now_us: Micros) -> bool {
        self.arrivals.are_later_than(most_us, Task::Follow, now_us)
    }

    /// How many ticks ahead its boxes are made, if boxes leave `publish_us` after their tick.
    pub fn horizon_ticks(&mut self, publish_us: f64, period_us: f64) -> f64 {
        if let Some(round_trip_us) = self.clock.usual_round_trip_us() {
            let one_way_us = round_trip_us as f64 / 2.0;
            self.horizon.set_path(publish_us, one_way_us, period_us);
        }
        self.horizon.ticks() as f64
    }

    /// Records that `tick` was processed without its messages.
    pub fn miss(&mut self, tick: Tick) {
        if self.first.is_some_and(|first| first <= tick) {
            self.missing += 1;
        }
    }

    /// Why its clock is refused, if it is.
    pub fn refused_clock(&self) -> Option<String> {
        let offset_ms = self.clock.system_offset_us().unwrap_or(0) as f64 / 1e3;
        self.is_clock_refused.then(|| {
            let remedy = if self.clock.is_synchronised() {
                "its system reports that NTP or PTP synchronises it: check the time source of that system"
            } else {
                "synchronise it by NTP or PTP"
            };
            format!(
                "its clock is off by {offset_ms:.0} ms, the limit is {} ms (`clock_bound_ms`): {remedy}",
                self.clock_bound_us / 1000
            )
        })
    }

    /// Link state for the status, without the decision of membership.
    pub fn link(&mut self, now_us: Micros) -> EdgeLink {
        let round_trip_us = self.clock.round_trip_us();
        let offset_us = self.clock.offset_us();
        EdgeLink {
            viewpoint: self.name.clone(),
            live: self.is_heard(now_us) && self.is_on_time(),
            refused: self.refused_clock().or_else(|| self.misunderstanding()),
            round_trip_us: round_trip_us.and_then(|us| u32::try_from(us).ok()),
            clock_offset_us: offset_us.and_then(|us| i32::try_from(us).ok()),
            horizon_ticks: self.horizon.ticks() as f32,
            bytes_per_s: self.meter.bytes_per_s(now_us),
            late: self.late,
            missing: self.missing,
            unreadable: self.unreadable,
        }
    }

    fn judge_clock(&mut self) {
        let surely_us = self.clock.surely_off_us();
        let bound_us = self.clock_bound_us;
        self.is_clock_refused = if self.is_clock_refused {
            surely_us as f64 > ACCEPTED_AGAIN * bound_us as f64
        } else {
            surely_us > bound_us
        };
    }

    fn task(&self, tick: Tick) -> Task {
        let is_regular = |ticks: i64| tick.0.rem_euclid(ticks.max(1)) == 0;
        let is_requested = || self.detection_ticks.iter().rev().any(|&of| of == tick);
        if self.ticks_per_pass.is_some_and(is_regular) || is_requested() {
            Task::Detect
        } else if self.has_people {
            Task::Follow
        } else {
            Task::Idle
        }
    }

    fn sent_as(&self, is: impl Fn(&Sent) -> bool) -> Option<Sent> {
        self.sent.iter().rev().copied().find(is)
    }
}

/// Whether the arrival time is plausible for its tick.
fn is_near(tick: Tick, came: Came, time: &TickTime) -> bool {
    came.at_us.saturating_sub(time.at(tick)).abs() < FAR_US
}

fn push_bounded<T>(queue: &mut VecDeque<T>, item: T, most: usize) {
    if queue.len() >= most {
        queue.pop_front();
    }
    queue.push_back(item);
}

#[cfg(test)]
mod tests;
