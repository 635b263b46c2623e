//! How much the edge's link carries, estimated from delay and loss alone.
//!
//! Fusion reports the one-way delay of the newest patches that arrived. The least of the last seconds is the base delay;
//! what exceeds it is a queue that the edge itself has filled (LEDBAT, RFC 6817, section 2.4.2). A standing queue, or a
//! loss above that of radio links, lowers the rate to a little less than what arrives, so that the queue empties.
//! Without either, the rate grows, slowly first, then faster, and by the more the less it is, but by
//! no more than half of itself a second. Less by a share and more by no larger an amount brings edges that share a bottleneck to the same rate, whoever came first (Chiu 1989); with growth by
//! a share they keep what they once had. And whoever has little bears more of a queue: all see the same one, and what each
//! has in it is its rate times its delay (as in TCP Vegas, Brakmo 1994). Loss that stays however little is sent is the
//! link's own, and no reason to send still less.

use farfield_proto::message::live::HeardPatches;
use farfield_proto::tick::Tick;

use crate::live::{Micros, SECOND_US};

/// The rate for which the numbers below hold, bytes per second: what each of four edges has of 1 Mbit/s.
const USUAL_RATE: f64 = 31_000.0;
/// An edge with another rate grows by so many times [`GROWTH_PER_S`], at least and at most.
const GROWTH_TIMES: [f64; 2] = [0.5, 3.0];
/// And bears so many times the queue, at least and at most: jitter is no less where there is more room.
const QUEUE_TIMES: [f64; 2] = [1.0, 3.0];
/// A standing queue that is longer lowers the rate, microseconds: more than a tick at 60 Hz. At [`USUAL_RATE`].
const QUEUE_US: Micros = 20_000;
/// Below, the link has room, microseconds. At [`USUAL_RATE`].
const EMPTY_US: Micros = 8_000;
/// A queue stands when nothing came faster for so long, microseconds: jitter does not last.
const STANDS_US: Micros = 200_000;
/// Window over which the least one-way delay is the base delay, microseconds, in two halves.
const BASE_DELAY_WINDOW_US: Micros = 20 * SECOND_US;
/// Loss above this share, beside what the link loses however little is sent, means a full link, not radio noise.
const LOSS: f64 = 0.15;
/// Silences that are nearer to each other than this may be of a full link.
const AGAIN_US: Micros = 5 * SECOND_US;
/// A full link answers after a silence through the queue that silenced it, longer than this, microseconds; a link that was
/// away answers with its base delay at once.
const FULL_QUEUE_US: Micros = 60_000;
/// Fusion sends boxes ten times a second at least: when none came for so long, the whole link was away, or fusion was,
/// microseconds. A full link carries boxes on, because their direction has room.
const OUTAGE_US: Micros = SECOND_US / 4;
/// Above, next to nothing gets through.
const CHOKED_LOSS: f64 = 0.5;
/// Share of a new report in the loss of late, and in that of the last seconds.
const LOSS_SHARES: [f64; 2] = [0.05, 0.02];
/// What is still lost when the rate was lowered for so long for loss alone is the link's own, microseconds: reports tell of
/// the last second.
const FUTILE_LOSS_US: Micros = 5 * SECOND_US / 2;
/// Shortest time between two steps down, microseconds: a step must be seen before the next.
const STEP_PAUSE_US: Micros = 250_000;
/// When fusion has reported nothing new for so long, the link counts as cut, microseconds.
const SILENCE_US: Micros = 700_000;
/// What fusion reports of the last second is complete after so long, microseconds.
const WHOLE_US: Micros = 3 * SECOND_US / 2;
/// The rate never falls below, bytes per second: one person every few ticks.
const LEAST_RATE: f64 = 1_000.0;
/// Growth after a step down, bytes per second in each second: four edges on a link of 1 Mbit/s take two seconds for what
/// a step leaves free. At [`USUAL_RATE`].
const GROWTH_PER_S: f64 = 1_500.0;
/// Growth doubles in so long without a queue, microseconds.
const BOLDER_US: Micros = 6 * SECOND_US;
/// The rate grows by no larger share of itself in a second.
const MOST_GROWTH_SHARE_PER_S: f64 = 0.5;
/// Steps down in a row that do not halve a queue, after which it is taken for other traffic or for a longer base delay.
const FUTILE_STEPS: u32 = 6;
/// Ticks of which it is remembered when they were sent.
const TICKS: i64 = 512;
/// Width of a slot of what was sent, microseconds, and how many there are: five seconds.
const SLOT_US: Micros = 20_000;
const SLOTS: i64 = 250;

/// What one link can take.
#[derive(Debug, Clone)]
pub(super) struct LinkLoad {
    /// Bytes per second with overhead; infinite until the link was full for the first time.
    rate: f64,
    base_delay: WindowMin,
    recent: [(Micros, Micros); 16],
    n_recent: usize,
    /// What was lost since the last step down, a running mean.
    loss: f64,
    /// The same of the last seconds, whatever was done.
    usual_loss: f64,
    /// What the link loses however little is sent.
    own_loss: f64,
    /// When the rate was first lowered for loss alone, and what it was before.
    lossy_since: Option<(Micros, f64)>,
    sent: SentLog,
    since_us: Option<Micros>,
    back: Option<BackAfterSilence>,
    newest: Option<Tick>,
    /// When the first was sent of those since the last word.
    unanswered_us: Option<Micros>,
    next_step_at_us: Micros,
    grown_at_us: Micros,
    /// Steps down since the queue was last empty, with the queue and the rate before the first.
    steps: u32,
    before: (Micros, f64),
}

/// When something was reported again after a silence.
#[derive(Debug, Clone, Copy)]
struct BackAfterSilence {
    at_us: Micros,
    /// The base delay before it, microseconds.
    base_us: Option<Micros>,
    /// Whether the link seems full: it was silent before, and neither lost little nor answered without a queue since. A link
    /// that was cut is back for good, a full one is silent again and again.
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
    /// What may be sent, bytes per second with overhead.
    pub(super) fn rate(&self) -> f64 {
        self.rate
    }

    /// Notes a message of `tick`: its payload, and what it is with all that the protocols add.
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

    /// Payload that was sent in the last second, bytes.
    pub(super) fn payload_per_s(&self, now_us: Micros) -> u64 {
        self.sent.second_before(now_us).0
    }

    /// Whether nothing was reported of what was sent for so long that the link must be cut.
    pub(super) fn is_silent(&self, now_us: Micros) -> bool {
        self.newest.is_some() && self.is_unanswered(now_us)
    }

    /// Whether hardly anything gets through: more than half is lost, whoever is to blame, nothing was reported for long, be
    /// it that nothing ever was, or that was so again and again until a moment ago.
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

    /// Fusion's boxes come again after `silent_us` without any. What was not answered meanwhile, and what was lost in the
    /// last second, says nothing of what the link carries; delays still do.
    pub(super) fn hear_boxes_after(&mut self, silent_us: Micros, now_us: Micros) {
        if silent_us < OUTAGE_US {
            return;
        }
        self.unanswered_us = None;
        if self.since_us.is_some_and(|since_us| since_us < now_us) {
            self.since_us = Some(now_us);
        }
    }

    /// A clock was stepped, or fusion restarted: earlier delays cannot be compared with later ones; the rate is kept.
    pub(super) fn forget_delays(&mut self, now_us: Micros) {
        self.base_delay = WindowMin::default();
        self.n_recent = 0;
        self.loss = 0.0;
        self.newest = None;
        // Who is asked now is not to blame for what the one before did not answer.
        self.unanswered_us = None;
        // What is under way was sent by the old clock, and the last second is not whole.
        self.since_us = Some(now_us + SECOND_US);
    }

    /// Takes fusion's report at `now_us`. `correction_us`: correction of the own clock in force, microseconds;
    /// `limited`: whether more would be sent if the rate allowed it.
    pub(super) fn hear(
        &mut self,
        heard: &HeardPatches,
        correction_us: i32,
        limited: bool,
        now_us: Micros,
    ) {
        // What was never sent cannot have arrived; and after it nothing would be new any more.
        let was_sent = self.sent.last.is_some_and(|last| heard.tick <= last);
        if !was_sent || self.newest.is_some_and(|tick| heard.tick <= tick) {
            return;
        }
        if self.is_unanswered(now_us) {
            self.note_back(now_us);
        }
        if self.is_silent(now_us) {
            // The link is back. What was lost meanwhile says nothing of what it carries.
            self.forget_delays(now_us);
        }
        // Against the own clock as it is, so that corrections do not look like queues.
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

    /// Notes that something is reported again after a silence.
    fn note_back(&mut self, now_us: Micros) {
        let of_late = |back: &BackAfterSilence| now_us - back.at_us < AGAIN_US;
        let before = self.back.filter(of_late);
        // What was measured since the silence before may be with a queue that stands.
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
        // It gets better with the weather, and is then noticed again when it gets worse.
        self.own_loss = self.own_loss.min(self.usual_loss + LOSS / 2.0);
        if self.usual_loss < LOSS / 2.0 {
            self.lossy_since = None;
        }
    }

    /// Whether less was sent for so long, for loss alone, that the loss must be the link's own: then the rate is what it
    /// was before.
    fn is_futile(&mut self, now_us: Micros) -> bool {
        let long_ago = |(since_us, _): &mut (Micros, f64)| now_us - *since_us >= FUTILE_LOSS_US;
        let Some((_, rate)) = self.lossy_since.take_if(long_ago) else {
            return false;
        };
        self.own_loss = self.loss.max(self.usual_loss);
        (self.rate, self.grown_at_us) = (rate, now_us);
        true
    }

    /// The queue that stands, microseconds; `None` while too little is known.
    fn queue_us(&self, now_us: Micros) -> Option<Micros> {
        /// A few late words are not a queue.
        const FEWEST: usize = 4;
        let known = self.n_recent.min(self.recent.len());
        let newest_first =
            (1..=known).map(|back| self.recent[(self.n_recent - back) % self.recent.len()]);
        let standing = newest_first
            .enumerate()
            .take_while(|(n, (at_us, _))| *n < FEWEST || now_us - at_us <= STANDS_US);
        let (mut least_us, mut since_us, mut words) = (Micros::MAX, now_us, 0);
        for (_, (at_us, delay_us)) in standing {
            (least_us, since_us, words) = (least_us.min(delay_us), at_us, words + 1);
        }
        // Nor is what comes all at once after a pause.
        if words < FEWEST || now_us - since_us < STANDS_US / 2 {
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
        // The longer the queue, the faster it has to go.
        let share = (0.92 - queue_us as f64 / SECOND_US as f64).clamp(0.5, 0.92);
        self.rate = self.rate.min(arrived * share).max(LEAST_RATE);
        self.loss = 0.0;
        self.next_step_at_us = now_us + loop_us.max(0) + STEP_PAUSE_US;
    }

    /// A queue that stays when less is sent is not the edge's own: it becomes part of the base delay.
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
        let calm = (now_us - self.next_step_at_us) as f64 / BOLDER_US as f64;
        let most = self.rate * MOST_GROWTH_SHARE_PER_S;
        self.rate += (GROWTH_PER_S * times(self.rate, GROWTH_TIMES) * calm.exp2()).min(most) * dt_s;
    }
}

/// How many times the queue of an edge of [`USUAL_RATE`] one bears, or its growth: the less it has, the more, between the
/// bounds. So of edges that see the same queue who has most goes first, and who has least comes back first.
fn times(rate: f64, [least, most]: [f64; 2]) -> f64 {
    (USUAL_RATE / rate.max(1.0)).clamp(least, most)
}

/// The least of the last [`BASE_DELAY_WINDOW_US`], to half of that: two halves that take turns.
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

/// What was sent in the last seconds, of constant size.
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

    /// When `tick` was sent.
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
