//! Estimate of the capacity of the edge's link, from delay and loss only.
//!
//! Fusion reports the one-way delay of the newest patches. The minimum of the last seconds is the
//! base delay. The excess is a queue that the edge has filled (LEDBAT, RFC 6817, section 2.4.2). A
//! standing queue, or loss above that of radio links, lowers the rate to a little below the
//! arriving rate, so that the queue empties. Without either, the rate grows, slowly at first, then
//! faster. It grows faster at low rates, but by at most half of itself per second.
//!
//! A multiplicative decrease with an additive increase brings edges on one bottleneck to the same
//! rate, in whatever order they start (Chiu 1989). With a multiplicative increase they would keep
//! their ratios. An edge with a low rate tolerates a longer queue: all edges see the same queue,
//! and the part of each is its rate times its delay (as in TCP Vegas, Brakmo 1994). Loss that does
//! not fall with the rate is a property of the link and no reason to send less.

use farfield_proto::message::live::HeardPatches;
use farfield_proto::tick::Tick;

use crate::live::{Micros, SECOND_US};

/// The rate for which the constants below hold, bytes per second: the share of each of four edges
/// in 1 Mbit/s.
const USUAL_RATE: f64 = 31_000.0;
/// Least and largest factor of [`GROWTH_PER_S`] at other rates.
const GROWTH_TIMES: [f64; 2] = [0.5, 3.0];
/// Least and largest factor of the tolerated queue at other rates. Jitter does not fall at higher
/// rates.
const QUEUE_TIMES: [f64; 2] = [1.0, 3.0];
/// A longer standing queue lowers the rate, microseconds: more than a tick at 60 Hz. At
/// [`USUAL_RATE`].
const QUEUE_US: Micros = 20_000;
/// Below this queue the link has room, microseconds. At [`USUAL_RATE`].
const EMPTY_US: Micros = 8_000;
/// A queue stands if no message was faster for this time, microseconds. Jitter does not last.
const STANDS_US: Micros = 200_000;
/// Window over which the least one-way delay is the base delay, microseconds, in two halves.
const BASE_DELAY_WINDOW_US: Micros = 20 * SECOND_US;
/// Loss above this share, relative to the link's own loss, means a full link and not radio noise.
const LOSS: f64 = 0.15;
/// Silences closer to each other than this can come from a full link.
const REPEATED_SILENCE_US: Micros = 5 * SECOND_US;
/// After a silence a full link delivers through a queue longer than this, microseconds. An
/// interrupted link delivers with its base delay at once.
const FULL_QUEUE_US: Micros = 60_000;
/// Without boxes for this time the whole link or fusion was away, microseconds. Fusion sends boxes
/// at least ten times a second, and a full link still delivers them, because their direction has
/// room.
const OUTAGE_US: Micros = SECOND_US / 4;
/// Above this loss almost no message arrives.
const CHOKED_LOSS: f64 = 0.5;
/// Weights of a new report in the recent loss and in the loss of the last seconds.
const LOSS_SHARES: [f64; 2] = [0.05, 0.02];
/// If loss remains after the rate was lowered for this time because of loss alone, it is the link's
/// own, microseconds. Reports cover the last second.
const FUTILE_LOSS_US: Micros = 5 * SECOND_US / 2;
/// Shortest time between two decreases, microseconds: the effect of one must be visible before the
/// next.
const STEP_PAUSE_US: Micros = 250_000;
/// Without a new report for this time the link counts as cut, microseconds.
const SILENCE_US: Micros = 700_000;
/// Time after which fusion's report of the last second is complete, microseconds.
const WHOLE_US: Micros = 3 * SECOND_US / 2;
/// Lowest rate, bytes per second: one person every few ticks.
const MIN_RATE: f64 = 1_000.0;
/// Growth after a decrease, bytes per second per second. Four edges on a link of 1 Mbit/s fill the
/// freed capacity in two seconds. At [`USUAL_RATE`].
const GROWTH_PER_S: f64 = 1_500.0;
/// Time without a queue in which growth doubles, microseconds.
const GROWTH_DOUBLES_US: Micros = 6 * SECOND_US;
/// Largest growth per second, as a share of the rate.
const MAX_GROWTH_SHARE_PER_S: f64 = 0.5;
/// Consecutive decreases that do not halve a queue, after which the queue counts as other traffic
/// or a longer base delay.
const FUTILE_STEPS: u32 = 6;
/// Ticks whose sending times are stored.
const TICKS: i64 = 512;
/// Width of a slot of sent bytes, microseconds, and number of slots: five seconds.
const SLOT_US: Micros = 20_000;
const SLOTS: i64 = 250;

/// The capacity of one link.
#[derive(Debug, Clone)]
pub(super) struct LinkLoad {
    /// Bytes per second with overhead; infinite until the link was full once.
    rate: f64,
    base_delay: WindowMin,
    recent: [(Micros, Micros); 16],
    n_recent: usize,
    /// Running mean of the loss since the last decrease.
    loss: f64,
    /// Running mean of the loss in the last seconds.
    usual_loss: f64,
    /// The link's own loss, which does not depend on the rate.
    own_loss: f64,
    /// Time of the first decrease because of loss alone, and the rate before it.
    lossy_since: Option<(Micros, f64)>,
    sent: SentLog,
    since_us: Option<Micros>,
    back: Option<BackAfterSilence>,
    newest: Option<Tick>,
    /// Sending time of the first message since the last report.
    unanswered_us: Option<Micros>,
    next_step_at_us: Micros,
    grown_at_us: Micros,
    /// Decreases since the queue was last empty, with the queue and the rate before the first.
    steps: u32,
    before: (Micros, f64),
}

/// The first report after a silence.
#[derive(Debug, Clone, Copy)]
struct BackAfterSilence {
    at_us: Micros,
    /// The base delay before it, microseconds.
    base_us: Option<Micros>,
    /// Whether the link seems full: it was silent before, and since then had neither little loss
    /// nor an answer without a queue. An interrupted link recovers for good; a full one is silent
    /// repeatedly.
    is_full: bool,
}

impl Default for LinkLoad {
    fn default() -> Self {
        Self {
            rate: f64::INFINITY,
            base_delay: WindowMin::default(),
            recent: [(Micros::MIN, 0); 16],
            n_recent: 0,
            loss: 0.0,
            usual_loss: 0.0,
            own_loss: 0.0,
            lossy_since: None,
            sent: SentLog::default(),
            since_us: None,
            back: None,
            newest: None,
            unanswered_us: None,
            next_step_at_us: Micros::MIN,
            grown_at_us: Micros::MIN,
            steps: 0,
            before: (0, f64::INFINITY),
        }
    }
}

impl LinkLoad {
    /// The rate that may be sent, bytes per second with overhead.
    pub(super) fn rate(&self) -> f64 {
        self.rate
    }

    /// Records a message of `tick`: its payload, and its size with overhead.
    pub(super) fn sent(
        &mut self,
        tick: Option<Tick>,
        payload: usize,
        total: usize,
        now_us: Micros,
    ) {
        self.sent.note(tick, payload, total, now_us);
        if tick.is_some() {
            self.unanswered_us.get_or_insert(now_us);
        }
    }

    /// Payload sent in the last second, bytes.
    pub(super) fn payload_per_s(&self, now_us: Micros) -> u64 {
        self.sent.second_before(now_us).0
    }

    /// Whether the link counts as cut, because reports about sent messages are missing.
    pub(super) fn is_silent(&self, now_us: Micros) -> bool {
        self.newest.is_some() && self.is_unanswered(now_us)
    }

    /// Whether almost no message arrives: more than half is lost, for whatever reason, or reports
    /// were missing for long, or repeatedly until just now.
    pub(super) fn is_choked(&self, now_us: Micros) -> bool {
        let is_full = |back: BackAfterSilence| back.is_full && now_us - back.at_us < WHOLE_US;
        let is_just_back = self.back.is_some_and(is_full);
        let is_lossy = self.loss.max(self.usual_loss) > CHOKED_LOSS;
        is_just_back || is_lossy || self.is_unanswered(now_us)
    }

    fn is_unanswered(&self, now_us: Micros) -> bool {
        let since_us = self.unanswered_us;
        since_us.is_some_and(|since_us| now_us - since_us > SILENCE_US)
    }

    /// Records that fusion's boxes return after `silent_us`. Unanswered messages and losses of that
    /// time do not measure the link's capacity; delays still do.
    pub(super) fn boxes_returned_after(&mut self, silent_us: Micros, now_us: Micros) {
        if silent_us < OUTAGE_US {
            return;
        }
        self.unanswered_us = None;
        if self.since_us.is_some_and(|since_us| since_us < now_us) {
            self.since_us = Some(now_us);
        }
    }

    /// Discards delays after a clock step or a restart of fusion, because they are not comparable;
    /// the rate is kept.
    pub(super) fn forget_delays(&mut self, now_us: Micros) {
        self.base_delay = WindowMin::default();
        self.n_recent = 0;
        self.loss = 0.0;
        self.newest = None;
        // The new fusion is not responsible for missing answers of the previous one.
        self.unanswered_us = None;
        // Messages in transit were sent by the old clock, and the last second is incomplete.
        self.since_us = Some(now_us + SECOND_US);
    }

    /// Adds fusion's report at `now_us`. `correction_us` is the current correction of this
    /// machine's clock; `limited` is whether a higher rate would be used.
    pub(super) fn receive_report(
        &mut self,
        heard: &HeardPatches,
        correction_us: i32,
        limited: bool,
        now_us: Micros,
    ) {
        // A report about a tick that was not sent is invalid, and would make all later reports
        // stale.
        let was_sent = self.sent.last.is_some_and(|last| heard.tick <= last);
        if !was_sent || self.newest.is_some_and(|tick| heard.tick <= tick) {
            return;
        }
        if self.is_unanswered(now_us) {
            self.note_back(now_us);
        }
        if self.is_silent(now_us) {
            // The link is back. Losses in the silence do not measure its capacity.
            self.forget_delays(now_us);
        }
        // Relative to the uncorrected clock, so that corrections do not look like queues.
        let delay_us = Micros::from(heard.one_way_us) + Micros::from(correction_us);
        if let Some(back) = &mut self.back {
            let has_queue = |base_us| delay_us - base_us > FULL_QUEUE_US;
            back.is_full &= back.base_us.is_none_or(has_queue);
        }
        let since_us = *self.since_us.get_or_insert(now_us);
        self.newest = Some(heard.tick);
        self.unanswered_us = None;
        if now_us < since_us {
            return;
        }
        self.base_delay.add(delay_us, now_us);
        self.recent[self.n_recent % self.recent.len()] = (now_us, delay_us);
        self.n_recent += 1;
        let queue_us = self.queue_us(now_us);
        let sent_us = self.sent.when(heard.tick).unwrap_or(now_us);
        let (payload, total) = self.sent.second_before(sent_us);
        let is_whole = now_us - since_us >= WHOLE_US;
        if is_whole && payload > 0 {
            let lost = 1.0 - f64::from(heard.bytes) / payload as f64;
            self.note_loss(lost.clamp(0.0, 1.0));
        }
        let arrived = if is_whole && payload > 0 {
            f64::from(heard.bytes) * total as f64 / payload as f64
        } else {
            0.8 * total as f64
        };
        let used = if is_whole {
            self.rate.min(total as f64)
        } else {
            self.rate
        };
        let times = times(used, QUEUE_TIMES);
        let [most_us, room_us] = [QUEUE_US, EMPTY_US].map(|us| (times * us as f64) as Micros);
        let has_queue = queue_us.is_some_and(|us| us > most_us);
        let is_lossy = self.loss > self.own_loss + LOSS;
        if has_queue || is_lossy {
            let rate = self.rate;
            if !has_queue && self.is_futile(now_us) {
                return;
            }
            self.slow_down(arrived, queue_us.unwrap_or(0), now_us - sent_us, now_us);
            if !has_queue {
                self.lossy_since.get_or_insert((now_us, rate));
            }
        } else if queue_us.is_none_or(|us| us < room_us) {
            self.steps = 0;
            if limited {
                self.speed_up(now_us);
            } else {
                self.grown_at_us = now_us;
            }
        } else {
            self.grown_at_us = now_us;
        }
    }

    /// Records the first report after a silence.
    fn note_back(&mut self, now_us: Micros) {
        let of_late = |back: &BackAfterSilence| now_us - back.at_us < REPEATED_SILENCE_US;
        let before = self.back.filter(of_late);
        // Delays measured since the previous silence can contain a standing queue.
        let earlier_us = before.and_then(|back| back.base_us);
        let base_us = self.base_delay.min().into_iter().chain(earlier_us).min();
        let is_lossy = self.loss.max(self.usual_loss) > self.own_loss + LOSS;
        self.back = Some(BackAfterSilence {
            at_us: now_us,
            base_us: base_us.filter(|_| !is_lossy),
            is_full: before.is_some(),
        });
    }

    fn note_loss(&mut self, lost: f64) {
        let [of_late, of_seconds] = LOSS_SHARES;
        self.loss += of_late * (lost - self.loss);
        self.usual_loss += of_seconds * (lost - self.usual_loss);
        // Own loss can fall, for example with the weather, and a later rise is detected again.
        self.own_loss = self.own_loss.min(self.usual_loss + LOSS / 2.0);
        if self.usual_loss < LOSS / 2.0 {
            self.lossy_since = None;
        }
    }

    /// Whether the rate was lowered long enough because of loss alone that the loss must be the
    /// link's own. The rate then returns to its earlier value.
    fn is_futile(&mut self, now_us: Micros) -> bool {
        let long_ago = |(since_us, _): &mut (Micros, f64)| now_us - *since_us >= FUTILE_LOSS_US;
        let Some((_, rate)) = self.lossy_since.take_if(long_ago) else {
            return false;
        };
        self.own_loss = self.loss.max(self.usual_loss);
        (self.rate, self.grown_at_us) = (rate, now_us);
        true
    }

    /// The standing queue, microseconds; `None` if too little is known.
    fn queue_us(&self, now_us: Micros) -> Option<Micros> {
        /// A few late reports are no queue.
        const MIN_REPORTS: usize = 4;
        let known = self.n_recent.min(self.recent.len());
        let newest_first =
            (1..=known).map(|back| self.recent[(self.n_recent - back) % self.recent.len()]);
        let standing = newest_first
            .enumerate()
            .take_while(|(n, (at_us, _))| *n < MIN_REPORTS || now_us - at_us <= STANDS_US);
        let (mut least_us, mut since_us, mut words) = (Micros::MAX, now_us, 0);
        for (_, (at_us, delay_us)) in standing {
            (least_us, since_us, words) = (least_us.min(delay_us), at_us, words + 1);
        }
        // Reports that arrive at once after a pause are no queue either.
        if words < MIN_REPORTS || now_us - since_us < STANDS_US / 2 {
            return None;
        }
        Some(least_us - self.base_delay.min()?)
    }

    fn slow_down(&mut self, arrived: f64, queue_us: Micros, loop_us: Micros, now_us: Micros) {
        self.grown_at_us = now_us;
        if now_us < self.next_step_at_us {
            return;
        }
        if self.steps == 0 {
            self.before = (queue_us, self.rate);
        }
        self.steps += 1;
        if self.steps > FUTILE_STEPS
            && 2 * queue_us > self.before.0
            && self.loss <= self.own_loss + LOSS
        {
            self.take_for_base_delay();
            return;
        }
        // The longer the queue, the faster it must empty.
        let share = (0.92 - queue_us as f64 / SECOND_US as f64).clamp(0.5, 0.92);
        self.rate = self.rate.min(arrived * share).max(MIN_RATE);
        self.loss = 0.0;
        self.next_step_at_us = now_us + loop_us.max(0) + STEP_PAUSE_US;
    }

    /// A queue that remains at lower rates is not the edge's own and becomes part of the base
    /// delay.
    fn take_for_base_delay(&mut self) {
        self.base_delay = WindowMin::default();
        self.n_recent = 0;
        self.rate = self.before.1;
        self.steps = 0;
    }

    fn speed_up(&mut self, now_us: Micros) {
        let dt_s = ((now_us - self.grown_at_us.max(now_us - SECOND_US)) as f64) / SECOND_US as f64;
        self.grown_at_us = now_us;
        if now_us < self.next_step_at_us || !self.rate.is_finite() {
            return;
        }
        let calm = (now_us - self.next_step_at_us) as f64 / GROWTH_DOUBLES_US as f64;
        let most = self.rate * MAX_GROWTH_SHARE_PER_S;
        self.rate += (GROWTH_PER_S * times(self.rate, GROWTH_TIMES) * calm.exp2()).min(most) * dt_s;
    }
}

/// The factor of the tolerated queue, or of growth, relative to an edge at [`USUAL_RATE`]: larger
/// for lower rates, within the bounds. Of edges that see the same queue, the one with the highest
/// rate decreases first, and the one with the lowest grows first.
fn times(rate: f64, [least, most]: [f64; 2]) -> f64 {
    (USUAL_RATE / rate.max(1.0)).clamp(least, most)
}

/// The minimum of the last [`BASE_DELAY_WINDOW_US`] or half of it: two halves in turn.
#[derive(Debug, Clone, Default)]
struct WindowMin {
    halves: [Option<Micros>; 2],
    turned_at_us: Option<Micros>,
}

impl WindowMin {
    fn add(&mut self, value: Micros, now_us: Micros) {
        let turned_at_us = *self.turned_at_us.get_or_insert(now_us);
        if now_us - turned_at_us > BASE_DELAY_WINDOW_US / 2 {
            self.halves = [None, self.halves[0]];
            self.turned_at_us = Some(now_us);
        }
        let least = self.halves[0].map_or(value, |least| least.min(value));
        self.halves[0] = Some(least);
    }

    fn min(&self) -> Option<Micros> {
        self.halves.iter().flatten().copied().min()
    }
}

/// Bytes sent in the last seconds, in constant memory.
#[derive(Debug, Clone)]
struct SentLog {
    /// Payload and total per slot, with the slot's number.
    slots: Box<[(i64, u64, u64); SLOTS as usize]>,
    ticks: Box<[(Tick, Micros); TICKS as usize]>,
    last: Option<Tick>,
}

impl Default for SentLog {
    fn default() -> Self {
        Self {
            slots: Box::new([(i64::MIN, 0, 0); SLOTS as usize]),
            ticks: Box::new([(Tick(i64::MIN), 0); TICKS as usize]),
            last: None,
        }
    }
}

impl SentLog {
    fn note(&mut self, tick: Option<Tick>, payload: usize, total: usize, now_us: Micros) {
        let number = now_us.div_euclid(SLOT_US);
        let slot = &mut self.slots[number.rem_euclid(SLOTS) as usize];
        if slot.0 != number {
            *slot = (number, 0, 0);
        }
        slot.1 += payload as u64;
        slot.2 += total as u64;
        if let Some(tick) = tick {
            self.last = Some(tick);
            self.ticks[tick.0.rem_euclid(TICKS) as usize] = (tick, now_us);
        }
    }

    /// The sending time of `tick`.
    fn when(&self, tick: Tick) -> Option<Micros> {
        let (known, at) = self.ticks[tick.0.rem_euclid(TICKS) as usize];
        (known == tick).then_some(at)
    }

    /// Payload and total of the second that ends at `at_us`.
    fn second_before(&self, at_us: Micros) -> (u64, u64) {
        let last = at_us.div_euclid(SLOT_US);
        let within = last - SECOND_US / SLOT_US + 1..=last;
        let slots = self.slots.iter().filter(|slot| within.contains(&slot.0));
        slots.fold((0, 0), |sum, slot| (sum.0 + slot.1, sum.1 + slot.2))
    }
}

#[cfg(test)]
#[path = "load_tests.rs"]
mod tests;
