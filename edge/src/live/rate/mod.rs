//! Choice of what an edge sends, so that its link's queue stays empty and its computer keeps up.
//! First come a higher compression level and no second crops of tilted people. Then come fewer
//! persons per tick (round robin) or fewer ticks, whichever sends more persons.

mod load;
mod sighting_share;
pub mod thumbnail_share;
mod work;

use farfield_proto::message::live::{HeardPatches, MAX_NTH_TICK};
use farfield_proto::message::parts::MESSAGE_BYTES;
use farfield_proto::patch::CompressionLevel;
use farfield_proto::tick::Tick;
use farfield_proto::transport::MESSAGE_OVERHEAD_BYTES;

use self::load::LinkLoad;
use self::sighting_share::SightingShare;
pub use self::work::PLANNED;
use self::work::{Wish, Work};
use super::Micros;

/// Bytes of a message in addition to its persons.
const HEAD_BYTES: f64 = 40.0;
/// Share of a byte budget for patches; the rest is for statuses and sightings.
const PATCH_SHARE: f64 = 0.85;
/// Time for which there must be room before a lower compression level is used, microseconds.
const PATIENCE_US: Micros = 1_000_000;
/// Share of the rate that a lower compression level may use at first.
const ROOM: f64 = 0.85;
/// Fewer ticks must send this many times as many persons, because the ticks are farther apart.
const GAIN: f64 = 1.3;
/// While the link is cut, every eighth tick, or the next processed one, is still sent as a probe.
const PROBE_EVERY: u16 = 8;
/// Number of compression levels.
const LEVELS: usize = CompressionLevel::SMALLEST.number() as usize + 1;
/// Bytes of a person at each compression level before measurements.
const USUAL_BYTES: [f64; LEVELS] = [450.0, 300.0, 240.0, 190.0, 150.0, 125.0, 100.0];

/// What to send at a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SendPlan {
    /// Compression level of the patches.
    pub level: CompressionLevel,
    /// Largest mean number of persons per processed tick, at least 1; `None` for all.
    pub persons: Option<f64>,
    /// Only multiples of this are processed: a multiple of fusion's plan for all edges, so that
    /// edges share ticks.
    pub every_nth: u16,
}

/// Kind of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MessageKind {
    /// Patches of a tick.
    Patches(Tick),
    /// Sightings.
    Sightings,
    /// A status, or stored sets that fusion requested; not counted in the bytes that fusion reports
    /// as arrived.
    Status,
    /// A thumbnail; also not counted in them.
    Thumbnail,
}

impl MessageKind {
    /// The size of a message with `payload`, with protocol overhead.
    pub fn total_bytes(self, payload: usize) -> usize {
        let packets = match self {
            Self::Patches(_) | Self::Sightings | Self::Status => 1,
            // Many times as long as the others.
            Self::Thumbnail => payload.div_ceil(MESSAGE_BYTES).max(1),
        };
        payload + packets * MESSAGE_OVERHEAD_BYTES
    }
}

/// Plans every tick from the capacity of the link and the cost of persons.
#[derive(Debug, Clone)]
pub struct RateController {
    rate_hz: f64,
    best: CompressionLevel,
    budget: Option<f64>,
    message_bytes: usize,
    load: LinkLoad,
    work: Work,
    sightings: SightingShare,
    /// Measured bytes per person by level.
    measured: [Option<f64>; LEVELS],
    /// Ratio of the measured to the usual bytes.
    scale: f64,
    plan: SendPlan,
    /// The level that fits for certain. If all persons are sent, a share of the ticks uses the next
    /// finer level.
    level: CompressionLevel,
    /// The share of ticks at the finer level.
    finer_share: f64,
    /// Credit for a tick at the finer level, as a share of its additional cost.
    left: f64,
    limited: bool,
    /// Set if the computer is too slow.
    overload: Option<Overload>,
    room_since_us: Option<Micros>,
    /// Fusion's plan: all edges process only multiples of this.
    common_nth: u16,
    /// The edge's own n (every n-th tick) without that plan, at the last tick with people.
    own_nth: u16,
    /// The wish of the last plan.
    wish: Wish,
    /// The persons of the last plan.
    asked: usize,
}

/// A computer that is too slow for all ticks and persons.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Overload {
    /// Processed persons per second.
    pub done_per_s: f64,
    /// Persons per second for all ticks and persons.
    pub asked_per_s: f64,
}

impl RateController {
    /// The level is never below `best`. A `budget_bytes_per_s` of 0 means no bound except the
    /// link's. `message_bytes` is the size at which messages are split.
    pub fn new(
        rate_hz: f64,
        best: CompressionLevel,
        budget_bytes_per_s: f64,
        message_bytes: usize,
    ) -> Self {
        Self {
            rate_hz,
            best,
            budget: (budget_bytes_per_s > 0.0).then_some(budget_bytes_per_s),
            message_bytes,
            load: LinkLoad::default(),
            work: Work::new(rate_hz),
            sightings: SightingShare::default(),
            measured: [None; LEVELS],
            scale: 1.0,
            plan: SendPlan {
                level: best,
                persons: None,
                every_nth: 1,
            },
            level: best,
            finer_share: 0.0,
            left: 0.0,
            limited: false,
            overload: None,
            room_since_us: None,
            common_nth: 1,
            own_nth: 0,
            wish: Wish::TakeMore,
            asked: 0,
        }
    }

    /// Sets fusion's plan: all edges process only multiples of `every_nth`; 0 means no plan.
    pub fn follow(&mut self, every_nth: u16) {
        self.common_nth = every_nth.max(1);
    }

    /// The edge's own n (every n-th tick) without a plan of fusion; 0 without people.
    pub fn needed_nth(&self) -> u16 {
        if self.asked > 0 { self.own_nth } else { 0 }
    }

    /// Discards delays after a clock step or a restart of fusion, because they are not comparable.
    pub fn forget_delays(&mut self, now_us: Micros) {
        self.load.forget_delays(now_us);
    }

    /// Records that fusion's boxes return after `silent_us`.
    pub fn boxes_returned_after(&mut self, silent_us: Micros, now_us: Micros) {
        self.load.boxes_returned_after(silent_us, now_us);
    }

    /// Adds fusion's report of the link. `correction_us` is the current correction of this
    /// machine's clock, microseconds.
    pub fn receive_report(&mut self, heard: &HeardPatches, correction_us: i32, now_us: Micros) {
        self.load
            .receive_report(heard, correction_us, self.limited, now_us);
    }

    /// Records a sent message.
    pub fn sent(&mut self, message: MessageKind, payload: usize, now_us: Micros) {
        let total = message.total_bytes(payload);
        match message {
            MessageKind::Patches(tick) => self.load.sent(Some(tick), payload, total, now_us),
            MessageKind::Sightings => {
                self.sightings.sent(total, self.whole_rate(), now_us);
                self.load.sent(None, payload, total, now_us);
            }
            MessageKind::Status => self.load.sent(None, 0, total, now_us),
            // A full link drops them first, so they do not measure its capacity.
            MessageKind::Thumbnail => {}
        }
    }

    /// Records the size of a tick with `persons` at a compression level, all messages together.
    pub fn packed(
        &mut self,
        level: CompressionLevel,
        persons: usize,
        messages: usize,
        payload: usize,
    ) {
        /// Weight of a new value in the mean.
        const SHARE: f64 = 0.05;
        if persons == 0 {
            return;
        }
        let level = usize::from(level.number());
        let bytes = (payload as f64 - HEAD_BYTES * messages as f64).max(1.0) / persons as f64;
        let mean = self.measured[level].unwrap_or(bytes);
        self.measured[level] = Some(mean + SHARE * (bytes - mean));
        self.scale += SHARE * (bytes / USUAL_BYTES[level] - self.scale);
    }

    /// Sets the number of crops that the network processes in parallel, and its measured speed.
    pub fn set_workers(&mut self, workers: usize, crops_per_s: f64) {
        self.work.set_workers(workers, crops_per_s);
    }

    /// Records a tick that ended at `now_us`, its `crops` and its duration.
    pub fn worked(&mut self, crops: usize, took_us: u32, now_us: Micros) {
        self.work.add(crops, took_us, now_us);
    }

    /// Whether there is time for this many crops at each tick of the last plan.
    pub fn has_time_for(&self, crops: usize) -> bool {
        self.work.ticks(crops, Wish::TakeMore) <= f64::from(self.plan.every_nth)
    }

    /// Set if the computer has no time for all ticks and persons.
    pub fn overload(&self) -> Option<Overload> {
        self.overload
    }

    /// Payload sent in the last second, bytes.
    pub fn payload_per_s(&self, now_us: Micros) -> u64 {
        self.load.payload_per_s(now_us)
    }

    /// Rate for patches without sightings, bytes per second with overhead; infinite without a
    /// bound.
    pub fn rate(&self) -> f64 {
        self.load.rate().min(PATCH_SHARE * self.budget())
    }

    /// Rate that the link and the operator allow, bytes per second with overhead.
    fn whole_rate(&self) -> f64 {
        self.load.rate().min(self.budget())
    }

    fn budget(&self) -> f64 {
        self.budget.unwrap_or(f64::INFINITY)
    }

    /// Whether the link seems to have room for all persons at the best level.
    pub fn has_room(&self, now_us: Micros) -> bool {
        !self.limited && !self.load.is_silent(now_us)
    }

    /// The compression level of most ticks.
    pub fn level(&self) -> CompressionLevel {
        let finer = self.level.finer().filter(|_| self.finer_share > 0.5);
        finer.unwrap_or(self.level)
    }

    /// The last plan.
    pub fn last_plan(&self) -> SendPlan {
        self.plan
    }

    /// Whether patches of `tick` are sent at all; while the link is cut only probes are.
    pub fn may_send(&self, tick: Tick, now_us: Micros) -> bool {
        let nth = self.plan.every_nth;
        let probed = i64::from(nth) * i64::from(PROBE_EVERY.div_ceil(nth));
        !self.load.is_silent(now_us) || tick.0.rem_euclid(probed) == 0
    }

    /// Whether the link allows a detection pass now: a regular one with `is_regular`, else one
    /// requested by fusion. Requested ones are refused while almost no message arrives.
    pub fn may_detect(&self, is_regular: bool, now_us: Micros) -> bool {
        (is_regular || !self.load.is_choked(now_us))
            && self.sightings.may_detect(is_regular, now_us)
    }

    /// Plans the next tick, with boxes of `persons`.
    pub fn plan(&mut self, persons: usize, now_us: Micros) -> SendPlan {
        let left = self.sightings.left_for_patches(self.whole_rate(), now_us);
        let per_tick = left.min(self.rate()) / self.rate_hz;
        let mut level = self.level.max(self.best);
        while self.cost(level, persons) > per_tick
            && let Some(coarser) = level.coarser()
        {
            level = coarser;
        }
        let finer = level.finer().filter(|finer| *finer >= self.best);
        let has_room = finer.is_some_and(|finer| self.cost(finer, persons) <= ROOM * per_tick);
        if level != self.level || !has_room {
            self.room_since_us = None;
        } else if now_us - *self.room_since_us.get_or_insert(now_us) >= PATIENCE_US {
            level = finer.unwrap_or(level);
            self.room_since_us = None;
        }
        let needed_nth = self.need(level, per_tick, persons);
        let every_nth = needed_nth.max(1).next_multiple_of(self.common_nth);
        let ticks = f64::from(every_nth);
        let share = |persons| self.share(level, per_tick, persons);
        let is_less = every_nth > 1 || share(persons) > 1.0;
        let mut most = is_less.then(|| persons_within(share, ticks, persons));
        if self.wish == Wish::Continue && self.asked == persons {
            // A bearable load is no reason to process more.
            most = most.map(|most| self.plan.persons.map_or(most, |last| most.min(last)));
        }
        self.asked = persons;
        // Capacity left by fewer ticks is used for a finer level.
        while is_less
            && let Some(finer) = level.finer().filter(|finer| *finer >= self.best)
            && self.cost(finer, persons) <= per_tick * ticks
        {
            level = finer;
        }
        let of_time = self.work.ticks(persons, self.wish);
        let done = most.unwrap_or(persons as f64) / ticks;
        self.overload = (of_time > 1.0).then_some(Overload {
            done_per_s: done * self.rate_hz,
            asked_per_s: persons as f64 * self.rate_hz,
        });
        // The rate is no limit if the edge has no time for more, or there is no more to send.
        let asked = self.cost(self.best, persons) / of_time.max(self.common_nth.into());
        self.limited = level > self.best || asked > per_tick;
        self.level = level;
        self.finer_share = 0.0;
        self.plan = SendPlan {
            level: match most {
                None => self.filled(level, persons, per_tick),
                Some(_) => level,
            },
            persons: most,
            every_nth,
        };
        self.plan
    }

    /// The level of a tick with all `persons`. As many ticks as the bytes allow use the level finer
    /// than `level`. Levels differ by a fifth to a half, so an edge that stays below its share of a
    /// shared link loses that share to others.
    fn filled(
        &mut self,
        level: CompressionLevel,
        persons: usize,
        per_tick: f64,
    ) -> CompressionLevel {
        let Some(finer) = level.finer().filter(|finer| *finer >= self.best) else {
            return level;
        };
        let [less, more] = [level, finer].map(|level| self.cost(level, persons));
        self.finer_share = ((per_tick - less) / (more - less).max(1.0)).clamp(0.0, 1.0);
        self.left += self.finer_share;
        if self.left < 1.0 {
            return level;
        }
        self.left -= 1.0;
        finer
    }

    /// The n (every n-th tick) that the edge needs; 0 without `persons`. While its load is bearable
    /// it does not skip more ticks.
    fn need(&mut self, level: CompressionLevel, per_tick: f64, persons: usize) -> u16 {
        self.wish = Wish::TakeMore;
        let mut nth = self.needed(level, per_tick, persons);
        if (1..nth).contains(&self.own_nth) {
            self.wish = Wish::Continue;
            nth = self.own_nth.max(self.needed(level, per_tick, persons));
        }
        if nth > 0 {
            self.own_nth = nth;
        }
        nth
    }

    /// The n at which every n-th tick sends the most `persons` per second; 0 without persons. The
    /// fixed cost of a message is paid once per tick, so fewer ticks can carry more persons.
    fn needed(&self, level: CompressionLevel, per_tick: f64, persons: usize) -> u16 {
        let share = |persons| self.share(level, per_tick, persons);
        if persons == 0 || share(persons) <= 1.0 {
            return u16::from(persons > 0);
        }
        // Powers of two divide each other, so edges share ticks also while a plan changes.
        let fewest =
            (share(1).clamp(1.0, f64::from(MAX_NTH_TICK)).ceil() as u16).next_power_of_two();
        let per_tick = |nth: u16| persons_within(share, nth.into(), persons) / f64::from(nth);
        let (mut best, mut nth) = (fewest, 2 * fewest);
        while nth <= MAX_NTH_TICK {
            if per_tick(nth) > GAIN * per_tick(best) {
                best = nth;
            }
            nth *= 2;
        }
        best
    }

    /// Share of the `per_tick` bytes, or of the time, that a tick with this many `persons` takes.
    fn share(&self, level: CompressionLevel, per_tick: f64, persons: usize) -> f64 {
        let of_link = self.cost(level, persons) / per_tick;
        of_link.max(self.work.ticks(persons, self.wish))
    }

    /// Bytes of a tick with overhead.
    fn cost(&self, level: CompressionLevel, persons: usize) -> f64 {
        let level = usize::from(level.number());
        let each = self.measured[level].unwrap_or(self.scale * USUAL_BYTES[level]);
        let bytes = persons as f64 * each;
        let room = (self.message_bytes as f64 - HEAD_BYTES).max(1.0);
        let messages = (bytes / room).ceil().max(1.0);
        bytes + messages * (HEAD_BYTES + MESSAGE_OVERHEAD_BYTES as f64)
    }
}

/// Mean number of `persons` that fit into this many `ticks`, at least 1; `share` gives the cost of
/// a number of persons.
fn persons_within(share: impl Fn(usize) -> f64, ticks: f64, persons: usize) -> f64 {
    let whole = (1..persons).rev().find(|&n| share(n) <= ticks);
    whole.map_or(1.0, |n| {
        let [less, more] = [n, n + 1].map(&share);
        n as f64 + ((ticks - less) / (more - less).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0)
    })
}

#[cfg(test)]
mod simulated_link;
#[cfg(test)]
mod tests;
